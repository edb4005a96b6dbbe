"""One run: how far it has come, its sweeps and its log, and the keys that stop it or start it again."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container
from textual.widgets import Static
from textual.worker import Worker

from fraexp.errors import FraexpError
from fraexp.execution import background
from fraexp.execution.background import BackgroundRun
from fraexp.figures.elements.labels import printable
from fraexp.store import RunSummary, Store
from fraexp.study.study_file import find_studies
from fraexp.tui.dialogs import Ask, Confirm
from fraexp.tui.page import Page, shortened
from fraexp.tui.widgets.log_tail import LogTail
from fraexp.tui.widgets.sweep_table import SweepTable
from fraexp.views.fields import running_for, took
from fraexp.views.listing import when
from fraexp.views.pace import Speed
from fraexp.views.run_progress import counts_text, done, progress_text
from fraexp.views.words import short
from fraexp.workspace.workspace import Workspace

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

LOOK = 0.5
"""Seconds between two looks at the log."""
COMPARED = 12
"""Sweeps that are compared at once, at most."""
TOLD = 2
"""Failures that are told above the table; the table has all."""
COMPILES = "No sweep has ended yet. A law that is new to this machine is compiled first, once: some seconds."


class RunPage(Page):
    """A run that lives, is over, or has not begun yet."""

    PLACE: ClassVar[str] = "runs"
    HELP: ClassVar[str] = """\
