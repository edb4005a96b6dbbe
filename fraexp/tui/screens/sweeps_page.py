"""All sweeps of the database: filtered, sorted, marked."""

import shlex
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.timer import Timer
from textual.widgets import Input, Static

from fraexp.figures.elements.labels import printable
from fraexp.store import shown
from fraexp.tui.widgets.filter_input import EXAMPLE, SweepFilter
from fraexp.tui.widgets.sweep_table import PagedTable, SweepTable
from fraexp.tui.widgets.tagging import CuratingPage

PAUSE = 0.15
"""Seconds without a key after which a filter that is being written is tried."""


class SweepsPage(CuratingPage):
    """The sweeps of all runs, newest first."""

    PLACE: ClassVar[str] = "sweeps"
    HELP: ClassVar[str] = f"""
All sweeps in the database, newest first. A sweep is one estimate of one experiment; the same sweep in several runs \
is stored, and listed, once. Mark some with Space, here or in a run, and compare them with c.

The filter's terms must all hold:
  {EXAMPLE}
Fields are the columns, tag, note, run, every parameter's path, and metric.NAME; after them comes one of \
= != >= <= > < or : for text that is contained. A number may have a unit (loop.resolution<=1um). -TERM is what shall \
not be. A word alone is searched everywhere. Tab completes names.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "filter", id="filter", tooltip="write what sweeps must be like"),
    ]
    AUTO_FOCUS: ClassVar[str | None] = "SweepTable"
    DEFAULT_CSS = """
    SweepsPage SweepFilter { height: 1; padding: 0 1; }
    SweepsPage .wrong { height: auto; padding: 0 1; color: $text-error; display: none; }
    SweepsPage .wrong.-shown { display: block; }
    """

    _typed: Timer | None = None

    def body(self) -> ComposeResult:
        """Show the filter, and below it what it lets through."""
        yield SweepFilter()
        yield Static(classes="wrong")
        yield SweepTable(tells=False)

    @property
    def table(self) -> SweepTable:
        """The sweeps."""
        return self.query_one(SweepTable)

    @property
    def line(self) -> SweepFilter:
        """The filter."""
        return self.query_one(SweepFilter)

    def current(self) -> str | None:
        """Return the key of the sweep under the cursor."""
        return self.table.key

    async def load(self) -> None:
        """Show the sweeps, or why there are none."""
        self._command()
        if self.app.desk.workspace.has_database():
            if not self.table.display:  # something was wrong: what is read is not shown before it can be read
                if await self.fetch(self.app.desk.read(lambda store: store.page("", "", 0, 1))) is None:
                    return
                self.tell()
            self._show_rest(True)
            self.call_after_refresh(self.table.reload)
        else:
            self._show_none()

    def _show_none(self) -> None:
        self._show_rest(False)
        self.tell(
            f"There is no database yet: {shown(self.app.desk.workspace.database)}\n\n"
            "The first run makes it. Press s for the studies; the quick one takes seconds."
        )

    @on(PagedTable.Shown)
    def _shown(self, event: PagedTable.Shown) -> None:
        wrong = self.query_one(".wrong", Static)
        about_filter = event.error.startswith(("filter", "order"))
        wrong.update(Text(printable(event.error)))
        wrong.set_class(about_filter, "-shown")
        if event.error and not self.app.desk.workspace.has_database():
            self._show_none()
            return
        if event.error and not about_filter:
            self._show_rest(False)
            self.tell_error(event.error)
            return
        self._show_rest(True)
        if event.total or event.error:
            self.tell()
        elif self.table.filter:
            self.tell(f"No sweep matches {self.table.filter}\n\nEsc clears the filter, / changes it.")
        else:
            self.tell("The database has no sweep yet. Press s for the studies: a run makes sweeps.")
        self._command()

    def _show_rest(self, shown: bool) -> None:
        self.line.display = self.table.display = shown
        if shown and self.focused is None:
            self.table.focus()

    def _command(self) -> None:
        text, order = self.table.filter.strip(), self.table.order
        terms = [text] if '"' in text else text.split()
        options = [f"--order={order}"] if order else []
        options += ["--"] if terms and terms[0].startswith("-") else []  # a term that excludes is no option
        self.command = shlex.join(["fraexp", "list", *options, *(terms or ["--sweeps"])])

    async def action_filter(self) -> None:
        """Write a filter."""
        self.line.focus()
        known = await self.fetch(self.app.desk.read(lambda store: (store.fields(), store.tags())), lambda _: None)
        if known:
            self.line.fields.know(*known)

    @on(Input.Changed)
    def _changed(self, event: Input.Changed) -> None:
        if self._typed:
            self._typed.stop()
        self._typed = self.set_timer(PAUSE, self._apply)

    @on(Input.Submitted)
    def _submitted(self, event: Input.Submitted) -> None:
        self._apply()
        self.table.focus()

    def _apply(self) -> None:
        if self._typed:
            self._typed.stop()
        self._typed = None
        self.table.filter = self.line.value
        self._command()

    def action_back(self) -> None:
        """Leave the filter, clear it, or go one layer back."""
        if self.line.value:
            self.line.value = ""
            self._apply()
            self.table.focus()
        elif self.focused is self.line:
            self.table.focus()
        else:
            super().action_back()

    @on(SweepTable.Opened)
    def _opened(self, event: SweepTable.Opened) -> None:
        from fraexp.tui.screens.sweep_page import SweepPage

        self.app.push_screen(SweepPage(event.key))
