"""Compare: what is marked is overlaid, told apart, told in what it differs, and exported."""

from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import DataTable, Input

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.figure_kinds import FIGURES
from fraexp.data.results import Outcome, Result
from fraexp.store import Store
from fraexp.tui.app import FraexpApp
from fraexp.tui.plotting.plotted_curves import REFERENCE
from fraexp.tui.screens.compare_page import ComparePage
from fraexp.views.words import short_key
from tests.examples import thorough
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until
from tests.tui.responses import found, gap, loop, resonant, store_results

GRID = np.geomspace(1.0, 400.0, 200)


async def compare(app: FraexpApp, pilot: Pilot[None], keys: list[str]) -> ComparePage:
    """Mark sweeps and go to Compare."""
    app.marks.add(keys)
    await pilot.press("c")
    await until(pilot, lambda: isinstance(app.screen, ComparePage) and app.screen.is_mounted)
    assert isinstance(app.screen, ComparePage)
    page = app.screen
    await until(pilot, lambda: page.stack.picture is not None)
    await settle(pilot)
    return app.screen


@pytest.mark.parametrize("size", [(80, 24), thorough((200, 50))])
def test_marked_sweeps_are_overlaid_with_the_plant(workspace: Path, keys: list[str], size: tuple[int, int]) -> None:
    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        shorts = " ".join(short_key(key) for key in keys)
        assert page.command == f"fraexp plot {shorts} --kind bode -o bode.png --workspace {workspace}"
        text = screen_text(app)
        for part in (
            "1 ━━━ 12 N, conventional",
            "4 ━━━ 75 N, effective_input",
            "P(s), linear plant",
            "Magnitude [dB re 1 mm/N]",
        ):
            assert part in text
        assert ("difference" in text) == (size[0] > 110)
        assert len(text.splitlines()) == size[1]

    pilot_of(workspace, steps, size)


