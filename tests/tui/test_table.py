"""A table of which only the page that is seen exists."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from textual.app import App, ComposeResult
from textual.events import MouseScrollDown
from textual.pilot import Pilot

from fraexp.errors import StoreError
from fraexp.tui.widgets.paged_table import PagedTable, TableRows
from fraexp.views.listing import Column
from tests.tui.pilots import screen_text, until


class Numbers(PagedTable):
    """Rows with numbers, from somewhere slow."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.names = [f"row {number}" for number in range(count)]
        self.wrong = ""

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        await asyncio.sleep(0.02)
        if self.wrong:
            raise StoreError(self.wrong)
        names = tuple(self.names[first : first + most])
        return TableRows(names, [Column("name", names)], len(self.names))

    def is_marked(self, key: str) -> bool:
        return False


class Alone(App[None]):
    def __init__(self, count: int) -> None:
        super().__init__()
        self.table = Numbers(count)

    def compose(self) -> ComposeResult:
        yield self.table


def drive(count: int, steps: Callable[[Numbers, Pilot[None]], Awaitable[None]]) -> None:
    async def run() -> None:
        app = Alone(count)
        async with app.run_test(size=(40, 12)) as pilot:
            await until(pilot, lambda: app.table.keys or "loading" not in str(app.table.border_subtitle))
            await steps(app.table, pilot)

    asyncio.run(run())


async def comes_to(pilot: Pilot[None], table: Numbers, key: str, rows: str) -> None:
    await until(pilot, lambda: table.key == key and rows in screen_text(pilot.app))


def test_as_many_rows_as_fit_are_shown_and_counted():
    async def steps(table, pilot):
        assert len(table.keys) == 10  # of 12 lines one is the header and one tells the position
        await comes_to(pilot, table, "row 0", "rows 1-10 of 1,000")
        assert "row 9 " in screen_text(pilot.app)
        assert "row 10" not in screen_text(pilot.app)

    drive(1000, steps)


def test_the_cursor_turns_the_page_at_its_edges():
    async def steps(table, pilot):
        await pilot.press("up")
        await comes_to(pilot, table, "row 0", "rows 1-10")
        await pilot.press(*["down"] * 9)
        await comes_to(pilot, table, "row 9", "rows 1-10")
        await pilot.press("j")
        await comes_to(pilot, table, "row 10", "rows 11-20")
        await pilot.press("k")
        await comes_to(pilot, table, "row 9", "rows 1-10")

    drive(100, steps)


def test_pages_and_ends_are_reached_by_keys():
    async def steps(table, pilot):
        for key, row, rows in [
            ("pagedown", "row 10", "rows 11-20"),
            ("l", "row 20", "rows 16-25"),
            ("G", "row 24", "rows 16-25 of 25"),
            ("pagedown", "row 24", "rows 16-25"),
            ("pageup", "row 14", "rows 6-15"),
            ("pageup", "row 4", "rows 1-10"),
            ("pageup", "row 0", "rows 1-10"),
            ("end", "row 24", "rows 16-25"),
            ("g", "row 0", "rows 1-10"),
        ]:
            await pilot.press(key)
            await comes_to(pilot, table, row, rows)

    drive(25, steps)


@pytest.mark.thorough
def test_a_key_that_is_held_skips_nothing_while_pages_are_read():
    async def steps(table, pilot):
        await pilot.press(*["down"] * 37)
        await until(pilot, lambda: table.key == "row 37")
        await pilot.press(*["pagedown"] * 5)
        await until(pilot, lambda: table.key == "row 87")

    drive(100, steps)


def test_the_cursor_stays_on_its_row_when_others_come_before_it_and_go():
    async def steps(table, pilot):
        await pilot.press("pagedown", "down", "down")
        await comes_to(pilot, table, "row 12", "rows 11-20 of 100")
        table.names[:0] = [f"new {number}" for number in range(25)]
        table.reload()
        await comes_to(pilot, table, "row 12", "rows 36-45 of 125")
        table.names.remove("row 12")
        table.reload()
        await until(pilot, lambda: table.total == 124)
        assert table.key == "row 13"
        del table.names[20:]
        table.reload()
        await comes_to(pilot, table, "new 19", "rows 11-20 of 20")

    drive(100, steps)


def test_another_size_shows_other_rows_and_keeps_the_cursor():
    async def steps(table, pilot):
        await pilot.press("pagedown", "down")
        await comes_to(pilot, table, "row 11", "rows 11-20")
        await pilot.resize_terminal(40, 22)
        await comes_to(pilot, table, "row 11", "rows 11-30 of 100")
        await pilot.resize_terminal(40, 8)
        await comes_to(pilot, table, "row 11", "rows 11-16 of 100")

    drive(100, steps)


def test_what_is_wrong_is_told_and_the_rows_stay():
    async def steps(table, pilot):
        table.wrong = "the database is \x1b[31mgone"
        table.reload()
        await until(pilot, lambda: r"the database is \x1b[31mgone" in screen_text(pilot.app))
        assert table.keys[0] == "row 0"
        table.wrong = ""
        table.reload()
        await until(pilot, lambda: "rows 1-10" in screen_text(pilot.app))

    drive(100, steps)


def test_a_table_without_rows_says_so_and_bears_all_keys():
    async def steps(table, pilot):
        await pilot.press("down", "up", "pagedown", "pageup", "G", "g", "enter")
        assert table.key is None
        assert "no rows" in screen_text(pilot.app)

    drive(0, steps)


def test_the_mouse_wheel_moves_the_cursor():
    async def steps(table, pilot):
        table.post_message(MouseScrollDown(table, 2, 3, 0, 1, 0, False, False, False))
        await until(pilot, lambda: table.key == "row 3")

    drive(100, steps)
