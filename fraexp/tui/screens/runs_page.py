"""The runs: what has been run, and what runs."""

from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import DataTable, Input

from fraexp.store import RunSummary
from fraexp.tui.dialogs import Confirm
from fraexp.tui.page import Page
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.widgets.filter_line import FilterLine
from fraexp.tui.widgets.sweep_table import PagedTable, TableRows
from fraexp.views.fields import took
from fraexp.views.listing import Column, when
from fraexp.views.run_progress import bar, finished, share
from fraexp.views.words import plural

BAR = 8


class RunTable(PagedTable):
    """The runs that a filter lets through, newest first."""

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[RunSummary] = []

    async def ask(self, first: int, most: int) -> TableRows:
        """Return runs from a place on."""
        runs = self.runs[first : first + most]
        columns = [
            Column("run", tuple(str(run.number) for run in runs), "key"),
            Column("study", tuple(run.study for run in runs), rank=1),
            Column("state", tuple(_state(run) for run in runs), rank=2),
            Column("sweeps", tuple(f"{finished(run)}/{run.total}" for run in runs), rank=3),
            Column("failed", tuple(str(run.failed or "") for run in runs), rank=4),
            Column("started", tuple(when(run.started) for run in runs), rank=5),
            Column("took", tuple(took(run) for run in runs), rank=6),
            Column("computed", tuple(str(run.computed) for run in runs), rank=7),
            Column("reused", tuple(str(run.reused) for run in runs), rank=8),
            Column("command", tuple(run.command for run in runs), rank=9),
        ]
        return TableRows(tuple(str(run.number) for run in runs), columns, len(self.runs))


def _state(run: RunSummary) -> str:
    return f"running {bar(share(run), BAR)}" if run.state == "running" else run.state


class RunsPage(Page):
    """All runs."""

    PLACE: ClassVar[str] = "runs"
    HELP: ClassVar[str] = """\
Runs, newest first.
  running      its process lives
  complete     all of its sweeps have a result
  partial      some of them failed
  interrupted  it was stopped, or its process died; what was finished is kept
Enter opens a run: its sweeps, its log, and the keys to stop it or to start it again."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "slash", "filter", "filter", id="runs.filter", tooltip="show runs by a part of study, state or command"
        ),
        Binding("D", "delete", "delete", id="runs.delete", tooltip="delete the run, and what is in no other run"),
    ]
    AUTO_FOCUS = "RunTable"
    live = True  # a run may die without a word

    def __init__(self) -> None:
        super().__init__()
        self.runs: list[RunSummary] = []

    def body(self) -> ComposeResult:
        """Show the list."""
        yield FilterLine("part of study, state or command")
        yield RunTable()

    def on_mount(self) -> None:
        """Show the list."""
        super().on_mount()
        self.command = "fraexp list"

    async def load(self) -> None:
        """Read the runs."""
        runs = await self.fetch(self.app.desk.read(lambda store: store.runs()), self._none)
        if runs is not None:
            self.runs = runs
            self.tell("" if runs else "No study has been run yet. s shows the studies, Enter opens one.")
        self.show()

    def _none(self, text: str) -> None:
        self.runs = []
        if self.app.desk.workspace.has_database():
            self.tell_error(text)
        else:
            self.tell("Nothing has been run here yet: there is no database. s shows the studies, Enter opens one.")

    def show(self) -> None:
        """Show the runs that the filter lets through."""
        line, table = self.query_one(FilterLine), self.query_one(RunTable)
        table.runs = [run for run in self.runs if line.lets(str(run.number), run.study, run.state, run.command)]
        table.reload()

    @property
    def run(self) -> RunSummary | None:
        """The run under the cursor."""
        key = self.query_one(RunTable).key
        return next((run for run in self.runs if str(run.number) == key), None)

    @on(DataTable.RowSelected)
    def _opened(self) -> None:
        if self.run is not None:
            self.app.push_screen(RunPage(self.run.number))

    @on(Input.Changed)
    def _narrowed(self) -> None:
        self.show()

    @on(FilterLine.Left)
    def _left(self) -> None:
        self.query_one(RunTable).focus()

    def action_filter(self) -> None:
        """Show some of the runs."""
        self.query_one(FilterLine).begin()

    def action_back(self) -> None:
        """Take the filter away."""
        if not self.query_one(FilterLine).clear_away():
            super().action_back()

    def action_delete(self) -> None:
        """Delete the run under the cursor, if that is confirmed."""
        run = self.run
        if run is not None:
            what = f"Delete run {run.number} of {run.study}, and those of its {plural(run.total, 'sweep')}"
            question = f"{what} that are in no other run, with their results, tags and notes?"
            self.app.push_screen(Confirm(question), lambda yes: self._delete(run.number) if yes else None)

    def _delete(self, number: int) -> None:
        self.run_worker(self._deleted(number), group="delete")

    async def _deleted(self, number: int) -> None:
        gone = await self.fetch(self.app.desk.write(lambda store: store.delete_run(number)), self._refused)
        if gone is not None:
            self.app.notify(f"run {number} is deleted, with {plural(gone, 'sweep')}", markup=False)
            self.reload()

    def _refused(self, text: str) -> None:
        self.app.notify(text, title="not deleted", severity="error", markup=False)
