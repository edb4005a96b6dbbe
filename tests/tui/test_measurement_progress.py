"""What is said of a measurement while it goes on: stages, rests and counts, by its state alone."""

import pytest

from fraexp.tui.page import PageHeader
from fraexp.tui.screens.measurement_page import MAX_NOTICE_LENGTH, MeasurementPage, question_text
from fraexp.tui.screens.studies_page import StudiesPage
from fraexp.tui.services.live_measurement import LimitedMotion, PlanSummary, TrackedMeasurement
from fraexp.tui.services.measurement_worker import stage_changes
from fraexp.workspace.autonomous_service import STAGES, EvaluationBegun, StageBegun
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until

LEVELS = 4


def plan_of(kept: int = 0, seconds: float = 40.0) -> PlanSummary:
    rows, total = (("1 Hz",),) * 20, f"20 points, {kept} kept, about {seconds:g} s of machine time"
    motions = (LimitedMotion("force", "N", 150.0, 15.0, 3),)
    afresh = "20 points, about 40 s of machine time"
    return PlanSummary("", "bench", motions, 0.1, (), rows, seconds, total, (1.0, 80.0), None, kept, False, afresh)


def measuring(is_autonomous: bool = False) -> TrackedMeasurement:
    """Return a measurement whose machine is being connected."""
    live = TrackedMeasurement("axis")
    live.update(plans=(plan_of(),), is_autonomous=is_autonomous, state="measuring")
    return live


def stage(number: int, level: int = 0, levels: int = LEVELS) -> StageBegun:
    return StageBegun("", number, "up to 0.9 times friction", level, levels)


def test_the_bar_of_an_autonomous_measurement_is_over_its_stages() -> None:
    live, fractions = measuring(is_autonomous=True), []
    for event in (stage(0, levels=1), stage(1), stage(1, 1), stage(1, 3), stage(2), stage(3, levels=1)):
        live.update(**stage_changes(event))
        live.update(plan=plan_of(), total=20)
        fractions.append(live.done_fraction)
        live.update(done=20)
        fractions.append(live.done_fraction)
    assert fractions == sorted(fractions)
    assert fractions[:4] == pytest.approx([0, 1 / 6, 1 / 6, 1 / 6 + 1 / 24])
    live.update(**stage_changes(EvaluationBegun("", 3)))
    assert fractions[-1] == pytest.approx(live.done_fraction) == pytest.approx(5 / 6)
    assert live.count_text == f"stage 4 of {len(STAGES)}"
    live.update(state="complete")
    assert live.done_fraction == 1


@pytest.mark.parametrize(
    ("kept", "fresh", "words"),
    [
        (5, False, "will move: 20 points, 5 kept, about 40 s of machine time, up to 10 %"),
        (5, True, "will move: 20 points, about 40 s of machine time, up to 10 %"),
        (20, False, "nothing is played"),
        (20, True, "will move: 20 points, about 40 s of machine time, up to 10 %"),
    ],
)
def test_the_question_counts_what_will_be_played(kept: int, fresh: bool, words: str) -> None:
    live = TrackedMeasurement("axis")
    live.update(plans=(plan_of(kept),))
    assert words in question_text(live, fresh)


def test_what_is_shown_while_it_is_measured_and_after(tmp_path) -> None:
    live = measuring(is_autonomous=True)

    async def steps(app, pilot) -> None:
        app.measurement = live
        await until(pilot, lambda: isinstance(app.screen, StudiesPage) and app.screen.item)
        await shows(pilot, "▶ measuring")
        assert "0/0" not in screen_text(app)
        live.study = app.screen.item.name
        app.screen.show()
        await until(pilot, lambda: screen_text(app).count("▶ measuring") == 2)
        await app.push_screen(MeasurementPage(live))  # type: ignore[arg-type]
        live.update(**stage_changes(stage(1, 1)))
        live.update(plan=plan_of(), total=20)
        live.update(last_point="1 Hz", done=12, seconds_left=16.0)
        await shows(pilot, "stage 2 of 4, level 2 of 4: 12 of 20 points, about 16 s left", "x stop")
        assert "continue" not in screen_text(app).splitlines()[-1]
        live.update(notices=("rolling 402, dahl 919, " * 100,))
        live.update(**stage_changes(EvaluationBegun("", 1, 40.0)))
        await shows(pilot, "now   the axis rests while what was recorded is evaluated: ", " of about 40 s")
        live.rest_since -= 100
        await shows(pilot, "1 min 40 s of about 40 s")
        assert screen_text(app).count("dahl") < MAX_NOTICE_LENGTH / len("rolling 402, dahl 919, ") + 1
        live.update(**stage_changes(stage(2)))
        live.update(plan=plan_of(), total=20)
        live.change_state("measuring", "stopping")
        await shows(pilot, "stopping", "0 of 20 points")
        assert "left" not in screen_text(app)
        live.is_end_shown = True
        live.update(state="stopped", message="measured points are kept")
        await shows(pilot, "R continue")
        await settle(pilot)
        assert "x stop" not in screen_text(app).splitlines()[-1]
        app.measurement = None
        await app.screen.query(PageHeader).remove()
        app.screen.show_header()  # as a poll does while all ends

    pilot_of(tmp_path, steps, (120, 40))
