"""The form of a study: what it offers, what it says of what is typed, and that it launches what it shows."""

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from textual import events
from textual.widgets import Input

from fraexp.errors import FraexpError
from fraexp.store import Store
from fraexp.tui.screens.launch_page import LaunchPage
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.runs_page import RunsPage
from fraexp.tui.screens.studies_page import StudiesPage
from fraexp.tui.services.launch_form import build_form, find_concerned
from fraexp.tui.widgets.field_list import FieldList
from fraexp.workspace.workspace_service import WorkspaceService
from tests.tui.pilots import pilot_of, settle, shows, until
from tests.waiting import wait_until


async def opened(app, pilot) -> FieldList:
    """Open the form of the quick study, and return its lines."""
    await until(pilot, lambda: app.screen.item)
    await pilot.press("enter")
    await until(pilot, lambda: isinstance(app.screen, LaunchPage) and app.screen.groups)
    await shows(pilot, "to compute")
    return app.screen.query_one(FieldList)


async def write(pilot, lines: FieldList, path: str, text: str) -> None:
    """Go to a line and type another text."""
    lines.choose(next(field for field in lines.fields if field.path == path))
    await pilot.pause()
    await pilot.press("end", *["backspace"] * len(lines.written.text(lines.field)), *text)


def test_what_is_typed_is_checked_at_once_and_the_plan_follows(tmp_path):
    async def steps(app, pilot):
        lines = await opened(app, pilot)
        await shows(pilot, "grid.excitation.amplitude", "[12.0, 75.0]", "4 sweeps: 0 reused, 4 to compute")
        await write(pilot, lines, "excitation.points", "0")
        await shows(pilot, "stepped_sine.points is 0", "must be at least 1", "! excitation.points")
        await pilot.press("f5")
        await settle(pilot)
        assert isinstance(app.screen, LaunchPage)
        await pilot.press("backspace", "9")
        await shows(pilot, "4 sweeps: 0 reused, 4 to compute", "* excitation.points")
        assert app.screen.command == "fraexp run quick --set=excitation.points=9"
        await pilot.press("ctrl+r")
        await until(pilot, lambda: app.screen.command == "fraexp run quick")

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_what_is_written_is_kept_when_the_form_is_left_and_all_can_be_restored(tmp_path):
    async def steps(app, pilot):
        lines = await opened(app, pilot)
        await write(pilot, lines, "excitation.points", "9")
        await write(pilot, lines, "excitation.min_frequency", "-1")
        await shows(pilot, "stepped_sine.min_frequency is -1")
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, StudiesPage))
        await pilot.press("enter")
        await shows(pilot, "stepped_sine.min_frequency is -1", "* excitation.points")
        assert app.screen.command == "fraexp run quick --set=excitation.points=9 --set=excitation.min_frequency=-1"
        await pilot.press("ctrl+r")
        await shows(pilot, "4 sweeps: 0 reused, 4 to compute")
        assert app.screen.command == "fraexp run quick"

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_an_axis_of_the_grid_is_a_list(tmp_path):
    async def steps(app, pilot):
        lines = await opened(app, pilot)
        await write(pilot, lines, "grid.excitation.amplitude", "[12, 24, 75]")
        await shows(pilot, "6 sweeps: 0 reused, 6 to compute")
        assert app.screen.command == "fraexp run quick '--set=grid.excitation.amplitude=[12, 24, 75]'"
        await write(pilot, lines, "grid.excitation.amplitude", "[12, -1]")
        await shows(pilot, "stepped_sine.amplitude is -1", "must be above 0 N")
        await write(pilot, lines, "grid.excitation.amplitude", "12")
        await shows(pilot, "expected a list such as [12, 75]")

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_another_component_brings_its_parameters_and_what_it_lacks_is_told_at_its_line(tmp_path):
    async def steps(app, pilot):
        lines = await opened(app, pilot)
        await write(pilot, lines, "friction.name", "dahl")
        await until(pilot, lambda: any(field.path == "friction.stiffness" for field in lines.fields))
        await shows(pilot, "[friction]: dahl lacks 'stiffness'", "! friction.stiffness")
        await write(pilot, lines, "friction.stiffness", "0.4 N/um")
        await write(pilot, lines, "friction.coulomb_force", "17.9")
        await shows(pilot, "4 sweeps: 0 reused, 4 to compute")
        stiffness = "'--set=friction.stiffness=0.4 N/um'"
        assert (
            app.screen.command
            == f"fraexp run quick --set=friction.name=dahl {stiffness} --set=friction.coulomb_force=17.9"
        )
        await write(pilot, lines, "friction.name", "rolling")
        await until(pilot, lambda: app.screen.command == "fraexp run quick")

    pilot_of(tmp_path, steps)


