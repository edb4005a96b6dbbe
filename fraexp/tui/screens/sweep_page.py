"""One sweep: what came out, point by point, with which parameters, and where it is from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.events import DescendantFocus
from textual.widgets import Static, TabbedContent, TabPane

from fraexp.data.results import Result
from fraexp.figures.elements.labels import label_text, printable
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.tui.widgets.point_table import PointsTable
from fraexp.tui.widgets.tagging import CuratingPage
from fraexp.views.listing import state_text
from fraexp.views.resolved_parameters import Resolved, resolved_parameters
from fraexp.views.words import duration, moment, short

SECTIONS = {
    "result": "Result",
    "points": "Points",
    "parameters": "Parameters",
    "provenance": "Provenance",
    "log": "Log",
}
READING = "reading ..."
WIDE = 110
"""Columns from which on parameters are a table."""


@dataclass(frozen=True)
class SweepDetails:
    """What the database has of a sweep."""

    sweep: StoredSweep
    result: Result | None
    log: str
    computed_by: RunSummary | None
    latest: RunSummary | None


class Section(VerticalScroll):
    """Text that may be longer than the screen."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "scroll_down", "down", show=False, id="section.down", tooltip="a line down"),
        Binding("k", "scroll_up", "up", show=False, id="section.up", tooltip="a line up"),
        Binding("g", "scroll_home", "top", show=False, id="section.top", tooltip="to the top"),
        Binding("G", "scroll_end", "end", show=False, id="section.end", tooltip="to the end"),
    ]

    def compose(self) -> ComposeResult:
        """Show that there will be something."""
        yield Static(READING)

    def put(self, *parts: RenderableType) -> None:
        """Show texts and tables, one below the other."""
        self.query_one(Static).update(Group(*parts))


class Pane(TabPane):
    """A section's place, which is not turned to by the focus: that follows the section, and may be late."""

    def on_descendant_focus(self, event: DescendantFocus) -> None:
        """Leave out what the toolkit does."""
        event.prevent_default()


