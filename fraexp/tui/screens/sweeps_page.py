"""All sweeps in the database: filter, sort and mark."""

import asyncio
import shlex
from collections.abc import Iterable, Mapping
from typing import ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.suggester import Suggester
from textual.widgets import DataTable, Static

from fraexp.data.results import Outcome
from fraexp.data.texts import printable
from fraexp.store import masked_url
from fraexp.store.queries.filters import OPERATORS
from fraexp.store.queries.known_names import METRIC_PREFIX
from fraexp.tui.widgets.filter_line import FilteredPage, FilterLine
from fraexp.tui.widgets.paged_table import PagedTable
from fraexp.tui.widgets.preview_plot import SidePreview, selected_sweep
from fraexp.tui.widgets.sweep_table import SweepTable
from fraexp.tui.widgets.tagging import TaggingPage

FILTER_EXAMPLE = "estimator=effective_input excitation.amplitude>=12 state:unusable tag:baseline"
FIELD_VALUES = {
    "state": ("computed", "failed", "pending", "reused", "unusable"),
    "outcome": tuple(outcome.name.lower() for outcome in Outcome),
}


class _FieldSuggester(Suggester):
    """Completes the last term of a filter."""

    def __init__(self) -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self.names: Iterable[str] = ()
        self.values: Mapping[str, Iterable[str]] = FIELD_VALUES

    def know(self, names: Iterable[str], tags: Iterable[str]) -> None:
        """Set the known fields and tags; the headings of fields, their last parts, complete as well."""
        known = tuple(names)
        headings = (name.rpartition(".")[2] for name in known if not name.startswith(METRIC_PREFIX))
        self.names = tuple(dict.fromkeys([*known, *headings]))
        self.values = {**FIELD_VALUES, "tag": tuple(tags)}

    async def get_suggestion(self, value: str) -> str | None:
        """Return the filter with its last term completed; None without a match."""
        term = value.rpartition(" ")[2]
        sign = next((sign for sign in OPERATORS if sign in term), "")
        if sign:
            field, _, begun = term.removeprefix("-").partition(sign)
            options = self.values.get(field, ())
        else:
            begun, options = term.removeprefix("-"), self.names
        found = next((option for option in options if begun and option.startswith(begun) and option != begun), None)
        return value + found[len(begun) :] if found else None


FILTER_DELAY_S = 0.15
"""Seconds without a key after which the filter is applied."""


class SweepsPage(FilteredPage, TaggingPage):
    """The sweeps of all runs, newest first."""

    PLACE: ClassVar[str] = "sweeps"
    HELP: ClassVar[str] = f"""
All sweeps in the database, newest first. A sweep is one estimate of one experiment; a sweep in several runs is stored \
and listed once. Mark sweeps with Space, here or in a run, and compare them with c.

All terms of the filter must match:
  {FILTER_EXAMPLE}
Fields are the columns, tag, run, the path of any parameter, and metric.NAME, followed by one of \
= != >= <= > < or : (contains). A number may have a unit (loop.resolution<=1um). -TERM excludes matches. A single word \
is searched in all fields. Tab completes names.
"""
    BINDINGS: ClassVar[list[BindingType]] = [Binding("slash", "filter", "filter", tooltip="edit the filter")]
    AUTO_FOCUS: ClassVar[str | None] = "SweepTable"
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (150, "-wide")]  # noqa: RUF012 - as Textual declares it

    def body(self) -> ComposeResult:
        """Show the filter above the matching sweeps."""
        yield FilterLine(f"/ filter: {FILTER_EXAMPLE}", _FieldSuggester(), stays=True)
        yield Static(classes="wrong")
        with Horizontal(id="split"):
            yield SweepTable(shows_errors=False)
            yield SidePreview()

    @property
    def table(self) -> SweepTable:
        """The sweeps."""
        return self.query_one(SweepTable)

    def current(self) -> str | None:
        """Return the key of the sweep under the cursor."""
        return self.table.key

    def filter_text(self) -> str:
        """Return the filter, which may hide marked sweeps."""
        return self.table.filter

    async def load(self) -> None:
        """Show the sweeps, or why there are none."""
        self._command()
        if self.app.backend.workspace.has_database():
            if not self.table.display:  # after an error, show the table only when reading works again
                if await self.read(lambda store: store.page("", "", 0, 1)) is None:
                    return
                self.show_notice()
            self._show_content(True)
            self.call_after_refresh(self.table.reload)
        else:
            self._show_none()

    def _show_none(self) -> None:
        self._show_content(False)
        self.show_notice(
            f"There is no database yet: {masked_url(self.app.backend.workspace.database)}\n\n"
            "The first run creates it. Press s for the studies; 'quick' takes seconds."
        )

    @on(PagedTable.Shown)
    @on(DataTable.RowHighlighted)
    def _preview(self) -> None:
        key, workspace = self.table.key, self.app.backend.workspace
        if key:
            self.query_one(SidePreview).select(lambda store: selected_sweep(store, key, workspace.registry))

    @on(PagedTable.Shown)
    def _handle_page(self, event: PagedTable.Shown) -> None:
        wrong = self.query_one(".wrong", Static)
        about_filter = event.error.startswith(("filter", "order"))
        wrong.update(Text(printable(event.error)))
        wrong.set_class(about_filter, "-shown")
        if event.error and not self.app.backend.workspace.has_database():
            self._show_none()
            return
        if event.error and not about_filter:
            self._show_content(False)
            self.show_error(event.error)
            return
        self._show_content(True)
        if event.total or event.error:
            self.show_notice()
        elif self.table.filter:
            self.show_notice(f"No sweep matches {self.table.filter}\n\nEsc clears the filter, / changes it.")
        else:
            self.show_notice("The database has no sweeps yet. Press s for the studies; a run creates sweeps.")
        self._command()

    def _show_content(self, shown: bool) -> None:
        self.line.display = self.table.display = shown
        if shown and self.focused is None:
            self.table.focus()

    def _command(self) -> None:
        text, order = self.table.filter.strip(), self.table.order
        terms = [text] if '"' in text else text.split()
        options = [f"--sort={order}"] if order else []
        options += ["--"] if terms and terms[0].startswith("-") else []  # an excluding term is not an option
        self.command = shlex.join(["fraexp", "list", *options, *(terms or ["--sweeps"])])

    async def action_filter(self) -> None:
        """Edit the filter."""
        await super().action_filter()
        known = await self.read(lambda store: (store.fields(), store.tags()), lambda _: None)
        if known and isinstance(fields := self.line.suggester, _FieldSuggester):
            fields.know(*known)

    @work(group="filter", exclusive=True)
    async def filter_rows(self) -> None:
        """Show the sweeps that match the filter, once no key follows."""
        await asyncio.sleep(FILTER_DELAY_S)
        self._apply_filter()

    @on(FilterLine.Left)
    def _apply_filter(self) -> None:
        """Show the sweeps that match the filter."""
        self.table.filter = self.line.value
        self._command()

    @on(SweepTable.Opened)
    def _open_sweep(self, event: SweepTable.Opened) -> None:
        from fraexp.tui.screens.sweep_page import SweepPage

        self.app.push_screen(SweepPage(event.key))