A run: what is done of it, its sweeps, and the end of its log. It is a process of its own: leaving this page or
the UI does not end it.
x asks it to end: what is finished is kept. x again ends its processes at once, if you confirm.
R starts what is missing again, or the whole run once more: what is stored is reused.
Enter opens a sweep, Space marks it; c compares the marked ones, or all sweeps of the run if none of them is."""
    DEFAULT_CSS = """
    RunPage #state { height: auto; padding: 0 1; }
    RunPage #sweeps { height: 2fr; }
    RunPage LogTail { height: 1fr; min-height: 4; }
    RunPage #sweeps.-none { display: none; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("x", "stop", "stop", id="run.stop", tooltip="ask the run to end; again: end it at once"),
        Binding("R", "again", "run again", id="run.again", tooltip="compute what is missing, or run it once more"),
        Binding("c", "compare", "compare", id="run.compare", tooltip="compare the marked sweeps, or all of this run"),
        Binding("slash", "filter", "filter", show=False, id="run.filter", tooltip="show some of its sweeps"),
    ]

    def __init__(self, run: int | BackgroundRun) -> None:
        super().__init__()
        self.started = run if isinstance(run, BackgroundRun) else None
        self.number = run if isinstance(run, int) else None
        self.run: RunSummary | None = None
        self.live = True
        self._speed = Speed()
        self._stopping = False

    def body(self) -> ComposeResult:
        """Put the state above the sweeps and the log."""
        yield Static("starting ..." if self.started else "reading ...", id="state")
        yield Container(id="sweeps", classes="-none")
        yield LogTail()

    def on_mount(self) -> None:
        """Show it, and follow the log."""
        super().on_mount()
        self.command = f"fraexp show {self.number}" if self.number else "fraexp list"
        self.set_interval(LOOK, self._follow)

    def _follow(self) -> None:
        """Look at the log; the database may not know the run yet."""
        self._show_log()  # also of a run that is over: its process goes on to draw and to tell
        if self.number is None and self.live:
            self.reload()
        elif self.run and self.run.state == "running":
            self.call_later(self._show, self.run)  # the time goes on, also while nothing else changes

    async def load(self) -> None:
        """Read how far it has come."""
        found = await (self._begun() if self.number is None else self._known(self.number))
        if found is None:
            return
        self.tell()
        if self.run is None:
            self.number = found.number
            self.heading, self.command = f"run {found.number}, {found.study}", f"fraexp show {found.number}"
        self.run = found
        self.live = found.state == "running"
        await self._show_sweeps(found)
        await self._show(found)

    async def _known(self, number: int) -> RunSummary | None:
        return await self.fetch(self.app.desk.read(lambda store: store.run(number)))

    async def _begun(self) -> RunSummary | None:
        """Return the run of the process that was started; None until it has written something."""
        started = self.started
        if started is None:
            return None
        ended = started.ended()  # asked before the database: what it has written is there then
        try:
            found = await self.here(self.app.desk.read(lambda store: _of_log(store, started.log)))
        except FraexpError:
            found = None  # no database yet, or one that the run is about to bring up to date
        if found is None and ended:
            self._show_log()
            last = self.query_one(LogTail).last or "it has said nothing"
            self.live = False
            code = started.process.poll()
            how = "stopped before it began" if self._stopping else f"ended before it began (exit code {code})"
            self.query_one("#state", Static).update(Text(how))
            self.tell_error(f"{last}\nNothing was computed. Esc leads to the runs, s to the studies.")
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

    async def _show(self, run: RunSummary) -> None:
        """Tell how far it has come, and what has failed."""
        rate = None
        if run.state == "running":
            self._speed.see(run.heartbeat.timestamp(), done(run))
            rate = None if _prepares(run) else self._speed.rate
        wide = max(10, min(40, self.size.width - 66))
        state = "stopping" if self._stopping and run.state == "running" else run.state
        text = Text(f"{state}", style="bold")
        time = f", took {took(run)}" if run.ended else ""
        since = f"  since {when(run.started)}, {running_for(run)}"
        text.append(f"  {when(run.started)}{time}" if run.ended else since, "not bold")
        text.append(f"  {counts_text(run)}\n", "not bold")
        text.append(progress_text(run, rate, wide), "not bold")
        if _prepares(run):
            text.append(f"\n{COMPILES}", "not bold")
        for line in await self._failures(run):
            text.append(f"\n{printable(line)}", "not bold")
        hint = {"interrupted": "\nIts process has ended before its work was done. R goes on from there."}
        text.append(hint.get(run.state, ""), "not bold")
        self.query_one("#state", Static).update(text)

    async def _failures(self, run: RunSummary) -> list[str]:
        if not run.failed:
            return []
        asked = self.app.desk.read(lambda store: store.page("state=failed", "-position", 0, TOLD, run.number))
        page = await self.fetch(asked)
        return [shortened(f"! {short(row.key)} failed: {row.message}") for row in page.rows] if page else []

    def _show_log(self) -> None:
        tail = self.query_one(LogTail)
        noted = self.run.provenance.get("log") if self.run else None
        file = self.started.log if self.started else Path(noted) if noted else None
        if file is None:
            tail.show("no log: it was started in a terminal, which had it" if self.run else "log")
            return
        tail.show(f"log {file}")
        tail.follow(file)

    @on(SweepTable.Opened)
    def _opened(self, event: SweepTable.Opened) -> None:
        from fraexp.tui.screens.sweep_page import SweepPage

        self.app.push_screen(SweepPage(event.key))

    def action_stop(self) -> None:
        """Ask the run to end; the second time end it at once, if that is confirmed."""
        if self.run is None and self.started is None:
            return
        if not self.live:
            state = self.run.state if self.run else "over"
            self.app.notify(f"it is {state}; there is nothing to stop", markup=False)
        elif self._stopping:
            question = "End its processes at once? What is stored stays; what is being computed is lost."
            self.app.push_screen(Confirm(question), lambda yes: self._stop(hard=True) if yes else None)
        else:
            self._stopping = True
            self._stop(hard=False)

    def _stop(self, hard: bool) -> None:
        self.run_worker(self._stopped(hard), group="stop")

    async def _stopped(self, hard: bool) -> None:
        run, started = self.run, self.started

        def stop(workspace: Workspace) -> None:
            if run is not None:
                workspace.stop(run, hard)
            elif started is not None and not started.ended():
                background.stop(started.pid, hard)

        await self.fetch(self.app.desk.work(stop), lambda text: self.app.notify(text, severity="error", markup=False))
        self.app.notify("ended" if hard else "asked to end; x again ends it at once", markup=False)
        self.reload()

    def action_again(self) -> None:
        """Compute what is missing, or run it once more."""
        if self.run is not None and self.run.state == "running":
            self.app.notify("it still runs; x asks it to end", markup=False)
        elif self.run is not None or not self.live:
            self.run_worker(self._again(self.run, self.started), group="again")

    async def _again(self, run: RunSummary | None, before: BackgroundRun | None) -> None:
        def launch(workspace: Workspace) -> BackgroundRun:
            if run is not None:
                return workspace.launch(*_command_of(run, workspace), run.provenance.get("executor"))
            assert before is not None  # it ended before it had a number
            return background.start(before.arguments, workspace.folder)

        started = await self.fetch(self.app.desk.work(launch), self._refused)
        if started is not None:
            show_run(self.app, started)

    def _refused(self, text: str) -> None:
        self.app.notify(printable(text), title="not started", severity="error", markup=False)

    async def action_compare(self) -> None:
        """Go to compare the marked sweeps of the run, or else all of them."""
        number, marks = self.number, self.app.marks
        if number is None:
            self.app.notify("the run has not begun yet; its results can be compared when there are some")
            return
        asked = self.app.desk.read(lambda store: store.keys("-state=pending -state=failed", number))
        keys = await self.fetch(asked, self._refused)
        if not keys:
            self.app.notify("no sweep of it has a result to compare", markup=False)
            return
        if not any(key in marks for key in keys):
            marks.add(keys[:COMPARED])
            if len(keys) > COMPARED:
                self.app.notify(f"the first {COMPARED} of {len(keys)} sweeps are marked", markup=False)
        self.app.action_place("compare")

    def action_filter(self) -> None:
        """Show some of the sweeps."""
        tables = self.query(SweepTable)
        if tables:
            table = tables.first()
            ask = Ask("Which sweeps? Such as state:failed excitation.amplitude>=12; nothing: all", table.filter)
            self.app.push_screen(ask, lambda text: None if text is None else setattr(table, "filter", text.strip()))


