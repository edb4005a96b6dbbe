"""Compare: kinds of curves, many curves, small terminals, what is asked for too early, and names of files."""

from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from fraexp.data.results import Curve, Outcome, Result
from fraexp.figures.elements.view import View
from fraexp.tui.app import FraexpApp
from fraexp.tui.plotting import compared_sweeps
from fraexp.tui.widgets.figure_export import FigureExport, compare_command, file_fault
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService
from tests.tui.pilots import pilot_of, screen_text, shows
from tests.tui.responses import found, loop, resonant, store_results
from tests.tui.test_compare import GRID, compare


def motion() -> Curve:
    """Return a motion to a target."""
    time = np.linspace(0, 0.1, 50)
    columns = {"time": time, "position": 1e-3 * (1 - np.exp(-100 * time)), "reference": np.full(50, 1e-3),
               "target": np.full(50, 1e-3), "band": np.full(50, 1e-6)}  # fmt: skip
    return Curve("motion", columns, {"time": "s"} | dict.fromkeys(list(columns)[1:], "m"))


def fit() -> Curve:
    """Return a curve that is neither a motion nor a loop."""
    return Curve(
        "modal_fit", {"order": np.arange(1.0, 9), "error": np.geomspace(1, 0.01, 8)}, {"order": "", "error": "dB"}
    )


@pytest.mark.thorough
def test_kinds_of_curves_are_shown_one_after_another(tmp_path: Path) -> None:
    results = [Result(Outcome.OK, curves=(of,)) for of in (motion(), loop(1e-5), loop(2e-5), fit())]
    keys = store_results(tmp_path, results)

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        for kind, places, text, others in (
            ("positioning", [0], "Position − target", "hysteresis loops of 2 sweeps, other curves of 1 sweep: g"),
            ("hysteresis", [1, 2], "Friction force [N] over", "other curves of 1 sweep, motions of 1 sweep: g"),
            ("curves", [3], "Error [dB]", "motions of 1 sweep, hysteresis loops of 2 sweeps: g"),
            ("positioning", [0], "Position − target", "Curves: motions"),
        ):
            await shows(pilot, text, others)
            assert list(page.labels()) == places
            assert page.stack.picture is not None
            assert {trace.curve for panel in page.stack.picture.panels for trace in panel.traces} == set(places)
            assert page.command.split()[2 : 2 + len(places)] == [short_key(keys[place]) for place in places]
            assert f"--kind {kind} " in page.command
            await pilot.press("g")

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_what_is_hidden_or_not_listed_is_told_and_reached(tmp_path: Path) -> None:
    keys = store_results(tmp_path, [found(resonant(GRID, at=at)) for at in np.linspace(30, 60, 13)])

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        page = await compare(app, pilot, keys)
        await shows(pilot, "6 of 13 curves listed: up, down", ". hides or shows the focused curve")
        await pilot.press("up", "full_stop")  # the last one, which no digit stands for
        assert page.stack.view_range.hidden == {12}
        await shows(pilot, "d off case 12")
        await pilot.press("full_stop")
        assert page.stack.view_range.hidden == set()
        page.stack.view_range.hidden = set(range(13))
        page.show_view()
        await shows(pilot, "all curves are hidden: 0 shows them")

    pilot_of(tmp_path, steps)


def test_in_a_small_terminal_there_are_plot_and_value(tmp_path: Path) -> None:
    keys = store_results(tmp_path, [found(resonant(GRID)), found(resonant(GRID, at=60.0))])

    async def steps(app: FraexpApp, pilot: Pilot[None]) -> None:
        await compare(app, pilot, keys)
        await shows(pilot, "Magnitude", "1 more panel: page down", "Hz", " dB")
        assert any(0x2800 < ord(character) < 0x2900 for character in screen_text(app))
        await pilot.press("pagedown")
        await shows(pilot, "Phase", " deg", "1 more panel: page up")

    pilot_of(tmp_path, steps, (40, 10))


def test_a_file_in_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    assert file_fault(str(tmp_path / "x.png")) == ""
    assert file_fault("x.png") == ""
    assert file_fault(str(tmp_path / "absent" / "x.png")) == f"{tmp_path / 'absent'}: no such folder"


def test_commands_do_not_show_a_password(tmp_path: Path) -> None:
    workspace = WorkspaceService.open(tmp_path, "postgresql+psycopg://lab:secret@host/results")
    drawn = FigureExport(1, ["v1:0-1"], "bode", View(), None).command(workspace, "a.png")
    for command in (compare_command(workspace, ["v1:0-1"]), drawn):
        assert "secret" not in command
        assert "lab@host/results" in command


def test_the_first_sweeps_of_many_meet_each_point_of_a_grid() -> None:
    """Every 50th of 10,000 sweeps of a grid of 2 × 4 points would leave out half of it."""
    for points in (2, 3, 4, 5, 8, 25):
        some = compared_sweeps._distribute([f"{index}" for index in range(10_000)], 200)
        counts = np.bincount([int(key) % points for key in some], minlength=points)
        assert 190 <= len(some) <= 200
        assert counts.min() >= 0.6 * 200 / points
