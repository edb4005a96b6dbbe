"""A run: progress, sweeps and log, and the keys that stop it or start it again."""

import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal
from textual.content import Content
from textual.widgets import Log, Static
from textual.worker import Worker

from fraexp.data.results import Outcome
from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.execution import background
from fraexp.execution.background import BackgroundRun
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.study.study_file import find_studies
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.tui.page import ACTION_GROUP, Page, shorten
from fraexp.tui.services.themes import state_sign
from fraexp.tui.widgets.preview_plot import WITH_RESULT, PreviewPlot, RefreshBudget
from fraexp.tui.widgets.sweep_table import SweepTable
from fraexp.views.fields import elapsed_text, run_duration_text, run_state_text
from fraexp.views.listing import state_text, time_text
from fraexp.views.run_progress import counts_text, progress_text
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

MAX_SHOWN_REASONS = 2
"""Maximum number of reasons of failures shown above the table, which has all failures."""
FAILURE_SIGN = "✗"
MAX_READ_FAILURES = 40
"""Maximum number of the latest failures whose reasons are read."""
MAX_BAR = 40
"""Most cells of the bar of progress."""
PADDING = 2
"""Cells beside its texts."""


class RunState(Static):
    """The state of a run; while it runs, `show` is called again and again."""

    app: "FraexpApp"

    def __init__(self, text: str) -> None:
        super().__init__(text, id="state")
        self._shown: list[str | tuple[str, str]] = []
        self._failures: list[str] = []
        self._failure_count = 0

    async def read_failures(self, run: RunSummary) -> None:
        """Read the latest failures with their messages and remedies, if more have come; FraexpError if that fails."""
        count = run.failed + run.unusable
        if count == self._failure_count:
            return
        page = await self.app.backend.read(
            lambda store: store.page("state:unusable", "-position", 0, MAX_READ_FAILURES, run.number)
        )
        self._failures = _failure_lines(page.rows, page.total)
        self._failure_count = count

    def show(self, run: RunSummary, is_stopping: bool) -> None:
        """Show the progress and the last failures."""
        parts = self._parts(run, is_stopping)
        if parts != self._shown:
            text, before = Content.assemble(*parts), Content.assemble(*self._shown)
            self.update(text, layout=len(text.split()) != len(before.split()))  # a layout draws the whole screen
            self._shown = parts

    def show_start_failure(self, text: str) -> None:
        """Show how a process ended that has begun no run."""
        self.update(Content(text))

    def _parts(self, run: RunSummary, is_stopping: bool) -> list[str | tuple[str, str]]:
        state = "stopping" if is_stopping and run.state == "running" else run_state_text(run)
        sign, colour = state_sign(state)
        took = f", took {run_duration_text(run)}" if run.ended else ""
        since = f"since {time_text(run.started)}, {elapsed_text(run)}"
        parts: list[str | tuple[str, str]] = [
            (f"{sign} {state}", f"bold ${colour}"),
            f"  {time_text(run.started)}{took}" if run.ended else f"  {since}",
            f"  {counts_text(run)}\n",
            progress_text(run, MAX_BAR, self.screen.size.width - PADDING),
        ]
        for line in self._failures:
            parts.append((f"\n{printable(line)}", "$error" if line.startswith(FAILURE_SIGN) else ""))
        if run.ended and run.computed + run.reused:
            parts.append(("\nc shows its figure", "$text-muted"))
        if run.state == "interrupted":
            parts.append(f"\n{_interruption_text(run, is_stopping)}")
        return parts


def _interruption_text(run: RunSummary, is_stopping: bool) -> str:
    """Return how a run was interrupted: one that was asked to stop has stored its end."""
    if run.ended or is_stopping:
        return "It was stopped; finished sweeps are kept. R continues the run."
    return "Its process ended before all sweeps were finished. R continues the run."


def _failure_lines(rows: Sequence[StoredSweep], total: int) -> list[str]:
    """Return what failed and why, and the remedy, once for all of the latest failures of one reason."""
    reasons: dict[tuple[str, str], list[StoredSweep]] = {}
    for row in rows:
        remedy = (row.outcome or Outcome.ERROR).value
        reasons.setdefault((state_text(row), remedy), []).append(row)
    shown = list(reasons.items())[:MAX_SHOWN_REASONS]
    lines = []
    for (state, remedy), failed in shown:
        latest = failed[0]
        several = f"{len(failed)}{' or more' if total > len(rows) else ''} {state}, the last"
        head = f"{several} {short_key(latest.key)}" if len(failed) > 1 else f"{short_key(latest.key)} {state}"
        lines.append(shorten(f"{FAILURE_SIGN} {head}: {latest.message}".removesuffix(": ")))
        lines += [shorten(f"  → {remedy}")] if remedy else []
    more = total - sum(len(failed) for _, failed in shown)
    return [*lines, f"  {f'{more} more' if more else 'all'}: / state:unusable"] if total > 1 else lines


