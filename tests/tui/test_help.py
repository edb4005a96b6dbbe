"""Help tells the keys as they are, on every screen."""

import importlib
import inspect
import pkgutil

import pytest
from textual.screen import ModalScreen
from textual.widgets import Static

import fraexp.tui.screens
from fraexp.tui import dialogs, page
from fraexp.tui.app import FraexpApp
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import PLACES
from fraexp.tui.screens.help_screen import HelpPage
from fraexp.tui.widgets import paged_table, sweep_table, tagging
from tests.tui.pilots import pilot_of, shows, until


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.thorough
def test_help_of_a_place_tells_what_it_is_for_and_closes(workspace, place):
    async def steps(app, pilot):
        app.action_place(place)
        await until(pilot, lambda: getattr(app.screen, "PLACE", "") == place)
        page = app.screen
        await pilot.press("question_mark")
        await shows(pilot, page.HELP.strip().split("\n")[0][:40])
        await pilot.press("escape")
        await until(pilot, lambda: app.screen is page)

    pilot_of(workspace, steps)


def test_no_screen_takes_the_keys_of_the_places():
    """A key that leads elsewhere must do so everywhere, but for the sweep's own c, which compares it too."""
    names = [info.name for info in pkgutil.walk_packages(fraexp.tui.screens.__path__, "fraexp.tui.screens.")]
    modules = [*map(importlib.import_module, names), dialogs, paged_table, sweep_table, tagging, page]
    owners = {of for module in modules for _, of in inspect.getmembers(module, inspect.isclass)}
    taken = {
        (key, owner.__name__)
        for owner in owners - {HelpPage, FraexpApp}
        for binding in owner.__dict__.get("BINDINGS", ())
        if owner.__module__.startswith("fraexp.") and not issubclass(owner, ModalScreen)
        for key in binding.key.split(",")
    }
    places = {binding.key for binding in FraexpApp.BINDINGS}
    assert len(taken) > 50
    assert {(key, owner) for key, owner in taken if key in places} == {("c", "SweepPage"), ("c", "RunPage")}


@pytest.mark.thorough
def test_a_question_is_answered_with_yes_alone(workspace):
    answers = []

    async def steps(app, pilot):
        for key in ("enter", "escape", "n", "y"):
            app.push_screen(ConfirmDialog("Delete [all]?"), answers.append)
            await shows(pilot, "Delete [all]?")
            await pilot.press(key)
            await pilot.pause()

    pilot_of(workspace, steps)
    assert answers == [False, False, False, True]


def test_help_leads_to_its_end_and_tells_our_keys_alone(workspace):
    async def steps(app, pilot):
        await pilot.press("c")
        await until(pilot, lambda: app.screen.PLACE == "compare")
        await pilot.press("question_mark")
        await until(pilot, lambda: isinstance(app.screen, HelpPage))
        await pilot.press("G")
        await shows(pilot, "finds commands by name")
        lines = app.screen.query_one(Static).render_line
        rows = [lines(row).text for row in range(app.screen.query_one(Static).size.height)]
        assert sum("hide or show this curve" in row for row in rows) == 1
        assert any(row.split()[:3] == ["1", "to", "9"] for row in rows)
        assert not any(
            ("ocus" in row and "revious" in row) or "Copy selected" in row or "Quit the app" in row for row in rows
        )
        await pilot.press("g")
        await shows(pilot, "marked sweeps")

    pilot_of(workspace, steps)


def test_the_palette_offers_our_commands_alone(workspace):
    async def steps(app, pilot):
        await shows(pilot, "quick")
        names = [command.title for command in app.get_system_commands(app.screen)]
        assert "filter" in names
        assert not {"Focus Next", "Focus Previous", "Copy selected text"} & set(names)

    pilot_of(workspace, steps)
