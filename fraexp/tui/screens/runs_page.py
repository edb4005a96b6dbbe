"""The list of runs."""

from collections.abc import Sequence
from typing import ClassVar

from textual import work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal

from fraexp.store import RunSummary, Store
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import ACTION_GROUP
from fraexp.tui.screens.run_page import RunPage
from fraexp.tui.widgets.filter_line import FilterLine, ListPage
from fraexp.tui.widgets.paged_table import ListTable
from fraexp.tui.widgets.preview_plot import SidePreview, selected_run
from fraexp.tui.widgets.tagging import ChangingPage
from fraexp.views.fields import MIN_SILENCE_S, run_duration_text, run_state_text
from fraexp.views.listing import Column, time_text
from fraexp.views.run_progress import bar_text, done_fraction, finished_count
from fraexp.views.words import plural

BAR_WIDTH = 8


HEADS = [
    Column("run", (), "key"),
    *(Column(title, (), rank=rank) for rank, title in enumerate(
        ("study", "state", "sweeps", "unusable", "started", "took", "computed", "reused", "command"), start=1
    )),
]  # fmt: skip
"""Columns of the runs."""


def _cells(run: RunSummary) -> list[str]:
    unusable, finished = str(run.failed + run.unusable or ""), f"{finished_count(run)}/{run.total}"
    counts = str(run.computed), str(run.reused)
    took = run_duration_text(run)
    return [str(run.number), run.study, _state_text(run), finished, unusable, time_text(run.started), took, *counts,
            run.command]  # fmt: skip


def _state_text(run: RunSummary) -> str:
    if run.state != "running" or run.silence > MIN_SILENCE_S:
        return run_state_text(run)
    return f"running {bar_text(done_fraction(run), BAR_WIDTH)}"


class RunsPage(ListPage[RunSummary], ChangingPage):
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
        Binding("D", "delete", "delete", tooltip="delete the run, and sweeps that no other run has")
    ]
    AUTO_FOCUS = "ListTable"
    HORIZONTAL_BREAKPOINTS = [(0, "-narrow"), (150, "-wide")]  # noqa: RUF012 - as Textual declares it
    live = True  # a run may die without changing the database

    def body(self) -> ComposeResult:
        """Show the list."""
        yield FilterLine("part of study, state or command")
        with Horizontal():
            yield ListTable("Runs", HEADS, _cells, lambda run: str(run.number))
            yield SidePreview()

    def on_mount(self) -> None:
        """Show the list."""
        self.command = "fraexp list"

    async def load(self) -> None:
        """Read the runs."""
        runs = await self.read(lambda store: store.runs(), self._show_none)
        if runs is not None:
            self.items = runs
            self.show_notice("" if runs else "No runs yet. s shows the studies, Enter opens one.")
        self.show()

    def _show_none(self, text: str) -> None:
        self.items = ()
        if self.app.backend.workspace.has_database():
            self.show_error(text)
        else:
            self.show_notice("No runs yet: there is no database. s shows the studies, Enter opens one.")

    def texts(self, item: RunSummary) -> Sequence[str]:
        """Return the texts of a run in which the filter looks for words."""
        return str(item.number), item.study, run_state_text(item), item.command

    def preview(self, item: RunSummary) -> None:
        """Show the curves and details of a run."""
        self.query_one(SidePreview).select(lambda store: selected_run(store, item.number))

    def open(self, item: RunSummary) -> None:
        """Open a run."""
        self.app.push_screen(RunPage(item.number))

    @work(group=ACTION_GROUP)
    async def action_delete(self) -> None:
        """Delete the run under the cursor after confirmation."""
        run = self.item
        if run is None:
            return

        def delete(store: Store) -> str:
            gone = store.delete(runs=[run.number])
            return f"run {run.number} deleted, with {plural(gone, 'sweep')}; u brings it back"

        what = f"Delete run {run.number} of {run.study}, and those of its {plural(run.total, 'sweep')}"
        question = f"{what} that no other run has, with their results and tags?"
        if await self.app.push_screen_wait(ConfirmDialog(question)):
            self.change(delete)
