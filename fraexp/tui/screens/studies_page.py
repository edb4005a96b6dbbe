"""The studies: what each of them asks, and how far it has come."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, VerticalScroll
from textual.timer import Timer
from textual.widgets import DataTable, Input, Static

from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import printable
from fraexp.store import RunSummary
from fraexp.study.catalogue import FIRST, StudyEntry
from fraexp.tui.page import Page
from fraexp.tui.services.study_survey import Surveyor
from fraexp.tui.widgets.filter_line import FilterLine
from fraexp.tui.widgets.sweep_table import PagedTable, TableRows
from fraexp.views.listing import Column
from fraexp.views.study import Surveyed, newest, study_fields, study_row

LOOKING = "..."
"""State of a study while it is worked out."""
MOMENT = 0.5
"""Seconds that the list is shown before it is worked out what running the studies would do: that takes a processor."""
WELCOME = """\
A study is a file: a machine with friction, what excites it, what is
estimated, and what is varied. Running it puts its results into a database.
There is none here yet. Enter opens 'quick', Enter again launches it."""


class StudyTable(PagedTable):
    """The studies that a filter lets through."""

    def __init__(self) -> None:
        super().__init__()
        self.entries: Sequence[StudyEntry] = ()
        self.rows_of: list[list[str]] = []
        self.last: Mapping[str, RunSummary] = {}

    async def ask(self, first: int, most: int) -> TableRows:
        """Return studies from a place on."""
        entries, rows = self.entries[first : first + most], self.rows_of[first : first + most]
        study, title, state, sweeps, _ = zip(*rows, strict=True) if rows else ((),) * 5
        state = tuple(of or LOOKING for of in state)
        sweeps = tuple(f"{int(count):,}" if count else "" for count in sweeps)
        runs = [self.last.get(entry.name) for entry in entries]
        last = tuple(f"{run.number} {run.state}" if run else "" for run in runs)
        columns = [
            Column("study", study, "key"),
            Column("state", state, rank=1),
            Column("sweeps", sweeps, rank=2),
            Column("last run", last, rank=3),
            Column("title", title, rank=4),
        ]
        return TableRows(tuple(entry.name for entry in entries), columns, len(self.entries))


class StudiesPage(Page):
    """All studies, and what the one under the cursor is about."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
Studies: those of this workspace, then the examples that come along.
  new       nothing of it is stored
  partial   some of its sweeps are stored; running it computes the others
  complete  all are stored; running it again computes nothing
  stale     all or some are stored, but a plugin has changed since
  running   its newest run has not come to its end
  broken    it cannot be run, for the reason beside it
  ...       that is being worked out