MAX_LINES = 200
"""Maximum number of lines kept."""
TAIL_BYTES = 65_536
"""Bytes before the end at which reading begins."""


class LogTail(Log):
    """The last lines of a file that another process writes, free of terminal control sequences."""

    def __init__(self) -> None:
        super().__init__(max_lines=MAX_LINES)
        self._file: Path | None = None
        self._read = 0
        self._rest = b""
        self._title = ""
        self.last = ""
        """The last line that is not blank."""

    def show(self, title: str) -> None:
        """Show the title: the path of the log, or why there is none."""
        escaped = printable(title).replace("[", r"\[")
        if escaped != self._title:
            self.border_title = self._title = escaped

    def follow(self, file: Path) -> None:
        """Show the end of the file, and lines added since the last call."""
        if file != self._file:
            self._file, self._read, self._rest = file, 0, b""
            self.clear()
        try:
            with file.open("rb") as stream:
                size = stream.seek(0, 2)
                self._read = max(self._read, size - TAIL_BYTES) if self._read <= size else 0
                stream.seek(self._read)
                text = stream.read()
        except OSError as error:
            self.show(f"{file}: cannot be read: {error.strerror}")
            return
        self._read += len(text)
        *lines, self._rest = (self._rest + text).split(b"\n")
        shown = [printable(line.decode("utf-8", errors="replace").rstrip()) for line in lines]
        if shown:
            self.last = next((line for line in reversed(shown) if line.strip()), self.last)
            self.write_lines(shown)


LOG_POLL_INTERVAL_S = 1.0
"""Seconds between two polls of the log, and steps of the elapsed time."""
READING_REST_S = 2.5e-4
"""Seconds for which a running run is not read again, for each of its sweeps: reading counts all of them."""
MAX_REFRESH_SHARE = 0.02
"""Maximum share of a processor that a running run's sweeps and progress take to be drawn again."""


