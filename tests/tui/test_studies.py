"""The list of studies: its states, its preview, its filter, and what it says when there is nothing yet."""

import shutil
import sys
from contextlib import nullcontext

import pytest

from fraexp.execution.events import TimeLeft
from fraexp.tui.app import FraexpApp
from fraexp.tui.screens import studies_page
from fraexp.tui.screens.launch_page import LaunchPage
from fraexp.tui.screens.studies_page import StudiesPage
from fraexp.tui.services.study_survey import SURVEY_LINE, SurveyProcess
from fraexp.tui.widgets.filter_line import FilterLine
from fraexp.views.study import StudySurvey
from tests.tui.pilots import pilot_of, screen_text, shows, until


def studies(app: FraexpApp) -> StudiesPage:
    page = app.screen
    assert isinstance(page, StudiesPage)
    return page


@pytest.mark.thorough
def test_without_a_database_it_explains_itself_and_offers_the_quick_study(tmp_path):
    async def steps(app, pilot):
        await shows(pilot, "Enter again launches it", "quick", "fraexp list --studies")
        await until(pilot, lambda: studies(app).item and studies(app).item.name == "quick")
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, LaunchPage))
        await shows(pilot, "$ fraexp run quick", "4 sweeps: 0 reused, 4 to compute")

    pilot_of(tmp_path, steps)


def preview_text(app) -> str:
    """Return the text of the panel on the right without its line breaks, whose places depend on the folder's length."""
    rows = [row.rstrip("│ ").rpartition("││")[2] for row in screen_text(app).splitlines() if "││" in row]
    return " ".join(" ".join(rows).split())


@pytest.mark.thorough
def test_states_come_one_by_one_and_the_preview_tells_what_a_study_asks(workspace, survey):
    (workspace / "studies" / "broken.toml").write_text('"[bold]" = 1\n', encoding="utf-8")

    async def steps(app, pilot):
        page = studies(app)
        await until(pilot, lambda: {"quick", "failing"} <= page.found.keys())
        assert page.found["quick"].state == "new"  # thirty points are another thing than five
        assert page.last["quick"].number == 1
        await shows(pilot, "● 1 complete", "✗ 2 no usable result", "machine  linear_motor_table", "amplitude  12.0,")
        await pilot.press("slash", *"broken", "enter")
        await until(pilot, lambda: "there is no section or key '[bold]'; known" in preview_text(app))
        assert "quick" not in screen_text(app)
        await pilot.press("escape")
        await shows(pilot, "quick")

    pilot_of(workspace, steps, (120, 40))


def test_a_survey_is_the_same_after_its_way_from_the_other_process():
    found = StudySurvey("a", 3, 1, 2, time=TimeLeft(4.0, 2, 1))
    assert SURVEY_LINE.validate_json(SURVEY_LINE.dump_json(found)) == found


@pytest.mark.thorough
def test_the_filter_says_when_nothing_is_left_and_esc_takes_it_away(workspace):
    async def steps(app, pilot):
        page = studies(app)
        await until(pilot, lambda: page.item)
        await pilot.press("slash", *"nowhere")
        await shows(pilot, "No study matches 'nowhere'", "no rows")
        await pilot.press("escape")
        await until(pilot, lambda: page.item and not page.query_one(FilterLine).value)

    pilot_of(workspace, steps)


@pytest.mark.parametrize(("visual", "editor", "command"), [("code -w", "vi", "code -w"), (" ", "vi", "vi")])
def test_the_editor_is_the_users(monkeypatch, visual, editor, command):
    monkeypatch.setenv("VISUAL", visual)
    monkeypatch.setenv("EDITOR", editor)
    assert studies_page.editor_command() == command


@pytest.mark.thorough
def test_a_study_that_is_added_is_noticed_copied_and_edited(workspace, tmp_path, monkeypatch):
    editor = tmp_path / "editor.py"
    editor.write_text("import pathlib, sys; pathlib.Path(sys.argv[1]).write_text('x =\\n')")
    monkeypatch.setenv("VISUAL", f"{sys.executable} {editor}")
    monkeypatch.setattr(FraexpApp, "suspend", nullcontext)  # pilots have no terminal to give away

    async def steps(app, pilot):
        page = studies(app)
        await until(pilot, lambda: page.item)
        shutil.copy(workspace / "studies" / "failing.toml", workspace / "studies" / "added.toml")
        await until(pilot, lambda: any(entry.name == "added" for entry in page.items))
        await pilot.press("slash", *"added", "enter")
        await until(pilot, lambda: page.item and page.item.name == "added")
        await pilot.press("N")
        await shows(pilot, "Name of the copy of added", "my_added")
        await pilot.press("enter")
        await until(pilot, lambda: any(entry.name == "my_added" for entry in page.items))
        assert (workspace / "studies" / "my_added.toml").read_text() == "x =\n"
        await pilot.press("slash", *"my_added", "enter")
        await shows(pilot, "✗ broken", "valid TOML")
        monkeypatch.setenv("VISUAL", "vi '")
        await pilot.press("e")
        await shows(pilot, "No closing quotation")
        await pilot.press("escape", "slash", *"paper/fig12", "enter")
        await until(pilot, lambda: page.item and page.item.name == "paper/fig12")
        await pilot.press("e")
        await shows(pilot, "not edited")

    pilot_of(workspace, steps, notices=True)


def test_a_state_that_is_not_known_yet_is_told_and_only_worked_out_for_who_looks(workspace, monkeypatch):
    begun = []
    monkeypatch.setattr(SurveyProcess, "survey", lambda *_: begun.append(1))
    monkeypatch.setattr(studies_page, "SURVEY_DELAY_S", 3600.0)  # the moment comes when we say so

    async def steps(app, pilot):
        page = studies(app)
        await until(pilot, lambda: page.item and page._soon)
        await pilot.press("r")
        await until(pilot, lambda: app.current_mode == "runs")
        page._soon.stop()
        page._survey_if_seen()
        assert not begun
        monkeypatch.setattr(studies_page, "SURVEY_DELAY_S", 0.01)
        await pilot.press("s")
        await shows(pilot, "...")
        await until(pilot, lambda: begun)

    pilot_of(workspace, steps)
