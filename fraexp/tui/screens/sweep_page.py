"""A sweep: its result, points, parameters, provenance and log."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text
from textual import work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.events import DescendantFocus
from textual.widgets import Static, TabbedContent, TabPane

from fraexp.components.registry import Registry
from fraexp.data.results import Result
from fraexp.data.texts import printable
from fraexp.store import RunSummary, Store, StoredSweep, mark_damaged
from fraexp.tui.page import ACTION_GROUP
from fraexp.tui.services.themes import state_sign
from fraexp.tui.widgets.figure_export import ask_and_export
from fraexp.tui.widgets.paged_table import PointsTable
from fraexp.tui.widgets.preview_plot import PreviewPlot
from fraexp.tui.widgets.tagging import TaggingPage
from fraexp.tui.widgets.text_section import READING_TEXT, TextSection
from fraexp.views.fields import remedy_text, run_fields, sweep_labels
from fraexp.views.listing import state_text
from fraexp.views.resolved_parameters import ResolvedParameter, resolved_parameters
from fraexp.views.words import duration_text, short_key, timestamp_text

SECTIONS = {
    "result": "Result",
    "points": "Points",
    "parameters": "Parameters",
    "provenance": "Provenance",
    "log": "Log",
}
MIN_TABLE_WIDTH = 110
"""Minimum width of the screen for a table of parameters."""


@dataclass(frozen=True)
class SweepDetails:
    """A sweep with all its data in the database."""

    sweep: StoredSweep
    result: Result | None
    log: str
    computed_by: RunSummary | None
    latest: RunSummary | None


class SectionPane(TabPane):
    """The pane of a section, which the focus does not activate: it follows the section, and may be late."""

    def on_descendant_focus(self, event: DescendantFocus) -> None:
        """Prevent that Textual activates the pane."""
        event.prevent_default()


class SweepPage(TaggingPage):
    """A sweep with all its sections."""

    PLACE: ClassVar[str] = "sweeps"
    HELP: ClassVar[str] = """