class RunPage(Page):
    """A run that is starting, running or finished."""

    PLACE: ClassVar[str] = "runs"
    HELP: ClassVar[str] = """\
A run: its progress, its sweeps, and the end of its log. It is a separate process: it continues if you close this
screen or quit.
x stops it, and finished sweeps are kept. x again kills its processes at once, after confirmation.
R runs the study again: stored sweeps are reused, missing ones are computed.
v shows its curves as they come; f follows the sweep that is being computed, until you move the cursor.
Enter opens a sweep, Space marks it; c compares the marked sweeps, or all of the run if none is marked."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("x", "stop", "stop", tooltip="stop the run; again: kill it"),
        Binding("R", "again", "run again", tooltip="run the study again; stored sweeps are reused"),
        Binding("c", "compare", "compare", tooltip="compare the marked sweeps, or all of this run"),
        Binding("v", "curves", "curves", tooltip="show or hide its curves"),
        Binding("f", "follow", "follow", tooltip="follow the sweep that is being computed, or stop"),
        Binding("slash", "filter", "filter", show=False, tooltip="filter its sweeps"),
    ]

    def __init__(self, run: int | BackgroundRun) -> None:
        super().__init__()
        self.started = run if isinstance(run, BackgroundRun) else None
        self.number = run if isinstance(run, int) else None
        self.run: RunSummary | None = None
        self.live = True
        self._budget = RefreshBudget(MAX_REFRESH_SHARE)
        self._rest_until = 0.0
        self._stopping = self._changed = False
        self._follows = True
        """Whether the cursor follows the sweep that is being computed."""
        self._positions: dict[str, int] = {}
        """Places of the sweeps in the run, by key; read when the cursor follows them."""

    def body(self) -> ComposeResult:
        """Put the state above the sweeps and the log."""
        yield RunState("starting ..." if self.started else "loading ...")
        with Horizontal(id="main"):
            yield Container(id="sweeps", classes="-none")
            yield PreviewPlot("Curves")
        yield LogTail()

    def on_mount(self) -> None:
        """Show the command, and follow the log."""
        self.command = f"fraexp show {self.number}" if self.number else "fraexp list"
        self.set_interval(LOG_POLL_INTERVAL_S, self._poll_log)

    def follow(self, changed: bool) -> None:
        """Load again; at a later poll of the log while the run is computing, which needs the processors."""
        self._changed = True
        if not self.live:
            super().follow(changed)

    def _poll_log(self) -> None:
        """Update the log and what has changed; the run may not be in the database yet."""
        self._show_log()  # also after the run: its process still draws and reports
        if self.live and (self.number is None or (self._changed and time.monotonic() > self._rest_until)):
            self._changed = False
            self.reload()
        elif self.run and self.run.state == "running":
            self.query_one(RunState).show(self.run, self._stopping)  # update the elapsed time

    async def load(self) -> None:
        """Read the state of the run."""
        found = await (self._find_started_run() if self.number is None else self._read_run(self.number))
        if found is None:
            return
        self.show_notice()
        if self.run is None:
            self.number = found.number
            self.heading, self.command = f"run {found.number}, {found.study}", f"fraexp show {found.number}"
        self.run = found
        self.live = found.state == "running"
        self._rest_until = time.monotonic() + READING_REST_S * found.total
        await self._show(found)
        if not (self.live and self._budget.is_resting):
            self._budget.begin()
            await self._show_sweeps(found)
            await self._show_curves(found)

    async def _read_run(self, number: int) -> RunSummary | None:
        return await self.read(lambda store: store.run(number))

    async def _find_started_run(self) -> RunSummary | None:
        """Return the run of the started process; None until it is in the database."""
        started = self.started
        if started is None:
            return None
        ended = started.has_ended()  # before reading the database, so that its last entry is seen
        try:
            found = await self.wait_for(self.app.backend.read(lambda store: _find_run_by_log(store, started.log)))
        except FraexpError:
            found = None  # no database yet, or one that the run is about to migrate
        if found is None and ended:
            self._show_log()
            last = self.query_one(LogTail).last or "the log is empty"
            self.live = False
            code = started.process.poll()
            how = "stopped before the first sweep" if self._stopping else f"failed to start (exit code {code})"
            self.query_one(RunState).show_start_failure(how)
            self.show_error(f"{last}\nNothing was computed. Esc returns to the runs, s to the studies.")
        return found

    async def _show_sweeps(self, run: RunSummary) -> None:
        place = self.query_one("#sweeps", Container)
        if place.has_class("-none"):
            place.remove_class("-none")
            table = SweepTable(run.number)
            await place.mount(table)
            table.focus()
        table = place.query_one(SweepTable)
        running = run.progress.running if run.progress and run.state == "running" else {}
        if table.running != running:
            table.running = running
        else:
            table.reload()
        if self._follows and running and not table.filter and not table.order:
            await self._go_to(table, next(iter(running)))

    async def _go_to(self, table: SweepTable, key: str) -> None:
        """Move the cursor to a sweep."""
        number = self.number
        if not self._positions:
            keys = await self.read(lambda store: store.keys("", number))
            self._positions = {key: place for place, key in enumerate(keys or ())}
        if key in self._positions:
            table.go_to(self._positions[key])

    async def _show_curves(self, run: RunSummary) -> None:
        """Show the curves that have come, at intervals that cost the run little, and all of them at its end."""
        plot, number = self.query_one(PreviewPlot), run.number
        if plot.display and not (self.live and plot.is_resting):
            plot.preview(await self.read(lambda store: store.keys(WITH_RESULT, number)) or [])

    async def _show(self, run: RunSummary) -> None:
        """Show the progress and the last failures."""
        state = self.query_one(RunState)
        await self.fetch(state.read_failures(run))
        state.show(run, self._stopping)

    def _show_log(self) -> None:
        tail = self.query_one(LogTail)
        noted = self.run.provenance.get("log") if self.run else None
        file = self.started.log if self.started else Path(noted) if noted else None
        tail.set_class(file is None, "-empty")
        if file is None:
            tail.show("no log: the run was started in a terminal" if self.run else "log")
            return
        tail.show(f"log {file}")
        tail.follow(file)

    @on(SweepTable.Shown)
    def _end_refresh(self) -> None:
        self.call_after_refresh(self._budget.end)

    @on(SweepTable.Opened)
    def _open_sweep(self, event: SweepTable.Opened) -> None:
        from fraexp.tui.screens.sweep_page import SweepPage

        self.app.push_screen(SweepPage(event.key))

    @work(group=ACTION_GROUP)
    async def action_stop(self) -> None:
        """Stop the run; the second time, kill it after confirmation."""
        if self.run is None and self.started is None:
            return
        if not self.live:
            state = self.run.state if self.run else "finished"
            self.app.notify(f"the run is {state}; it cannot be stopped")
        elif self._stopping:
            question = "Kill its processes? Stored results are kept; sweeps in progress are lost."
            if await self.app.push_screen_wait(ConfirmDialog(question)):
                self._stop(kill=True)
        else:
            self._stopping = True
            self._stop(kill=False)

    @work(group="stop")
    async def _stop(self, kill: bool) -> None:
        run, started = self.run, self.started

        def stop(workspace: WorkspaceService) -> None:
            if run is not None:
                workspace.stop(run, kill)
            elif started is not None and not started.has_ended():
                background.stop(started.pid, kill)

        await self.compute(stop, lambda text: self.app.notify(text, severity="error"))
        self.app.notify("killed" if kill else "stopping; x again kills it")
        self.reload()

    def action_again(self) -> None:
        """Run the study again: stored sweeps are reused."""
        if self.run is not None and self.run.state == "running":
            self.app.notify("it is still running; x stops it")
        elif self.run is not None or not self.live:
            self._run_again(self.run, self.started)

    @work(group="again")
    async def _run_again(self, run: RunSummary | None, before: BackgroundRun | None) -> None:
        def launch(workspace: WorkspaceService) -> BackgroundRun:
            if run is not None:
                return workspace.launch(*_launch_arguments(run, workspace), run.provenance.get("executor"))
            assert before is not None  # it ended before it was in the database
            return background.start(before.arguments, workspace.folder, workspace.location_environment())

        started = await self.compute(launch, self._show_refusal)
        if started is not None:
            show_run(self.app, started)

    def _show_refusal(self, text: str) -> None:
        self.app.notify(text, title="not started", severity="error")

    async def action_compare(self) -> None:
        """Compare the marked sweeps of the run, or all of them if none is marked."""
        number, marks = self.number, self.app.marks
        if number is None:
            self.app.notify("the run has no results yet")
            return
        keys = await self.read(lambda store: store.keys(WITH_RESULT, number), self._show_refusal)
        if not keys:
            self.app.notify("no sweep of this run has a result to compare")
            return
        if not any(key in marks for key in keys):
            marks.clear()
            marks.add(keys, (str(number),))
        self.app.action_place("compare")

    def action_curves(self) -> None:
        """Show or hide the curves; in a narrow terminal in place of the sweeps."""
        self.toggle_class("-curves")
        self.reload()

    def action_follow(self) -> None:
        """Follow the sweep that is being computed, or stop following."""
        self._follows = not self._follows
        self.app.notify("following the sweep in progress" if self._follows else "not following", timeout=2)
        self.reload()

    @on(SweepTable.Touched)
    def _stop_following(self) -> None:
        self._follows = False

    @work(group=ACTION_GROUP)
    async def action_filter(self) -> None:
        """Filter the sweeps."""
        for table in self.query(SweepTable):
            question = "Filter, such as state:unusable excitation.amplitude>=12 (empty: all sweeps)"
            text = await self.app.push_screen_wait(InputDialog(question, table.filter))
            if text is not None:
                table.filter = text.strip()


def show_run(app: "FraexpApp", run: int | BackgroundRun) -> Worker[None]:
    """Open a run over the list of runs; return the worker that does so, which can be awaited."""

    async def go() -> None:
        await app.switch_mode(RunPage.PLACE)
        while len(app.screen_stack) > 1:
            await app.pop_screen()
        await app.push_screen(RunPage(run))

    return app.run_worker(go(), group="place")


def _find_run_by_log(store: Store, log: Path) -> RunSummary | None:
    """Return the newest run with this log file."""
    return next((run for run in store.runs() if run.provenance.get("log") == str(log)), None)


def _launch_arguments(run: RunSummary, workspace: WorkspaceService) -> tuple[str, list[str]]:
    """Return study and overrides of a run's command; FraexpError unless it is ``fraexp run``."""
    words = shlex.split(run.command)
    if words[:2] != ["fraexp", "run"]:
        raise FraexpError(f"run {run.number} was started by: {run.command}; start it again with that command")
    overrides = [word.removeprefix("--set=") for word in words[2:] if word.startswith("--set=")]
    file = Path(run.study_file)
    try:
        found = [of for _, of in find_studies(run.study, workspace.folder)]
        known = not file.exists() or any(file.samefile(of) for of in found)
    except (FraexpError, OSError):
        known = False
    return run.study if known else run.study_file, overrides
