"""Autonomous measurements in the terminal UI: stages instead of points, and responses that keep the label of theirs."""

import pytest

from tests.tui.pilots import pilot_of, shows, until
from tests.tui.test_measuring import STUDY, choose, machine_events, write_study


@pytest.mark.thorough
def test_an_unknown_axis_is_measured_stage_by_stage_and_stopped_by_one_key(tmp_path):
    write_study(tmp_path, STUDY[: STUDY.index("[excitation]")] + STUDY[STUDY.index("[loop]") : STUDY.index("[grid]")])

    async def steps(app, pilot):
        await choose(app, pilot)
        await pilot.press("m")
        await shows(pilot, "an autonomous measurement", "friction loop", "which the model found must predict")
        await shows(pilot, "Limits, of which no motion is predicted yet", "20 mm")
        assert app.screen.command == "fraexp measure --autonomous axis"
        await pilot.press("enter")
        await shows(pilot, "will move, as far as its limits allow.")
        assert not machine_events(tmp_path)
        await pilot.press("y")
        await until(pilot, lambda: app.measurement is not None and app.measurement.responses)
        await shows(pilot, "Stages, and what they found", "friction loop: closes at", "of 20 points")
        ((label, _),) = app.measurement.responses
        assert label == "up to 0.9 times friction"
        await pilot.press("x")
        await until(pilot, lambda: app.measurement.has_ended)
        await shows(pilot, "stopped", "measured points are kept")
        await pilot.press("R")
        await shows(pilot, "of an earlier measurement kept: F discards them")

    pilot_of(tmp_path, steps, (120, 40))
    assert machine_events(tmp_path)[-1]["event"] == "rest"