A sweep is one estimate of one experiment. Digits open its sections. Parameters show the unit and the origin of each \
value: the grid of the study, the study or its machine, a default, or another parameter. Provenance shows whether the \
plugins that computed the sweep have changed since.
"""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "mark", "mark", tooltip="mark or unmark the sweep"),
        Binding("e", "export", "export", tooltip="export the result as CSV, JSON, MATLAB or HDF5"),
        Binding("c", "compare", "compare", tooltip="compare with the marked sweeps"),
        *(
            Binding(str(index), f"section('{name}')", title, show=False, tooltip=f"section {title}")
            for index, (name, title) in enumerate(SECTIONS.items(), 1)
        ),
        Binding("right_square_bracket", "turn(1)", "section", tooltip="next section"),
        Binding("left_square_bracket", "turn(-1)", "back", show=False, tooltip="previous section"),
    ]

    def __init__(self, key: str) -> None:
        super().__init__()
        self.key = key
        self._found: SweepDetails | None = None
        self._parameters: list[ResolvedParameter] = []

    def body(self) -> ComposeResult:
        """Show a summary, a small plot if there is room, and the sections."""
        with Horizontal(id="top"):
            yield Static(READING_TEXT, id="summary")
            yield PreviewPlot("Curves")
        with TabbedContent():
            for index, (name, title) in enumerate(SECTIONS.items(), 1):
                with SectionPane(f"{index} {title}", id=name):
                    yield PointsTable() if name == "points" else TextSection(id=f"{name}-text")

    def current(self) -> str:
        """Return the sweep's key."""
        return self.key

    def selected_keys(self) -> list[str]:
        """Return this sweep only, as no others are visible."""
        return [self.key]

    def handle_deletion(self) -> None:
        """Close the screen of the deleted sweep."""
        self.action_back()

    async def load(self) -> None:
        """Read the sweep and show it, then its parameters and sources."""
        self.heading = f"sweep {short_key(self.key)}"
        self._command()
        found = await self.read(self._read, self._show_loss)
        if found is None or found == self._found:
            return
        self.show_notice()
        self._show_content(True)
        self._found = found
        self._show(found)
        self.query_one(PreviewPlot).preview([self.key])
        await self._show_loop(found)
        await self._show_points(found)
        await self._show_parameters(found)

    def _read(self, store: Store) -> SweepDetails:
        sweep, before = store.find(self.key), self._found
        if before and before.sweep == sweep:
            return before  # nothing visible has changed
        results = store.results([sweep.key])
        (sweep,) = mark_damaged([sweep], results)
        return SweepDetails(
            sweep, results.get(sweep.key), store.log(sweep.key), *computing_and_latest_run(store, sweep)
        )

    def _show_loss(self, text: str) -> None:
        self._show_content(False)
        self._found = None
        self.show_error(text)

    def _show_content(self, shown: bool) -> None:
        self.query_one("#top").display = self.query_one(TabbedContent).display = shown

    def _show(self, found: SweepDetails) -> None:
        self.query_one("#summary", Static).update(_summary_text(found.sweep, self.app.backend.workspace.registry))
        self.query_one("#result-text", TextSection).show_parts(*_result_parts(self.key, found.result))
        log = [printable(line) for line in found.log.splitlines()]
        self.query_one("#log-text", TextSection).show_parts(Text("\n".join(log) or "no log, as the sweep did not fail"))

    async def _show_loop(self, found: SweepDetails) -> None:
        """Add bandwidth and margins of the loop to the result, if the sweep has a controller."""
        from fraexp.views.loop_margins_table import loop_margins, loop_rows

        if found.result is None or not found.sweep.experiment.get("controller"):
            return
        figures = await self.wait_for(
            self.app.backend.work(lambda workspace: loop_margins(found.sweep, found.result, workspace.registry))
        )
        self.query_one("#result-text", TextSection).show_parts(
            *_result_parts(self.key, found.result, loop_rows(figures))
        )

    async def _show_points(self, found: SweepDetails) -> None:
        from fraexp.views.text_tables import response_table

        response = found.result.response if found.result else None
        parities = found.result.parity_levels if found.result else {}
        table = self.query_one(PointsTable)
        self.query_one(TabbedContent).get_tab("points").disabled = response is None
        if response is None:
            table.show_points([], [])
            return
        columns, rows, _ = await self.wait_for(
            self.app.backend.work(lambda _: response_table(response, None, parities))
        )
        table.show_points(columns, rows)

    async def _show_parameters(self, found: SweepDetails) -> None:
        sweep = found.sweep
        rows, sources = await self.wait_for(
            self.app.backend.work(
                lambda workspace: (
                    resolved_parameters(sweep, workspace.registry),
                    source_states(sweep, workspace.registry),
                )
            )
        )
        self._parameters = rows
        self._put_parameters()
        run, latest = found.computed_by, found.latest
        parts: list[RenderableType] = [Text("computed by", style="bold")]
        parts += [_pair_table(provenance_fields(run))] if run else [Text("  a run that was deleted")]
        if latest and (run is None or latest.number != run.number):
            parts += [Text(f"latest in run {latest.number} of {printable(latest.study)}: {found.sweep.state}")]
        cells = [[of.component, of.distribution, of.source_hash, of.status] for of in sources]
        parts += [Text("\ncomponents", style="bold"), _table(["component", "from", "source", "now"], cells)]
        parts += [Text(f"\nkey {sweep.key}")]
        self.query_one("#provenance-text", TextSection).show_parts(*parts)

    def _put_parameters(self) -> None:
        rows, section = self._parameters, self.query_one("#parameters-text", TextSection)
        if self.size.width < MIN_TABLE_WIDTH:
            section.show_parts(*(line for row in rows for line in _parameter_lines(row)))
            return
        cells = [[row.path, row.value, row.unit, row.origin, row.meaning] for row in rows]
        section.show_parts(_table(["parameter", "value", "unit", "from", "meaning"], cells, bold=1))

    def on_resize(self) -> None:
        """Show parameters as a table or as lines, as the width allows."""
        if self._parameters:
            self._put_parameters()

    def _command(self) -> None:
        section = self.query_one(TabbedContent).active
        self.command = f"fraexp show {short_key(self.key)}" + (" --points" if section == "points" else "")

    def on_tabbed_content_tab_activated(self, event: TabbedContent.TabActivated) -> None:
        """Focus the visible section, so that keys scroll it."""
        self._command()
        inside = event.pane.query("PointsTable, TextSection")
        if inside and event.pane.id == event.tabbed_content.active:
            inside.first().focus()

    def action_section(self, name: str) -> None:
        """Show a section."""
        tabs = self.query_one(TabbedContent)
        if not tabs.get_tab(name).disabled:
            tabs.active = name

    def action_turn(self, step: int) -> None:
        """Show the next or previous section."""
        tabs = self.query_one(TabbedContent)
        names = [name for name in SECTIONS if not tabs.get_tab(name).disabled]
        tabs.active = names[(names.index(tabs.active) + step) % len(names)]

    def action_mark(self) -> None:
        """Mark or unmark the sweep."""
        self.app.marks.toggle(self.key)
        self.show_header()

    @work(group=ACTION_GROUP)
    async def action_export(self) -> None:
        """Export the result for other programs."""
        await ask_and_export(self.app, self.key)

    def action_compare(self) -> None:
        """Compare the sweep with the marked ones."""
        self.app.marks.add([self.key])
        self.app.action_place("compare")


