"""All sweeps: filter, order, marks, tags, deletion."""

import pytest
from textual import events
from textual.keys import _character_to_key
from textual.widgets import Input

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.store import Store
from fraexp.tui.app import FraexpApp
from fraexp.tui.widgets import sweep_table
from fraexp.tui.widgets.sweep_table import SweepTable
from tests.tui.pilots import pilot_of, screen_text, settle, shows, until


async def opened(app, pilot) -> SweepTable:
    """Go to the sweeps, and wait until they are there."""
    await pilot.press("w")
    await until(pilot, lambda: app.screen.PLACE == "sweeps" and app.screen.table.keys)
    return app.screen.table


def typed(app: FraexpApp, *keys: str) -> None:
    """Type keys at once, as a paste or a slow line brings them."""
    for key in keys:
        letter = key if len(key) == 1 else None
        event = events.Key(_character_to_key(key) if letter else key, letter)
        event.set_sender(app)
        app.post_message(event)


async def write(pilot, text: str) -> None:
    """Type a text, and wait until it has had its effect."""
    typed(pilot.app, *text)
    await settle(pilot)


def test_all_sweeps_are_listed_newest_first_with_their_command(workspace, keys):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await shows(pilot, "$ fraexp list --sweeps", "rows 1-5 of 5", "failing 2", "quick 1", "raising", "created ▼")
        assert set(table.keys) > set(keys)
        assert app.focused is table

    pilot_of(workspace, steps)


def test_a_filter_is_tried_while_it_is_written(workspace):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("slash")
        await write(pilot, "estimator=effective_input excitation.amplitude>20")
        await shows(pilot, "rows 1-1 of 1", "$ fraexp list estimator=effective_input 'excitation.amplitude>20'")
        await pilot.press("enter")
        assert app.focused is table
        await pilot.press("escape")
        await shows(pilot, "rows 1-5 of 5", "$ fraexp list --sweeps")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_a_command_with_a_term_that_excludes_can_be_typed(workspace, capsys):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("slash")
        app.screen.line.value = "-estimator=effective_input"
        await until(pilot, lambda: table.filter == "-estimator=effective_input")
        await until(pilot, lambda: app.screen.command == "fraexp list -- -estimator=effective_input")
        table.order = "elapsed"
        await until(pilot, lambda: app.screen.command == "fraexp list --sort=elapsed -- -estimator=effective_input")

    pilot_of(workspace, steps)
    assert (
        main(["list", f"--workspace={workspace}", "--sort=elapsed", "--", "-estimator=effective_input"]) == ExitCode.OK
    )
    assert "conventional" in (printed := capsys.readouterr().out)
    assert "effective_input" not in printed


@pytest.mark.thorough
def test_what_is_wrong_with_a_filter_is_told_below_it_and_the_rows_stay(workspace):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("slash")
        app.screen.line.value = "estimato=effective_input"  # letter by letter, its beginnings would be tried
        await shows(pilot, "nothing in the database has 'estimato'; did you mean 'estimator'?", "rows 1-5 of 5")
        assert len(table.keys) == 5
        await pilot.press("escape")
        await until(pilot, lambda: "did you mean" not in screen_text(app))

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_names_of_fields_and_tags_are_completed(workspace, keys):
    with Store.open(str(workspace / "results.db")) as store:
        store.tag(keys[:2], "baseline")

    async def steps(app, pilot):
        await opened(app, pilot)
        await pilot.press("slash")
        await write(pilot, "excitation.amp")
        await shows(pilot, "excitation.amplitude")
        await pilot.press("tab")
        await write(pilot, "=12 tag:b")
        await shows(pilot, "tag:baseline")
        await pilot.press("tab")
        assert app.screen.line.value == "excitation.amplitude=12 tag:baseline"
        await shows(pilot, "rows 1-2 of 2")

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_rows_are_sorted_by_a_field_that_is_asked_for_and_turned(workspace):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("o")
        await shows(pilot, "Sort by sweep")
        await write(pilot, "nonsense")
        await shows(pilot, "there is no 'nonsense' to sort by")
        await pilot.press("enter")  # not by that
        app.screen.query_one(Input).value = "metric"
        await shows(pilot, "'metric' is ambiguous")
        app.screen.query_one(Input).value = ""
        await shows(pilot, "Sort by sweep, study, amplitude, estimator")
        await write(pilot, "amp")
        await pilot.press("tab")
        assert app.screen.query_one(Input).value == "amplitude"
        await pilot.press("enter")
        await shows(pilot, "amplitude [N] ▲", "rows 1-5 of 5, by excitation.amplitude", "--sort=excitation.amplitude")
        first = table.keys[0]
        await pilot.press("O")
        await shows(pilot, "amplitude [N] ▼")
        assert table.keys[0] != first

    pilot_of(workspace, steps, size=(110, 24))


