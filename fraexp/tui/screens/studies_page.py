"""The list of studies, with the question and the state of each."""

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual import work
from textual.app import ComposeResult, SuspendNotSupported
from textual.binding import Binding, BindingType
from textual.containers import Container, Vertical, VerticalScroll
from textual.timer import Timer
from textual.widgets import Static

from fraexp.data.atomic_file import atomic_file
from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.store import RunSummary
from fraexp.study.catalogue import FIRST_STUDY, StudyEntry
from fraexp.tui.dialogs import InputDialog
from fraexp.tui.page import ACTION_GROUP
from fraexp.tui.services.launch_form import override_texts
from fraexp.tui.services.study_survey import SurveyProcess
from fraexp.tui.widgets.filter_line import FilterLine, ListPage
from fraexp.tui.widgets.paged_table import ListTable
from fraexp.tui.widgets.preview_plot import WITH_RESULT, PreviewPlot
from fraexp.views.fields import run_state_text
from fraexp.views.listing import Column
from fraexp.views.study import StudySurvey, study_fields, study_row

PENDING_STATE = "..."
"""State of a study that is not known yet."""
STUDY_NAME = re.compile(r"[\w-]+(/[\w-]+)*")
SURVEY_DELAY_S = 0.5
"""Seconds until the studies are surveyed, which keeps a processor busy."""
WELCOME = """\
A study is a file: a machine with friction, its excitation, what is
estimated, and what is varied. A run stores its results in a database.
There is none here yet. Enter opens 'quick', Enter again launches it."""


HEADS = [
    Column("study", (), "key"),
    *(Column(title, (), rank=rank) for title, rank in {"state": 1, "sweeps": 3, "last run": 2, "title": 4}.items()),
]
"""Columns of the studies."""