class SweepPage(CuratingPage):
    """All that is known of one sweep."""

    PLACE: ClassVar[str] = "sweeps"
    HELP: ClassVar[str] = """
One sweep: one estimate of one experiment. Digits lead to its sections. Parameters tell their unit and where a value \
is from: the study's grid, the study or its machine, a default, or another parameter. Provenance tells whether the \
plugins that computed it are still the same.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "mark", "mark", id="sweep.mark", tooltip="mark the sweep, or take its mark away"),
        Binding("c", "compare", "compare", id="sweep.compare", tooltip="compare it with the marked sweeps"),
        *(
            Binding(str(index), f"section('{name}')", title, show=False, id=f"sweep.{name}", tooltip=f"section {title}")
            for index, (name, title) in enumerate(SECTIONS.items(), 1)
        ),
        Binding("right_square_bracket", "turn(1)", "section", id="sweep.next", tooltip="next section"),
        Binding("left_square_bracket", "turn(-1)", "back", show=False, id="sweep.before", tooltip="section before"),
    ]
    DEFAULT_CSS = """
    SweepPage #top { height: auto; max-height: 10; }
    SweepPage #summary { width: 1fr; height: auto; padding: 0 1; }
    SweepPage #bode { display: none; width: 1fr; height: 16; }
    SweepPage.-wide.-high #top { max-height: 16; }
    SweepPage.-wide.-high #bode.-drawn { display: block; }
    SweepPage TabbedContent { height: 1fr; }
    SweepPage TabPane { padding: 0 1; }
    SweepPage Section { height: 1fr; }
    """

    def __init__(self, key: str) -> None:
        super().__init__()
        self.key = key
        self._found: SweepDetails | None = None
        self._parameters: list[Resolved] = []

    def body(self) -> ComposeResult:
        """Show a summary, a small plot where there is room, and sections."""
        from fraexp.tui.plotting.plot_stack import BodeView

        with Horizontal(id="top"):
            yield Static(READING, id="summary")
            yield BodeView(id="bode")
        with TabbedContent():
            for index, (name, title) in enumerate(SECTIONS.items(), 1):
                with Pane(f"{index} {title}", id=name):
                    yield PointsTable() if name == "points" else Section(id=f"{name}-text")

    def current(self) -> str:
        """Return the sweep's key."""
        return self.key

    def chosen(self) -> list[str]:
        """Return this sweep alone: others are not seen here."""
        return [self.key]

    def gone(self) -> None:
        """Leave: the sweep is not there any more."""
        self.action_back()

    async def load(self) -> None:
        """Read the sweep, show it, and then what its plugins tell."""
        self.heading = f"sweep {short(self.key)}"
        self._command()
        found = await self.fetch(self.app.desk.read(self._read), self._lost)
        if found is None or found == self._found:
            return
        self.tell()
        self._rest(True)
        self._found = found
        self._show(found)
        await self._show_points(found)
        await self._show_parameters(found)

    def _read(self, store: Store) -> SweepDetails:
        from fraexp.views.origin import runs_of

        sweep, before = store.find(self.key), self._found
        if before and before.sweep == sweep:
            return before  # nothing that is shown has changed
        return SweepDetails(
            sweep, store.results([sweep.key]).get(sweep.key), store.log(sweep.key), *runs_of(store, sweep)
        )

    def _lost(self, text: str) -> None:
        self._rest(False)
        self._found = None
        self.tell_error(text)

    def _rest(self, shown: bool) -> None:
        self.query_one("#top").display = self.query_one(TabbedContent).display = shown

    def _show(self, found: SweepDetails) -> None:
        self.query_one("#summary", Static).update(_summary(found.sweep))
        self.query_one("#result-text", Section).put(*_result_parts(found.result))
        log = [printable(line) for line in found.log.splitlines()]
        self.query_one("#log-text", Section).put(Text("\n".join(log) or "There is no log: the attempt did not fail."))

    async def _show_points(self, found: SweepDetails) -> None:
        from fraexp.tui.plotting.plot_stack import BodeView
        from fraexp.views.text_tables import response_table

        response = found.result.response if found.result else None
        table, bode = self.query_one(PointsTable), self.query_one(BodeView)
        self.query_one(TabbedContent).get_tab("points").disabled = response is None
        bode.set_class(response is not None, "-drawn")
        if response is None:
            table.put([], [])
            return
        bode.show([(short(self.key), response)])
        columns, rows, _ = await self.here(self.app.desk.work(lambda _: response_table(response, None)))
        table.put(columns, rows)

    async def _show_parameters(self, found: SweepDetails) -> None:
        from fraexp.views.origin import provenance_fields, sources_now

        sweep = found.sweep
        rows, sources = await self.here(
            self.app.desk.work(
                lambda workspace: (
                    resolved_parameters(sweep, workspace.registry),
                    sources_now(sweep, workspace.registry),
                )
            )
        )
        self._parameters = rows
        self._put_parameters()
        run, latest = found.computed_by, found.latest
        parts: list[RenderableType] = [Text("computed by", style="bold")]
        parts += [_pairs(provenance_fields(run))] if run else [Text("  a run that is not in the database any more")]
        if latest and (run is None or latest.number != run.number):
            parts += [Text(f"latest in run {latest.number} of {printable(latest.study)}: {found.sweep.state}")]
        cells = [[of.component, of.distribution, of.source_hash, of.now] for of in sources]
        parts += [Text("\ncomponents", style="bold"), _table(["component", "from", "source", "now"], cells)]
        parts += [Text(f"\nkey {sweep.key}")]
        self.query_one("#provenance-text", Section).put(*parts)

    def _put_parameters(self) -> None:
        rows, section = self._parameters, self.query_one("#parameters-text", Section)
        if self.size.width < WIDE:
            section.put(*(line for row in rows for line in _parameter_lines(row)))
            return
        cells = [[row.path, row.value, row.unit, row.origin, row.meaning] for row in rows]
        section.put(_table(["parameter", "value", "unit", "from", "meaning"], cells, bold=1))

    def on_resize(self) -> None:
        """Show parameters as there is room for them."""
        if self._parameters:
            self._put_parameters()

    def _command(self) -> None:
        section = self.query_one(TabbedContent).active
        self.command = f"fraexp show {short(self.key)}" + (" --points" if section == "points" else "")

    def on_tabbed_content_tab_activated(self, event: TabbedContent.TabActivated) -> None:
        """Let keys scroll the section that is seen now."""
        self._command()
        inside = event.pane.query("PointsTable, Section")
        if inside and event.pane.id == event.tabbed_content.active:
            inside.first().focus()

    def action_section(self, name: str) -> None:
        """Show a section."""
        tabs = self.query_one(TabbedContent)
        if not tabs.get_tab(name).disabled:
            tabs.active = name

    def action_turn(self, step: int) -> None:
        """Show the next section, or the one before."""
        tabs = self.query_one(TabbedContent)
        names = [name for name in SECTIONS if not tabs.get_tab(name).disabled]
        tabs.active = names[(names.index(tabs.active) + step) % len(names)]

    def action_mark(self) -> None:
        """Mark the sweep, or take its mark away."""
        self.app.marks.toggle(self.key)
        self.head()

    def action_compare(self) -> None:
        """Compare the sweep with the marked ones."""
        self.app.marks.add([self.key])
        self.app.action_place("compare")