def test_every_study_that_comes_along_has_a_form_whose_own_texts_are_right(checkout, tmp_path):
    workspace = WorkspaceService.open(checkout, str(tmp_path / "none.db"))
    for entry in workspace.catalogue():
        groups = build_form(*workspace.outline(entry.name), entry.data.get("random"), workspace.registry)
        fields = [field for group in groups for field in group.fields]
        assert len({field.path for field in fields}) == len(fields)
        assert all(field.hint for field in fields), entry.name


@pytest.mark.parametrize(
    ("changed", "path"),
    [
        ("excitation.points=0", "excitation.points"),
        ("friction.curve.coulomb_force=x", "friction.curve.coulomb_force"),
        ("friction.viscous_coefficient=1 mm", "friction.viscous_coefficient"),
        ("numerics.tolerance=-1", "numerics.tolerance"),
    ],
)
def test_an_error_finds_the_line_that_it_is_about(checkout, changed, path):
    workspace = WorkspaceService.open(checkout)
    groups = build_form(*workspace.outline("quick"), None, workspace.registry)
    with pytest.raises(FraexpError) as raised:
        workspace.plan("quick", [changed])
    found = find_concerned(raised.value.path, [field for group in groups for field in group.fields])
    assert found is not None
    assert found.path == path


LAUNCHED = """
import asyncio, sys, time
from fraexp.tui.app import FraexpApp
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.runs_page import RunsPage

async def main():
    async with FraexpApp(sys.argv[1]).run_test(size=(80, 24)) as pilot:
        while not getattr(pilot.app.screen, "item", None):
            await pilot.pause(0.05)
        await pilot.press("enter")
        while "to compute" not in str(pilot.app.screen.query_one("#plan").render()):
            await pilot.pause(0.05)
        await pilot.press("enter")
        while not (isinstance(pilot.app.screen, RunPage) and pilot.app.screen.number):
            await pilot.pause(0.05)
        print(pilot.app.screen.number, file=sys.__stdout__, flush=True)  # textual has its own stdout
        time.sleep(600)

asyncio.run(asyncio.wait_for(main(), 120))
"""


@pytest.mark.thorough
def test_a_run_outlives_the_ui_that_is_killed(tmp_path):
    command = [sys.executable, "-c", LAUNCHED, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as ui:
        assert ui.stdout is not None
        number = int(ui.stdout.readline())
        os.kill(ui.pid, signal.SIGKILL)
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        wait_until(lambda: store.run(number).state != "running")
        run = store.run(number)
    assert (run.state, run.computed) == ("complete", 4)
    log = Path(run.provenance["log"]).read_text(encoding="utf-8")
    assert "4 to compute" in log


@pytest.mark.thorough
def test_keys_that_follow_the_launch_at_once_neither_stop_it_nor_are_lost(tmp_path):
    async def steps(app, pilot):
        await opened(app, pilot)
        for key in ("enter", "enter", "w", "r"):  # posted, not waited for
            app.post_message(events.Key(key, "\r" if key == "enter" else key))
        await until(pilot, lambda: app.screen.PLACE == "runs" and isinstance(app.screen, RunsPage))
        await shows(pilot, "1 of 1")
        await until(pilot, lambda: app.screen.items[0].state == "complete")

    pilot_of(tmp_path, steps, (120, 40))


def test_enter_enter_launches_and_the_run_comes_to_its_end(tmp_path):
    async def steps(app, pilot):
        await opened(app, pilot)
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        page = app.screen
        await until(pilot, lambda: page.run and page.run.state != "running")
        await shows(pilot, "complete", "4 of 4 sweeps", "100 %", "4 computed")
        await until(pilot, page.started.has_ended)  # it still draws and reports when the run is complete
        await pilot.press("escape")
        await shows(pilot, "$ fraexp list", "complete")

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_what_is_pasted_over_several_lines_is_one_value(tmp_path):
    async def steps(app, pilot):
        lines = await opened(app, pilot)
        await write(pilot, lines, "grid.excitation.amplitude", "")
        lines.query_one(Input).post_message(events.Paste("[\n  12,\n  24,\n]\n"))
        await until(pilot, lambda: lines.query_one(Input).value == "[ 12, 24, ]")
        await shows(pilot, "4 sweeps: 0 reused, 4 to compute")

    pilot_of(tmp_path, steps)


@pytest.mark.thorough
def test_what_is_typed_before_the_form_is_there_is_written_in_it(tmp_path, monkeypatch):
    build = LaunchPage._build

    async def later(page, changed):
        await asyncio.sleep(0.5)
        await build(page, changed)

    monkeypatch.setattr(LaunchPage, "_build", later)

    async def steps(app, pilot):
        await pilot.press("enter", "down", "down", "down", *"serial")
        await until(pilot, lambda: isinstance(app.screen, LaunchPage))
        await until(pilot, lambda: app.screen.written.changes == {"--executor": "serial"})

    pilot_of(tmp_path, steps)