def show_run(app: "FraexpApp", run: int | BackgroundRun) -> Worker[None]:
    """Go to a run, among the runs; what was opened there before is left. Returns who goes, to be waited for."""

    async def go() -> None:
        await app.switch_mode(RunPage.PLACE)
        while len(app.screen_stack) > 1:
            await app.pop_screen()
        await app.push_screen(RunPage(run))

    return app.run_worker(go(), group="place")


def _prepares(run: RunSummary) -> bool:
    """Return whether it may be compiling: nothing has come to its end, and nothing is seen to go on."""
    moving = run.progress and any(0 < part < 1 for part in run.progress.running.values())
    return run.state == "running" and not (run.computed or run.failed or moving)


def _of_log(store: Store, log: Path) -> RunSummary | None:
    """Return the newest run that notes a log."""
    return next((run for run in store.runs() if run.provenance.get("log") == str(log)), None)


def _command_of(run: RunSummary, workspace: Workspace) -> tuple[str, list[str]]:
    """Return study and overrides of a run's command; FraexpError if it was not ``fraexp run``."""
    words = shlex.split(run.command)
    if words[:2] != ["fraexp", "run"]:
        raise FraexpError(f"run {run.number} was made by: {run.command}; give that command again")
    overrides = [word.removeprefix("--set=") for word in words[2:] if word.startswith("--set=")]
    file = Path(run.study_file)
    try:
        found = [of for _, of in find_studies(run.study, workspace.folder)]
        known = not file.exists() or any(file.samefile(of) for of in found)
    except (FraexpError, OSError):
        known = False
    return run.study if known else run.study_file, overrides
