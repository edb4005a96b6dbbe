"""Help tells the keys as they are, on every screen."""

import pytest
from textual.widgets import Static

from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import PLACES
from fraexp.tui.screens.help_screen import HelpPage
from fraexp.tui.screens.trial_page import TrialPage
from fraexp.tui.services import key_bindings
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


@pytest.mark.thorough
def test_help_tells_a_key_that_was_changed(workspace, tmp_path, monkeypatch):
    settings = tmp_path / "tui.toml"
    settings.write_text('[keys]\nplugins = "P"\n"plugins.filter" = "f5"\n', "utf-8")
    monkeypatch.setenv("FRAEXP_TUI_SETTINGS", str(settings))

    async def steps(app, pilot):
        await pilot.press("P")
        await until(pilot, lambda: app.screen.PLACE == "plugins")
        await pilot.press("f5")
        await until(pilot, lambda: app.screen.query_one("#filter").has_class("-shown"))
        await pilot.press("escape", "question_mark")
        await shows(pilot, "f5  ")

    pilot_of(workspace, steps, size=(160, 50))


@pytest.mark.thorough
def test_f1_helps_where_letters_are_typed(workspace):
    async def steps(app, pilot):
        await app.push_screen(TrialPage("dahl"))
        await shows(pilot, "presliding")
        await pilot.press("f1")
        await shows(pilot, "describing function N(A)", "increase by 5 %")
        await pilot.press("f1")
        await until(pilot, lambda: isinstance(app.screen, TrialPage))

    pilot_of(workspace, steps)


def test_every_key_has_a_name_and_a_meaning():
    assert all(known.meaning for known in key_bindings.named_bindings().values())
    assert {"studies", "quit", "back", "help", "copy", "table.mark", "trial.more"} <= set(key_bindings.named_bindings())


def test_no_screen_takes_the_keys_of_the_places():
    """A key that leads elsewhere must do so everywhere, but for the sweep's own c, which compares it too."""
    places = {
        key
        for name in ("studies", "runs", "sweeps", "plugins", "quit", "palette")
        for key in key_bindings.named_bindings()[name].keys
    }
    modal = ("HelpPage", "InputDialog", "ConfirmDialog")
    taken = {
        known.name
        for known in key_bindings.named_bindings().values()
        if places & set(known.keys) and known.owner not in modal
    }
    assert taken == {"studies", "runs", "sweeps", "plugins", "quit", "palette"}


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


@pytest.mark.thorough
def test_a_line_that_is_wrong_is_not_taken(workspace):
    answers = []

    async def steps(app, pilot):
        app.push_screen(
            InputDialog("File?", "a", lambda text: "" if text.endswith(".png") else "expected .png"), answers.append
        )
        await pilot.press("enter")
        await shows(pilot, "expected .png")
        assert not answers
        await pilot.press("end", *".png", "enter")
        await until(pilot, lambda: answers)

    pilot_of(workspace, steps)
    assert answers == ["a.png"]


def test_help_leads_to_its_end_and_tells_our_keys_alone(workspace):
    async def steps(app, pilot):
        await pilot.press("c")
        await until(pilot, lambda: app.screen.PLACE == "compare")
        await pilot.press("question_mark")
        await until(pilot, lambda: isinstance(app.screen, HelpPage))
        await pilot.press("G")
        await shows(pilot, "finds commands by name")
        lines = app.screen.query(Static)[1].render_line
        rows = [lines(row).text for row in range(app.screen.query(Static)[1].size.height)]
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
