"""The list of runs."""

from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.runs_page import RunsPage
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until


def test_runs_are_listed_newest_first_and_opened(workspace):
    async def steps(app, pilot):
        await pilot.press("r")
        await shows(pilot, "$ fraexp list", "no usable result", "complete", "4/4", "1/1")
        text = screen_text(app)
        assert text.index("failing") < text.index("quick")
        await pilot.press("j", "enter")
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        await shows(pilot, "4 of 4 sweeps")
        await pilot.press("escape")
        await shows(pilot, "$ fraexp list")

    pilot_of(workspace, steps)


def test_a_run_is_deleted_only_if_that_is_confirmed(workspace):
    async def steps(app, pilot):
        await pilot.press("r")
        await until(pilot, lambda: isinstance(app.screen, RunsPage))
        await shows(pilot, "failing")
        await pilot.press("D")
        await shows(pilot, "Delete run 2 of failing", "with their results and tags?")
        await pilot.press("enter")
        await settle(pilot)
        assert "failing" in screen_text(app)
        await pilot.press("D", "y")
        await until(pilot, lambda: len(app.screen.items) == 1)
        await shows(pilot, "quick")
        await pilot.press("u")
        await until(pilot, lambda: len(app.screen.items) == 2)
        await shows(pilot, "failing")

    pilot_of(workspace, steps)


def test_without_runs_it_says_where_to_begin(tmp_path):
    async def steps(app, pilot):
        await pilot.press("r")
        await shows(pilot, "No runs yet", "s shows the studies")

    pilot_of(tmp_path, steps)