class StudiesPage(ListPage[StudyEntry]):
    """All studies, with a preview of the selected one."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
Studies: those of this workspace, then the examples of fraexp.
  new       none of its sweeps are stored
  partial   some of its sweeps are stored; a run computes the others
  complete  all sweeps are stored; a run computes nothing
  unusable  all are stored, and none of its last run has a usable result
  stale     sweeps are stored, but a plugin has changed since
  running   its newest run has not finished
  broken    it cannot be run, for the reason shown
  measuring its machine is being measured; m shows it
  measure   a study for an autonomous measurement alone, which m begins
  ...       the state is being determined
Enter opens a study, to change its values and to launch it. N makes a copy of it, e edits its file, in $EDITOR.
m measures it on its machine: first the plan, then a question; while a machine is measured, m shows it."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("m", "measure", "measure", tooltip="measure the study on its machine"),
        Binding("e", "edit", "edit", tooltip="edit the study's file"),
        Binding("N", "copy", "new", tooltip="make a new study: a copy of this one in the workspace"),
    ]
    live = True  # files may be added or changed
    AUTO_FOCUS = "ListTable"

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, StudySurvey] = {}
        self.last: dict[str, RunSummary] = {}
        self._surveyor: SurveyProcess | None = None
        self._wanted: set[str] | None = None  # studies to survey first, once the list is visible
        self._soon: Timer | None = None
        self._asked: object = None

    def body(self) -> ComposeResult:
        """Put the list beside or above the preview."""
        yield FilterLine("part of a name or title")
        with Container(id="split"):
            yield ListTable("Studies", HEADS, self._cells, lambda entry: entry.name)
            with Vertical(id="side"):
                with VerticalScroll(id="about", classes="panel", can_focus=False):
                    yield Static(id="preview")
                yield PreviewPlot("Last run")

    def on_mount(self) -> None:
        """Show the command, and that the studies are looked for, which imports all that computes."""
        self.command = "fraexp list --studies"
        self.show_notice("Looking for the studies ...")

    async def load(self) -> None:
        """Read the study files and the runs; the surveys follow one by one."""
        entries = await self.compute(lambda workspace: workspace.catalogue())
        if entries is None:
            return
        runs = await self._runs()
        before, self.items, self.last = self.last, entries, {run.study: run for run in reversed(runs)}
        moved = {
            run.study
            for run in self.last.values()
            if _end_mark(run) and _end_mark(run) != _end_mark(before.get(run.study))
        }
        self.found = {name: found for name, found in self.found.items() if name not in moved}
        self.show()
        ended = [_end_mark(run) for run in runs]
        asked = (entries, [entry.stamp for entry in entries], ended, self._plugins())
        if asked != self._asked:
            self._asked = asked
            self._wanted = {FIRST_STUDY, *moved, *(self._wanted or ())}
        if self._wanted is not None and self._soon is None:
            self._soon = self.set_timer(SURVEY_DELAY_S, self._survey_if_seen)

    async def _runs(self) -> list[RunSummary]:
        try:
            runs = await self.wait_for(self.app.backend.read(lambda store: store.runs()))
        except FraexpError as error:
            runs = []
            if self.app.backend.workspace.has_database():
                self.show_error(str(error))
                return runs
        self.set_class(not runs, "-first")
        self.show_notice(WELCOME if not runs else "")
        return runs

    def _plugins(self) -> list[tuple[str, int]]:
        folder = self.app.backend.workspace.folder / "plugins"
        return [(file.name, file.stat().st_mtime_ns) for file in sorted(folder.glob("*.py")) if file.exists()]

    def _survey_if_seen(self) -> None:
        self._soon = None
        if self.is_current and self._wanted is not None:  # else it is requested again when the screen is shown
            wanted, self._wanted = self._wanted, None
            self.survey(wanted)

    def survey(self, first: Collection[str]) -> None:
        """Survey the studies again, those in `first` before the others."""
        if self._surveyor:
            self._surveyor.stop()
        self._surveyor = surveyor = SurveyProcess(self.app.backend.workspace)
        tell = self._take_survey
        self.run_worker(
            lambda: surveyor.survey(lambda found: self.app.call_from_thread(tell, found), first),
            thread=True, group="survey", exit_on_error=False,
        )  # fmt: skip

    def _take_survey(self, found: StudySurvey) -> None:
        if self.is_attached and self.found.get(found.name) != found:
            self.found[found.name] = found
            self.show()

    def on_unmount(self) -> None:
        """Stop the survey."""
        if self._surveyor:
            self._surveyor.stop()

    def texts(self, item: StudyEntry) -> Sequence[str]:
        """Return the texts of a study in which the filter looks for words."""
        return item.name, item.title

    def _cells(self, entry: StudyEntry) -> list[str]:
        name, title, state, count, _ = study_row(entry, self.found.get(entry.name), self.last.get(entry.name))
        live, run = self.app.measurement, self.last.get(entry.name)
        if live is not None and live.is_moving and name == live.study:
            state = live.state
        last = f"{run.number} {run_state_text(run)}" if run else ""
        return [name, state or PENDING_STATE, f"{int(count):,}" if count else "", last, title]

    def show(self) -> None:
        """Show the studies that match the filter."""
        super().show()
        if self.items and not self.table.items:
            self.query_one("#preview", Static).update(
                Text(f"No study matches '{self.line.value}'. Esc clears the filter.")
            )

    def preview(self, item: StudyEntry) -> None:
        """Show what is known of a study, and the curves of its last run."""
        about = Text(printable(item.title), style="bold")
        for name, value in study_fields(item, self.found.get(item.name), self.last.get(item.name)):
            if value:
                about.append(f"\n{printable(name)}  ", style="bold")
                about.append(printable(value), style="not bold")
        self.query_one("#preview", Static).update(about)
        self._preview_run(self.last.get(item.name))

    def _preview_run(self, run: RunSummary | None) -> None:
        """Show the curves of a study's last run."""
        plot = self.query_one(PreviewPlot)
        plot.set_class(run is not None and self.has_class("-wide") and self.has_class("-high"), "-drawn")
        if run is not None and plot.has_class("-drawn"):
            self._read_run(run.number)

    @work(group="preview", exclusive=True)
    async def _read_run(self, number: int) -> None:
        keys = await self.read(lambda store: store.keys(WITH_RESULT, number), lambda _: None)
        self.query_one(PreviewPlot).preview(keys or [])

    def open(self, item: StudyEntry) -> None:
        """Open the form of a study."""
        from fraexp.tui.screens.launch_page import LaunchPage
        from fraexp.tui.widgets.field_list import FormDraft

        self.app.push_screen(LaunchPage(item, self.app.drafts.setdefault(item.name, FormDraft())))

    def action_measure(self) -> None:
        """Plan the study's measurement with the values of its form, or show the one that is running."""
        if self.item is not None:
            written = self.app.drafts.get(self.item.name)
            self.app.open_measurement(self.item.name, override_texts(written.changes) if written else [])

    def action_edit(self) -> None:
        """Edit the study's file."""
        if self.item is not None:
            self._edit(self.item.file)

    def _edit(self, file: Path) -> None:
        """Give the terminal to the user's editor; the preview then shows what the study would compute, or its fault."""
        if not file.is_relative_to(self.app.backend.workspace.folder / "studies"):
            refused = "an example of fraexp cannot be changed; N copies it into this workspace"
            self.app.notify(refused, title="not edited", severity="error")
            return
        try:
            with self.app.suspend():
                subprocess.run([*shlex.split(editor_command()), str(file)], check=False)
        except (OSError, ValueError, SuspendNotSupported) as error:  # a ValueError is a quote that is not closed
            refused = f"{editor_command()}: {error}; name another editor in the variable EDITOR"
            self.app.notify(refused, title="not edited", severity="error")
        self.reload()

    @work(group=ACTION_GROUP)
    async def action_copy(self) -> None:
        """Copy the study into this workspace, and edit the copy."""
        item, folder = self.item, self.app.backend.workspace.folder
        if item is None:
            return
        question, proposed = f"Name of the copy of {item.name}:", f"my_{item.name.rpartition('/')[2]}"
        name = await self.app.push_screen_wait(InputDialog(question, proposed, lambda text: copy_fault(folder, text)))
        if name is None:
            return
        try:
            self._edit(copy_study(folder, item.file, name))
        except FraexpError as error:
            self.app.notify(str(error), title="not copied", severity="error")


def editor_command() -> str:
    """Return the command of the user's editor."""
    default = "notepad" if os.name == "nt" else "nano" if shutil.which("nano") else "vi"
    stated = (os.environ.get(name, "").strip() for name in ("VISUAL", "EDITOR"))
    return next(filter(None, stated), default)


def copy_fault(folder: Path, name: str) -> str:
    """Return what is wrong with the name of a new study in a workspace; empty if nothing is."""
    if not STUDY_NAME.fullmatch(name):
        return "expected letters, digits, _ and -, with / between folders"
    return "there is a study of this name in the workspace" if (folder / "studies" / f"{name}.toml").exists() else ""


def copy_study(folder: Path, source: Path, name: str) -> Path:
    """Copy a study into a workspace, and return its file; FraexpError if that cannot be written."""
    file = folder / "studies" / f"{name}.toml"
    with atomic_file(file, makes_folder=True) as draft:
        draft.write_bytes(source.read_bytes())
    return file


def _end_mark(run: RunSummary | None) -> tuple[int, str, int, int] | None:
    """Return what identifies a finished run; None while it is running."""
    return (run.number, run.state, run.computed, run.total) if run and run.state != "running" else None
