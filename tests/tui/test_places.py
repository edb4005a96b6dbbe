"""The keys of the places, and messages, on whatever screen."""

import pytest
from textual.widgets._toast import Toast

from fraexp.errors import StoreError
from fraexp.tui.page import MAX_MESSAGE_LENGTH, shorten
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.screens.runs_page import RunsPage
from fraexp.tui.screens.sweep_page import SweepPage
from fraexp.tui.screens.sweeps_page import SweepsPage
from fraexp.tui.services.database_access import Backend
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused
from tests.tui.pilots import pilot_of, screen_text, shows, until

SECRET = "postgresql://somebody:hunter2@host/lab"


@pytest.mark.thorough
def test_a_places_key_leads_to_its_list_from_within_and_from_elsewhere(workspace):
    async def steps(app, pilot):
        await pilot.press("w")
        await shows(pilot, "rows 1-5")
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, SweepPage))
        await pilot.press("w", "j")
        assert isinstance(app.screen, SweepsPage)
        await until(pilot, lambda: app.screen.table.cursor_row == 1)  # what follows is for the list
        await pilot.press("r")
        await until(pilot, lambda: isinstance(app.screen, RunsPage) and app.screen.items)
        await shows(pilot, "failing")
        await pilot.press("enter")
        await until(pilot, lambda: isinstance(app.screen, RunPage))
        await pilot.press("s", "r")
        assert isinstance(app.screen, RunsPage)
        await shows(pilot, "failing", "$ fraexp list")

    pilot_of(workspace, steps)


def test_one_message_at_a_time_stands_above_what_is_drawn(workspace):
    async def steps(app, pilot):
        await shows(pilot, "quick")
        app.notify("the first", timeout=60)
        app.notify("the second", timeout=60)
        await shows(pilot, "the second")
        assert "the first" not in screen_text(app)
        (toast,) = app.screen.query(Toast)
        assert toast.region.bottom <= 5

    pilot_of(workspace, steps, notices=True)


def test_long_values_are_cut_in_what_is_told():
    assert shorten(f"points is '{'x' * 100_000}'; expected a number").startswith("points is 'xxx")
    assert len(shorten(f"points is '{'x' * 100_000}'; expected a number")) < 120
    assert shorten(f"points is '{'x' * 100_000}'; expected a number").endswith("...'; expected a number")
    assert len(shorten("[1, " * 10_000)) <= MAX_MESSAGE_LENGTH + 3
    assert shorten("it's 'short', isn't it") == "it's 'short', isn't it"


def test_no_password_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(WorkspaceService, "has_database", lambda _: False)
    desk = Backend(tmp_path, SECRET)
    for asked in (desk._read_store, desk._write_store):
        with refused(StoreError, "database") as raised:
            asked(lambda store: store.version())
        assert "hunter2" not in str(raised.value)
    desk.close()


@pytest.mark.thorough
def test_a_database_that_is_damaged_and_restored_in_its_place_is_noticed(workspace):
    file = workspace / "results.db"
    good, right = file.read_bytes(), "rows 1-5"

    async def steps(app, pilot):
        await pilot.press("w")
        await shows(pilot, right)
        for damage in (good[:100] + b"damage" * 20_000, b"damage" * 20_000):
            file.write_bytes(damage)
            for beside in ("-wal", "-shm"):
                file.with_name(f"{file.name}{beside}").unlink(missing_ok=True)
            await until(pilot, lambda: any(t in screen_text(app) for t in ("is damaged", "this is not a database")))
            await until(pilot, lambda: right not in screen_text(app))
            assert "no sweeps yet" not in screen_text(app)
            file.write_bytes(good)
            await shows(pilot, right)

    pilot_of(workspace, steps)
