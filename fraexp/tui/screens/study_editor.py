"""The text of a study: read, changed and saved in place, with what it would compute or its fault below."""

import asyncio
import re
from pathlib import Path
from typing import ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Static, TextArea

from fraexp.data import toml
from fraexp.data.atomic_file import atomic_file
from fraexp.data.terminal_text import printable
from fraexp.errors import FraexpError
from fraexp.study.catalogue import StudyEntry
from fraexp.tui.dialogs import ConfirmDialog
from fraexp.tui.page import ACTION_GROUP, Page, shorten
from fraexp.views.study import plan_summary, survey_study
from fraexp.workspace.workspace_service import WorkspaceService

CHECK_DELAY_S = 0.3
"""Seconds without a key after which the text is checked."""
STUDY_NAME = re.compile(r"[\w-]+(/[\w-]+)*")


class StudyEditor(Page):
    """An editor of a study's file; the examples of fraexp can only be read."""

    PLACE: ClassVar[str] = "studies"
    HELP: ClassVar[str] = """\
The text of a study. Ctrl+S saves it; the last line says what running it would compute, or what is wrong and where.
A study with a fault can be saved, and does not run until it is corrected. F5 saves, and opens the launch form.
The examples of fraexp cannot be changed: N in Studies makes a copy of one in this workspace."""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "save", "save", tooltip="save the study"),
        Binding("f5", "launch", "launch", tooltip="save, and open the launch form"),
    ]
    AUTO_FOCUS = "TextArea"

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.file = file
        self._saved: str | None = None
        """The text of the file; None before it is read."""

    def body(self) -> ComposeResult:
        """Put the plan below the text."""
        yield TextArea(show_line_numbers=True, read_only=True)
        yield Static(id="plan")

    @property
    def area(self) -> TextArea:
        """The text."""
        return self.query_one(TextArea)

    @property
    def is_changed(self) -> bool:
        """Whether the text is not that of the file."""
        return self._saved is not None and self.area.text != self._saved

    async def load(self) -> None:
        """Read the file, unless the text has been changed here; then check it."""
        self.heading, self.command = self.file.name, f"cat {self.file}"
        if not self.is_changed:
            try:
                text = self.file.read_text(encoding="utf-8")
            except (OSError, ValueError) as error:
                self.show_error(f"{self.file}: cannot be read: {error}")
                return
            if text != self._saved:
                self._saved = text
                self.area.load_text(text)
            self.area.read_only = not self.file.is_relative_to(self.app.backend.workspace.folder / "studies")
        await self._check()

    @on(TextArea.Changed)
    @work(group="check", exclusive=True)
    async def check_soon(self) -> None:
        """Check the text once no key follows."""
        await asyncio.sleep(CHECK_DELAY_S)
        await self._check()

    async def _check(self) -> None:
        """Show what is wrong with the text; of a saved one what running it would compute."""
        try:
            toml.loads(self.area.text)
        except ValueError as error:
            self._show_plan(f"not valid TOML: {error}", error=True)
            return
        if self.is_changed:
            self._show_plan("changed; Ctrl+S saves it")
            return
        entry = await self._entry()
        if entry is None:
            return
        found = await self.compute(lambda workspace: survey_study(workspace, entry))
        if found is not None:
            self._show_plan(found.error or found.command or plan_summary(found), error=bool(found.error))

    async def _entry(self) -> StudyEntry | None:
        """Return the study as the catalogue has it."""

        def find(workspace: WorkspaceService) -> StudyEntry | None:
            return next((entry for entry in workspace.catalogue() if entry.file.samefile(self.file)), None)

        return await self.compute(find)

    def _show_plan(self, text: str, error: bool = False) -> None:
        plan = self.query_one("#plan", Static)
        plan.update(Text(printable(shorten(f"! {text}" if error else text))))
        plan.set_class(error, "-error")

    def action_save(self) -> bool:
        """Write the text into the file, and return whether the file has it."""
        if not self.is_changed:
            return True
        try:
            with atomic_file(self.file) as draft:
                draft.write_text(self.area.text, encoding="utf-8")
        except FraexpError as error:
            self.app.notify(str(error), title="not saved", severity="error")
            return False
        self._saved = self.area.text
        self.reload()
        return True

    @work(group=ACTION_GROUP)
    async def action_launch(self) -> None:
        """Save, and open the launch form in place of the text."""
        from fraexp.tui.screens.launch_page import LaunchPage
        from fraexp.tui.widgets.field_list import FormDraft

        entry = await self._entry() if self.action_save() else None
        if entry is not None:
            form = LaunchPage(entry, self.app.drafts.setdefault(entry.name, FormDraft()))
            self.app.switch_screen(form)

    def action_back(self) -> None:
        """Close the editor; a text that is not saved only after a question."""
        self._close()

    @work(group=ACTION_GROUP)
    async def _close(self) -> None:
        if not self.is_changed or await self.app.push_screen_wait(ConfirmDialog("Discard what is not saved?")):
            self.app.pop_screen()


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