Enter opens a study, to change what it says and to launch it."""
    DEFAULT_CSS = """
    StudiesPage #split { layout: vertical; height: 1fr; }
    StudiesPage.-wide #split { layout: horizontal; }
    StudiesPage StudyTable { height: 1fr; }
    StudiesPage #about { height: 9; padding: 0 1; }
    StudiesPage.-high #about { height: 14; }
    StudiesPage.-low.-first #about { display: none; }
    StudiesPage.-wide StudyTable { width: 3fr; }
    StudiesPage.-wide #about { width: 2fr; height: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("slash", "filter", "filter", id="studies.filter", tooltip="show studies by a part of name or title"),
        Binding("e", "file", "file", id="studies.file", tooltip="show the study's file"),
    ]
    live = True  # files may be added or changed
    AUTO_FOCUS = "StudyTable"

    def __init__(self) -> None:
        super().__init__()
        self.entries: list[StudyEntry] = []
        self.found: dict[str, Surveyed] = {}
        self.last: dict[str, RunSummary] = {}
        self._surveyor: Surveyor | None = None
        self._wanted: set[str] | None = None  # that are looked at first, once somebody looks at the list
        self._soon: Timer | None = None
        self._asked: object = None

    def body(self) -> ComposeResult:
        """Put the list beside, or above, what one study is about."""
        yield FilterLine("part of a name or title")
        with Container(id="split"):
            yield StudyTable()
            with VerticalScroll(id="about", can_focus=False):
                yield Static(id="preview")

    def on_mount(self) -> None:
        """Show the list at once."""
        super().on_mount()
        self.command = "fraexp list --studies"

    async def load(self) -> None:
        """Read the studies' files and the runs; what running them would do comes later, one by one."""
        entries = await self.fetch(self.app.desk.work(lambda workspace: workspace.catalogue()))
        if entries is None:
            return
        runs = await self._runs()
        before, self.entries, self.last = self.last, entries, newest(runs)
        moved = {
            run.study for run in self.last.values() if _ended(run) and _ended(run) != _ended(before.get(run.study))
        }
        self.found = {name: found for name, found in self.found.items() if name not in moved}
        self.show()
        ended = [_ended(run) for run in runs]
        asked = (entries, [entry.stamp for entry in entries], ended, self._plugins())
        if asked != self._asked:
            self._asked = asked
            self._wanted = {FIRST, *moved, *(self._wanted or ())}
        if self._wanted is not None and self._soon is None:
            self._soon = self.set_timer(MOMENT, self._survey_if_seen)

    async def _runs(self) -> list[RunSummary]:
        try:
            runs = await self.here(self.app.desk.read(lambda store: store.runs()))
        except FraexpError as error:
            runs = []
            if self.app.desk.workspace.has_database():
                self.tell_error(str(error))
                return runs
        self.set_class(not runs, "-first")
        self.tell(WELCOME if not runs else "")
        return runs

    def _plugins(self) -> list[tuple[str, int]]:
        folder = self.app.desk.workspace.folder / "plugins"
        return [(file.name, file.stat().st_mtime_ns) for file in sorted(folder.glob("*.py")) if file.exists()]

    def _survey_if_seen(self) -> None:
        self._soon = None
        if self.is_current and self._wanted is not None:  # else it is asked for again when the screen is shown
            wanted, self._wanted = self._wanted, None
            self.survey(wanted)

    def survey(self, first: Collection[str]) -> None:
        """Work out anew what running the studies would do."""
        if self._surveyor:
            self._surveyor.stop()
        self._surveyor = surveyor = Surveyor(self.app.desk.workspace)
        tell = self._surveyed
        self.run_worker(
            lambda: surveyor.survey(lambda found: self.app.call_from_thread(tell, found), first),
            thread=True, group="survey", exit_on_error=False,
        )  # fmt: skip

    def _surveyed(self, found: Surveyed) -> None:
        if self.is_attached and self.found.get(found.name) != found:
            self.found[found.name] = found
            self.show()

    def on_unmount(self) -> None:
        """Leave nothing running."""
        if self._surveyor:
            self._surveyor.stop()

    def show(self) -> None:
        """Show the studies that the filter lets through."""
        line, table = self.query_one(FilterLine), self.query_one(StudyTable)
        entries = [entry for entry in self.entries if line.lets(entry.name, entry.title)]
        table.entries, table.last = entries, self.last
        table.rows_of = [study_row(of, self.found.get(of.name), self.last.get(of.name)) for of in entries]
        table.reload()
        if self.entries and not entries:
            self.query_one("#preview", Static).update(Text(f"No study has '{line.value}' in name or title. Esc: all"))

    @property
    def entry(self) -> StudyEntry | None:
        """The study under the cursor."""
        key = self.query_one(StudyTable).key
        return next((entry for entry in self.entries if entry.name == key), None)

    @on(PagedTable.Shown)
    @on(DataTable.RowHighlighted)
    def _preview(self) -> None:
        entry = self.entry
        if entry is None:
            return
        about = Text(printable(entry.title), style="bold")
        for name, value in study_fields(entry, self.found.get(entry.name), self.last.get(entry.name)):
            if value:
                about.append(f"\n{printable(name)}  ", style="bold")
                about.append(printable(value), style="not bold")
        self.query_one("#preview", Static).update(about)

    @on(DataTable.RowSelected)
    def _opened(self) -> None:
        from fraexp.tui.screens.launch_page import LaunchPage
        from fraexp.tui.widgets.field_list import Written

        if self.entry is not None:
            self.app.push_screen(LaunchPage(self.entry, self.app.drafts.setdefault(self.entry.name, Written())))

    @on(Input.Changed)
    def _narrowed(self) -> None:
        self.show()

    @on(FilterLine.Left)
    def _left(self) -> None:
        self.query_one(StudyTable).focus()

    def action_filter(self) -> None:
        """Show studies by a part of name or title."""
        self.query_one(FilterLine).begin()

    def action_back(self) -> None:
        """Take the filter away."""
        if not self.query_one(FilterLine).clear_away():
            super().action_back()

    def action_file(self) -> None:
        """Show the study's file."""
        if self.entry is not None:
            self.app.push_screen(FilePage(self.entry.file))


def _ended(run: RunSummary | None) -> tuple[int, str, int, int] | None:
    """Return what tells a run that is over from others; None while it runs."""
    return (run.number, run.state, run.computed, run.total) if run and run.state != "running" else None


class FilePage(Page):
    """The text of a file."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = "The study's file as it is. Change it with an editor; the list notices."
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "scroll(1)", "down", show=False, id="file.down"),
        Binding("k", "scroll(-1)", "up", show=False, id="file.up"),
    ]
    DEFAULT_CSS = "FilePage #text { padding: 0 1; }"

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.file = file

    def body(self) -> ComposeResult:
        """Show the text."""
        with VerticalScroll(id="text"):
            yield Static(id="lines")

    async def load(self) -> None:
        """Read the file."""
        self.heading, self.command = self.file.name, f"cat {self.file}"
        text = await self.here(self.app.desk.work(lambda _: _text(self.file)))
        self.query_one("#lines", Static).update(Text("\n".join(map(printable, text.splitlines()))))

    def action_scroll(self, lines: int) -> None:
        """Scroll by lines."""
        self.query_one("#text", VerticalScroll).scroll_relative(y=lines, animate=False)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        return f"{file}: cannot be read: {error.strerror}"