def _summary_text(sweep: StoredSweep, registry: Registry) -> Content:
    state = state_text(sweep)
    sign, colour = state_sign(state)
    parts: list[str | tuple[str, str]] = [(f"{sign} {state}", f"bold ${colour}")]
    parts += [f"\n{printable(label)}" for label in sweep_labels(sweep, registry)]
    if sweep.created:
        parts.append(f"\ncomputed {timestamp_text(sweep.created)} in {duration_text(sweep.elapsed)}")
    told = {"tags": " ".join(sweep.tags), "message": sweep.message, "remedy": remedy_text(sweep)}
    for name, value in told.items():
        if value:
            parts += [(f"\n{name} ", "bold"), printable(value)]
    return Content.assemble(*parts)


def _parameter_lines(row: ResolvedParameter) -> Iterable[RenderableType]:
    text = Text(f"{printable(row.path)} = ")
    text.append(printable(row.quantity), style="bold")
    text.append(f"  from {printable(row.origin)}" if row.origin else "", style="dim")
    yield text
    if row.meaning:
        yield Padding(Text(printable(row.meaning), style="dim"), (0, 0, 0, 4))


def _result_parts(key: str, result: Result | None, loop: Sequence[Sequence[str]] = ()) -> Iterable[RenderableType]:
    from fraexp.views import result_rows
    from fraexp.views.loop_margins_table import LOOP_COLUMNS

    if result is None:
        yield Text("no result; the summary above and the log show the reason")
        return
    if result.metrics:
        yield Text("metrics", style="bold")
        yield _pair_table(result_rows.metric_fields(result))
    if loop:
        yield Text("\nloop", style="bold")
        yield _table(["", *LOOP_COLUMNS[1:]], loop)
    for fit in result.fits:
        yield Text(f"\nfit of the {printable(fit.kind)}", style="bold")
        yield _table(result_rows.FIT_COLUMNS, result_rows.fit_rows(fit))
        yield Text("\n".join(["", *map(printable, result_rows.fit_section(fit))]))
    if result.curves:
        yield Text("\ncurves", style="bold")
        tables = [(curve, *result_rows.curve_table(curve)) for curve in result.curves]
        longer = [curve for curve, _, points in tables if len(points) > result_rows.MAX_CURVE_ROWS]
        yield Text("\n".join(f"  {printable(result_rows.curve_text(curve))}" for curve in longer))
        for curve, heading, points in tables:
            if len(points) <= result_rows.MAX_CURVE_ROWS:
                yield Text(f"\n{printable(curve.name)}", style="bold")
                yield _table(heading, points)
    if result.numerics:
        yield Text(f"\nnumerics {printable(result.numerics)}")
    if result.response is not None and not result.fits:
        yield Text(f"\nTo fit a plant model to the response: fraexp fit {short_key(key)}")


def _pair_table(pairs: Sequence[tuple[str, str]]) -> Table:
    return _table(None, [[f"  {name}", value] for name, value in pairs if value])


def _table(titles: Sequence[str] | None, rows: Sequence[Sequence[str]], bold: int | None = None) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=titles is not None, header_style="bold")
    for index in range(len(titles or rows[0] if rows else titles or ())):
        title = Text(titles[index]) if titles else ""
        table.add_column(title, overflow="fold", style="bold" if index == bold else "")
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    return table


@dataclass(frozen=True)
class SourceState:
    """The file that defined a component when a sweep was computed."""

    component: str
    distribution: str
    source_hash: str
    status: str
    """Whether the source is the same now, in words."""


def computing_and_latest_run(store: Store, sweep: StoredSweep) -> tuple[RunSummary | None, RunSummary | None]:
    """Return the run that computed a sweep, None if it was deleted, and the latest run that has the sweep."""
    latest = store.find_all([sweep.key]).get(sweep.key)
    newest = store.run(latest.run) if latest and latest.run is not None else None
    if sweep.created is None:
        return None, newest
    for run in store.runs():
        during = run.started <= sweep.created and (run.ended is None or sweep.created <= run.ended)
        if during and store.page(f"key={sweep.key} state=computed", limit=1, run=run.number).total:
            return run, newest
    return None, newest


def provenance_fields(run: RunSummary) -> list[tuple[str, str]]:
    """Return names and values of the run that computed a sweep."""
    return [pair for pair in run_fields(run) if pair[0] not in ("sweeps", "took")]


def source_states(sweep: StoredSweep, registry: Registry) -> list[SourceState]:
    """Return the sources of a sweep's components, and whether they have changed since."""
    found = []
    for name, supplied in sweep.sources.items():
        kind, _, own = name.partition(":")
        provider = registry.providers.get((kind, own))
        same = provider is not None and provider.source_hash == supplied.source_hash
        now = "gone" if provider is None else "unchanged" if same else "changed since; --rerun stale computes it again"
        found.append(SourceState(name, supplied.distribution, supplied.source_hash[:12], now))
    return found