@pytest.mark.thorough
def test_every_view_has_a_kind_of_figure_and_its_command_draws_it(
    workspace: Path, keys: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = []

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        commands.append(page.command)
        await pilot.press("i")
        await until(pilot, lambda: page.command.startswith(f"fraexp compare {short_key(keys[0])} "))
        commands.append(page.command)
        for key, kind in (("d", "errors"), ("R", "difference"), ("n", "nyquist"), ("t", "coherence")):
            await pilot.press(key)
            await until(pilot, lambda kind=kind: f"--kind {kind}" in page.command)
            assert kind in FIGURES
            commands.append(page.command)

    pilot_of(workspace, steps)
    monkeypatch.chdir(tmp_path)
    for command in commands:
        program, *arguments = command.split()
        assert program == "fraexp"
        assert main(arguments) == ExitCode.OK
    kinds = {file.stem for file in tmp_path.glob("*.png")}
    assert kinds == {"bode", "errors", "difference", "nyquist", "coherence"}


@pytest.mark.thorough
def test_differences_are_from_the_focused_curve_or_from_the_plant(workspace: Path, keys: list[str]) -> None:
    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        await pilot.press("right_square_bracket", "R")
        await shows(pilot, "against 12 N, effective_input")
        assert page.stack.picture is not None
        of = {trace.curve for trace in page.stack.picture.panels[0].traces}
        assert of == {0, 2, 3}
        assert f"plot {short_key(keys[1])} {short_key(keys[0])}" in page.command  # the reference is the first
        await pilot.press("b", "left_square_bracket", "left_square_bracket")
        await until(pilot, lambda: page.view == "bode")
        assert page.stack.view_range.focus == REFERENCE
        await pilot.press("R")
        await shows(pilot, "against P(jω)")
        assert "--kind errors" in page.command

    pilot_of(workspace, steps)


def test_the_cursor_tells_the_numbers_of_the_database(workspace: Path, keys: list[str]) -> None:
    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        response = store.result(keys[0]).response
    assert response is not None

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        for _ in range(3):
            await pilot.press("h")
        assert page.stack.view_range.cursor == response.frequency.min()
        await pilot.press("l")
        index = np.argsort(response.frequency)[1]
        assert page.stack.view_range.cursor == response.frequency[index]
        await shows(
            pilot, f"{response.frequency[index]:.4g} Hz", f"{20 * np.log10(1e3 * abs(response.response[index])):.2f} dB"
        )
        before = page.stack.window(0)
        await pilot.press("x", "L", "z", "K")
        after = page.stack.window(0)
        assert all(old != new for old, new in zip(before, after, strict=True))
        assert page.stack.window(0)[:2] == page.stack.window(1)[:2]
        await pilot.press("equals_sign")
        assert page.stack.window(0) == before
        await pilot.press("W")
        assert page.stack.window(1)[2:] == (-190, 190)
        await pilot.press("u")
        assert not page.stack.view_range.bands

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_the_table_has_only_what_differs(workspace: Path, keys: list[str]) -> None:
    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        await compare(app, pilot, keys[:3:2])  # one estimator, two amplitudes
        await pilot.press("i")
        await shows(pilot, "difference", "excitation.amplitude")
        table = app.screen.query_one(DataTable)
        names = [str(table.get_row_at(row)[0]) for row in range(table.row_count)]
        assert "excitation.amplitude [N]" in names
        assert not any(name.startswith("estimator") for name in names)
        assert "━" not in screen_text(app)
        await pilot.press("escape")
        await shows(pilot, "Magnitude")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_the_command_draws_the_band_and_the_phase_that_are_seen(workspace: Path, keys: list[str]) -> None:
    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        whole = page.command
        page.stack._x[page.stack.picture.panels[0].axis] = (1.0, 2.0)  # as zooming does, to the decade above 10 Hz
        await pilot.press("W")
        await until(pilot, lambda: "--kind bode --frequency-range=10:100 --wrap-phase -o bode.png" in page.command)
        await pilot.press("d")  # the same frequencies; there is no phase to wrap
        await until(pilot, lambda: "--kind errors --frequency-range=10:100 -o" in page.command)
        await pilot.press("n")
        await until(pilot, lambda: "--kind nyquist -o" in page.command)
        await pilot.press("b", "W")
        page.action_home()
        await until(pilot, lambda: page.command == whole)

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_export_asks_for_a_name_and_draws_what_is_seen(
    workspace: Path, keys: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    target = tmp_path / "seen.svg"

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        await compare(app, pilot, keys)
        await pilot.press("n", "2")
        await pilot.press("e")
        await shows(pilot, "Export 3 sweeps as a nyquist figure")
        line = app.screen.query_one(Input)
        line.value = "seen.txt"
        await shows(pilot, "cannot be written as '.txt'")
        await pilot.press("enter")  # not with that name
        line.value = str(target)
        await pilot.press("enter")
        await until(pilot, target.exists)
        content = target.read_text(encoding="utf-8")
        assert "svg" in content[:200]
        first = target.stat().st_mtime_ns
        await pilot.press("b", "e")
        app.screen.query_one(Input).value = str(target)
        await pilot.press("enter")
        await shows(pilot, "already exists. Overwrite it?")
        await pilot.press("enter")  # no
        await settle(pilot)
        assert target.stat().st_mtime_ns == first

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_responses_in_other_units_and_without_any_are_told_and_reached(tmp_path: Path) -> None:
    keys = store_results(tmp_path, [
        found(resonant(GRID)), found(resonant(GRID, "rad/N")), Result(Outcome.OK, curves=(loop(1e-5),)),
        found(gap(resonant(GRID), 3, 9)),
    ])  # fmt: skip

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        await shows(pilot, "1 response in rad/N in another view: g", "1 sweep without a response")
        assert list(page.labels()) == [0, 3]
        await pilot.press("g")
        await shows(pilot, "Magnitude [dB re 1 rad/N]")
        assert list(page.labels()) == [1]
        await pilot.press("v")
        await shows(pilot, "Friction force [N] over displacement [µm]")
        assert "--kind hysteresis" in page.command
        assert short_key(keys[2]) in page.command
        assert short_key(keys[0]) not in page.command
        await pilot.press("d")  # one response in this unit: nothing to compare it with
        await settle(pilot)
        assert page.view == "curves"
        assert any("choose at least two sweeps" in note.message for note in app._notifications)

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_marks_may_change_and_sweeps_may_go_while_it_is_shown(tmp_path: Path) -> None:
    keys = store_results(tmp_path, [found(resonant(GRID, at=at)) for at in (30.0, 40.0, 50.0)])

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        await pilot.press("2", "right_square_bracket", "right_square_bracket")
        assert page.stack.view_range.focus == 2
        with Store.open(str(tmp_path / "results.db")) as store:
            store.delete([keys[0]])
        await until(pilot, lambda: page.compared is not None and len(page.compared.sweeps) == 2)
        await settle(pilot)
        assert page.stack.view_range.hidden == {0}  # the second one is the first now, and stays hidden
        assert page.stack.view_range.focus == 1
        assert list(app.marks) == keys[1:]
        await pilot.press("space")
        await until(pilot, lambda: page.compared is not None and len(page.compared.sweeps) == 1)
        assert page.command.startswith(f"fraexp plot {short_key(keys[1])} --kind bode")
        app.marks.clear()
        page.reload()
        await shows(pilot, "No sweeps are marked")

    pilot_of(tmp_path, steps)
