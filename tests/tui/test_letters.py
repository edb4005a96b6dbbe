"""Terminals that know ASCII alone, or no colours."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from fraexp.tui.app import FraexpApp
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import PLACES
from fraexp.tui.screens.trial_page import TrialPage
from fraexp.tui.services.ascii_filter import ascii_text
from fraexp.tui.services.user_settings import is_ascii_terminal
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until


@given(st.text(st.characters(exclude_categories=["Cc", "Cs", "Cn", "Co"]), max_size=20))
def test_a_text_keeps_its_width(text):
    found = ascii_text(text)
    assert found.isascii()
    assert abs(cell_len(found) - cell_len(text)) <= 2 * sum(not character.isascii() for character in text)


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("┃µm│", "|um|"),
        ("⣿⡀⠀", "#. "),
        ("Å", "A"),
        ("频率", "????"),
        ("3 ± 1", "3 ~ 1"),
        ("…", "~"),
        ("⏎ open", "< open"),
        ("✓", "x"),
    ],
)
def test_what_stands_for_what(text, plain):
    assert ascii_text(text) == plain


@pytest.mark.parametrize("size", [(80, 24), pytest.param((160, 50), marks=pytest.mark.thorough)])
@pytest.mark.thorough
def test_every_screen_is_ascii_where_that_is_wished(workspace, keys, size):
    async def steps(app, pilot):
        app.marks.add(keys)
        for place in PLACES:
            app.action_place(place)
            await until(pilot, lambda place=place: getattr(app.screen, "PLACE", "") == place)
            await settle(pilot)
            assert screen_text(app).isascii(), place
            await pilot.press("f1")
            await settle(pilot)
            assert screen_text(app).isascii(), place
            await pilot.press("escape")
        for screen in (TrialPage("dahl"), InputDialog("± ✓ µ?", "→"), ConfirmDialog("± ✓ µ?")):
            await app.push_screen(screen)
            await settle(pilot)
            assert screen_text(app).isascii(), screen
            await pilot.press("escape")
        app.action_place("sweeps")
        await shows(pilot, "rows 1-")
        await pilot.press("enter")
        await settle(pilot)
        assert screen_text(app).isascii()
        app.action_place("runs")
        await settle(pilot)
        await pilot.press("enter")
        await settle(pilot)
        assert screen_text(app).isascii()
        app.action_place("studies")
        await settle(pilot)
        await pilot.press("enter")
        await settle(pilot)
        assert screen_text(app).isascii()

    pilot_of(FraexpApp(workspace, plain=True), steps, size=size)


@pytest.mark.thorough
def test_letters_can_be_changed_while_it_runs(workspace):
    async def steps(app, pilot):
        await app.push_screen(TrialPage("dahl"))
        await shows(pilot, "/cycle", "│")
        app.action_ascii()
        await until(pilot, lambda: screen_text(app).isascii())
        app.action_ascii()
        await shows(pilot, "│")

    pilot_of(FraexpApp(workspace, plain=False), steps)


@pytest.mark.parametrize(
    ("environment", "plain"),
    [
        ({}, False),
        ({"LANG": "C"}, True),
        ({"LANG": "C.UTF-8"}, False),
        ({"LANG": "de_DE.utf8", "TERM": "xterm"}, False),
        ({"LANG": "de_DE.utf8", "LC_ALL": "C"}, True),
        ({"LANG": "de_DE.ISO-8859-1"}, True),
        ({"LANG": "C.UTF-8", "TERM": "dumb"}, True),
        ({"LANG": "C.UTF-8", "TERM": "linux"}, True),
        ({"LANG": "C.UTF-8", "TERM": "xterm-256color"}, False),
    ],
)
def test_which_terminals_are_taken_to_know_ascii_alone(environment, plain):
    assert is_ascii_terminal(environment) is plain


@pytest.mark.parametrize(
    ("environment", "plain"), [({"LANG": "C"}, True), ({"LANG": "C.UTF-8", "TERM": "xterm"}, False)]
)
def test_the_terminal_decides_unless_told(workspace, monkeypatch, environment, plain):
    for name in ("LC_ALL", "LC_CTYPE", "LANG", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert FraexpApp(workspace).plain is plain
    assert FraexpApp(workspace, plain=not plain).plain is not plain


@pytest.mark.thorough
def test_without_colours_all_is_still_told(workspace, keys, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")

    async def steps(app, pilot):
        app.marks.add(keys[:1])
        await pilot.press("w")
        await shows(pilot, "✓", "1 marked")
        colours = {
            segment.style.color.get_truecolor()
            for strip in app.screen._compositor.render_strips()
            for segment in strip
            if segment.style and segment.style.color
        }
        assert all(colour.red == colour.green == colour.blue for colour in colours)

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_the_keys_in_the_last_line_are_read_in_ascii_too(workspace):
    async def steps(app, pilot):
        await shows(pilot, "Enter open", "? help")

    pilot_of(FraexpApp(workspace, plain=True), steps)