def test_sweeps_are_marked_one_by_one_and_all_that_match(workspace, monkeypatch):
    monkeypatch.setattr(sweep_table, "MAX_UNCONFIRMED_MARKS", 3)

    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("space", "space", "up", "space")
        await settle(pilot)
        await shows(pilot, "1 marked")
        assert list(app.marks) == [table.keys[0]]
        assert "✓" in screen_text(app)
        await pilot.press("a")
        await shows(pilot, "Mark all 5 sweeps?")
        await pilot.press("n")
        await pilot.press("a")
        await shows(pilot, "Mark all 5 sweeps?")
        await pilot.press("y")
        await shows(pilot, "5 marked")
        await pilot.press("A")
        await until(pilot, lambda: "marked" not in screen_text(app).splitlines()[0])
        await pilot.press("slash")
        await write(pilot, "estimator=effective_input")
        await shows(pilot, "rows 1-2 of 2")
        await pilot.press("enter", "a")
        await shows(pilot, "2 marked")
        assert set(app.marks) == set(table.keys)

    pilot_of(workspace, steps)


@pytest.mark.thorough
def test_marked_sweeps_are_tagged_and_untagged(workspace):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("space", "space", "t")
        await shows(pilot, "Tag for 2 sweeps (one word)?")
        await write(pilot, "my tag")
        await shows(pilot, "'my tag' is not a tag")
        await pilot.press("ctrl+u")
        await write(pilot, "good")
        await pilot.press("enter")
        await shows(pilot, "tags", "good")
        with Store.open(str(workspace / "results.db")) as store:
            assert store.tags() == {"good": 2}
            assert set(store.keys("tag:good")) == set(table.keys[:2])
        await pilot.press("T")
        await shows(pilot, "Remove which tag from 2 sweeps?")
        await write(pilot, "good")
        await pilot.press("enter")
        await until(pilot, lambda: " tags " not in screen_text(app))

    pilot_of(workspace, steps, size=(110, 24))


def test_deletion_says_what_is_lost_and_happens_only_if_confirmed(workspace, keys):
    with Store.open(str(workspace / "results.db")) as store:
        store.tag(keys, "precious")

    async def steps(app, pilot):
        table = await opened(app, pilot)
        await pilot.press("space", "space", "D")
        await shows(pilot, "Delete 2 sweeps with results", "tagged precious")
        await pilot.press("enter")
        await until(pilot, lambda: app.screen.PLACE == "sweeps")
        assert table.total == 5
        gone = set(app.marks)
        await pilot.press("D")
        await shows(pilot, "Delete 2 sweeps with results")
        await pilot.press("y")
        await shows(pilot, "rows 1-3 of 3")
        assert not gone & set(table.keys)
        assert not list(app.marks)

    pilot_of(workspace, steps)


def test_the_question_counts_what_the_filter_hides_and_u_brings_back_what_was_deleted(workspace):
    async def steps(app, pilot):
        table = await opened(app, pilot)
        everything = set(table.keys)
        await pilot.press("a", "slash", *"conventional", "enter")
        await shows(pilot, "rows 1-2 of 2")
        await pilot.press("D")
        await shows(pilot, "Delete 5 sweeps, 3 of them hidden by the filter, with results")
        await pilot.press("y")
        await shows(pilot, "No sweep matches conventional")
        await pilot.press("u")
        await shows(pilot, "rows 1-2 of 2")
        await pilot.press("slash", "escape")
        await until(pilot, lambda: set(table.keys) == everything)
        await pilot.press("slash", *"conventional", "enter")
        await shows(pilot, "rows 1-2 of 2")
        await pilot.press("a", "D")
        await shows(pilot, "Delete 2 sweeps with results")

    pilot_of(workspace, steps)