def _summary(sweep: StoredSweep) -> Text:
    text = Text(state_text(sweep), style="bold")
    for label, value in sweep.labels.items():
        text.append(f"\n{printable(label)} = {printable(label_text(value))}", style="none")
    if sweep.created:
        text.append(f"\ncomputed {moment(sweep.created)} in {duration(sweep.elapsed)}", style="none")
    told = {"message": sweep.message, "remedy": sweep.outcome.value if sweep.outcome else ""}
    told |= {"tags": " ".join(sweep.tags), "note": sweep.note}
    for name, value in told.items():
        if value:
            text.append(f"\n{name} ", style="bold")
            text.append(printable(value), style="none")
    return text


def _parameter_lines(row: Resolved) -> Iterable[RenderableType]:
    text = Text(f"{printable(row.path)} = ")
    text.append(printable(f"{row.value} {row.unit}".rstrip()), style="bold")
    text.append(f"  from {printable(row.origin)}" if row.origin else "", style="dim")
    yield text
    if row.meaning:
        yield Padding(Text(printable(row.meaning), style="dim"), (0, 0, 0, 4))


def _result_parts(result: Result | None) -> Iterable[RenderableType]:
    from fraexp.views.result_rows import FIT_COLUMNS, curve_text, fit_rows, fit_section, metric_fields

    if result is None:
        yield Text("There is no result; the summary above and the log tell why.")
        return
    if result.metrics:
        yield Text("metrics", style="bold")
        yield _pairs(metric_fields(result))
    for fit in result.fits:
        yield Text(f"\nfit of the {printable(fit.kind)}", style="bold")
        yield _table(FIT_COLUMNS, fit_rows(fit))
        yield Text("\n".join(["", *map(printable, fit_section(fit))]))
    if result.curves:
        yield Text("\ncurves", style="bold")
        yield Text("\n".join(f"  {printable(curve_text(curve))}" for curve in result.curves))
    if result.numerics:
        yield Text(f"\nnumerics {printable(result.numerics)}")
    if result.response is not None and not result.fits:
        yield Text("\nA plant model is fitted to the response by: fraexp fit KEY")


def _pairs(pairs: Sequence[tuple[str, str]]) -> Table:
    return _table(None, [[f"  {name}", value] for name, value in pairs if value])


def _table(titles: Sequence[str] | None, rows: Sequence[Sequence[str]], bold: int | None = None) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=titles is not None, header_style="bold")
    for index in range(len(titles or rows[0] if rows else titles or ())):
        title = Text(titles[index]) if titles else ""
        table.add_column(title, overflow="fold", style="bold" if index == bold else "")
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    return table
