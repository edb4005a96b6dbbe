"""The list of runs."""

from typing import ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.widgets import DataTable

from fraexp.store import RunSummary, Store
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import ACTION_GROUP
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.widgets.filter_line import FilteredPage, FilterLine
from fraexp.tui.widgets.paged_table import PagedTable, TableRows
from fraexp.tui.widgets.preview_plot import SidePreview, selected_run
from fraexp.tui.widgets.tagging import ChangingPage
from fraexp.views.fields import MIN_SILENCE_S, run_duration_text, run_state_text
from fraexp.views.listing import Column, time_text
from fraexp.views.run_progress import bar_text, done_fraction, finished_count
from fraexp.views.words import plural

BAR_WIDTH = 8


class RunTable(PagedTable):
    """The runs that match the filter, newest first."""

    TITLE = "Runs"

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[RunSummary] = []

    async def fetch_rows(self, first: int, most: int) -> TableRows:
        """Return runs from an offset."""
        runs = self.runs[first : first + most]
        columns = [
            Column("run", tuple(str(run.number) for run in runs), "key"),
            Column("study", tuple(run.study for run in runs), rank=1),
            Column("state", tuple(_state_text(run) for run in runs), rank=2),
            Column("sweeps", tuple(f"{finished_count(run)}/{run.total}" for run in runs), rank=3),
            Column("unusable", tuple(str(run.failed + run.unusable or "") for run in runs), rank=4),
            Column("started", tuple(time_text(run.started) for run in runs), rank=5),
            Column("took", tuple(run_duration_text(run) for run in runs), rank=6),
            Column("computed", tuple(str(run.computed) for run in runs), rank=7),
            Column("reused", tuple(str(run.reused) for run in runs), rank=8),
            Column("command", tuple(run.command for run in runs), rank=9),
        ]
        return TableRows(tuple(str(run.number) for run in runs), columns, len(self.runs))


def _state_text(run: RunSummary) -> str:
    if run.state != "running" or run.silence > MIN_SILENCE_S:
        return run_state_text(run)
    return f"running {bar_text(done_fraction(run), BAR_WIDTH)}"


class RunsPage(FilteredPage, ChangingPage):
    """All runs."""

    PLACE: ClassVar[str] = "runs"
    HELP: ClassVar[str] = """\
Runs, newest first.
  running           its process is alive
  complete          all of its sweeps have a result
  partial           some sweeps failed
  no usable result  all sweeps failed, diverged or did not move
  stopped           it was stopped; finished sweeps are kept
  process lost      its process died; finished sweeps are kept
Enter opens a run: its sweeps, its log, and the keys that stop it or start it again."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("D", "delete", "delete", tooltip="delete the run, and sweeps that no other run has"),
    ]
    AUTO_FOCUS = "RunTable"
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (150, "-wide")]  # noqa: RUF012 - as Textual declares it
    DEFAULT_CSS = "RunsPage RunTable { width: 3fr; }"
    live = True  # a run may die without changing the database

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[RunSummary] = []

    def body(self) -> ComposeResult:
        """Show the list."""
        yield FilterLine("part of study, state or command")
        with Horizontal():
            yield RunTable()
            yield SidePreview()

    def on_mount(self) -> None:
        """Show the list."""
        self.command = "fraexp list"

    async def load(self) -> None:
        """Read the runs."""
        runs = await self.read(lambda store: store.runs(), self._show_none)
        if runs is not None:
            self.runs = runs
            self.show_notice("" if runs else "No runs yet. s shows the studies, Enter opens one.")
        self.show()

    def _show_none(self, text: str) -> None:
        self.runs = []
        if self.app.backend.workspace.has_database():
            self.show_error(text)
        else:
            self.show_notice("No runs yet: there is no database. s shows the studies, Enter opens one.")

    def show(self) -> None:
        """Show the runs that match the filter."""
        line, table = self.line, self.query_one(RunTable)
        table.runs = [
            run for run in self.runs if line.matches(str(run.number), run.study, run_state_text(run), run.command)
        ]
        table.reload()

    @property
    def run(self) -> RunSummary | None:
        """The run under the cursor."""
        key = self.query_one(RunTable).key
        return next((run for run in self.runs if str(run.number) == key), None)

    @on(PagedTable.Shown)
    @on(DataTable.RowHighlighted)
    def _preview(self) -> None:
        run = self.run
        if run is not None:
            number = run.number
            self.query_one(SidePreview).select(lambda store: selected_run(store, number))

    @on(DataTable.RowSelected)
    def _open_run(self) -> None:
        if self.run is not None:
            self.app.push_screen(RunPage(self.run.number))

    @work(group=ACTION_GROUP)
    async def action_delete(self) -> None:
        """Delete the run under the cursor after confirmation."""
        run = self.run
        if run is None:
            return

        def delete(store: Store) -> str:
            gone = store.delete(runs=[run.number])
            return f"run {run.number} deleted, with {plural(gone, 'sweep')}; u brings it back"

        what = f"Delete run {run.number} of {run.study}, and those of its {plural(run.total, 'sweep')}"
        question = f"{what} that no other run has, with their results, tags and notes?"
        if await self.app.push_screen_wait(ConfirmDialog(question)):
            self.change(delete)
