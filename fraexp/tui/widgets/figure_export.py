"""Export of figures and of sweeps by commands, each in a separate process."""

import asyncio
import os
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_suffix
from fraexp.figures.elements.view import View
from fraexp.figures.result_files import WRITERS
from fraexp.tui.dialogs import ConfirmDialog, InputDialog
from fraexp.views.words import plural, short_key
from fraexp.workspace.workspace_service import WorkspaceService

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp


def compare_command(workspace: WorkspaceService, named: Sequence[str]) -> str:
    """Return the command line that prints the differences between sweeps, which are `named` by its arguments."""
    return shlex.join(["fraexp", "compare", *named]) + workspace.shown_options()


@dataclass(frozen=True)
class FigureExport:
    """A figure of sweeps that is to be exported."""

    count: int
    """Number of its sweeps."""
    named: Sequence[str]
    """Arguments of a command line that name them."""
    kind: str
    view: View
    by: Sequence[str] | None
    """Labels that make groups; None: all."""

    def arguments(self, file: str) -> list[str]:
        """Return the arguments of a command line that draws the figure into a file."""
        grouping = [] if self.by is None else ["--group-by", *self.by]
        return ["plot", *self.named, "--kind", self.kind, *self.view.options(), *grouping, "-o", file]

    def command(self, workspace: WorkspaceService, file: str) -> str:
        """Return the command line that draws the figure into a file."""
        return shlex.join(["fraexp", *self.arguments(file)]) + workspace.shown_options()

    async def ask(self, app: "FraexpApp", proposed: str) -> Path | None:
        """Ask for a file to draw the figure into; None if there is nothing to draw, or the user decides against it."""
        if not self.count:
            app.notify("all curves are hidden; press 0 to show them", severity="warning")
            return None
        what = plural(self.count, "sweep")
        question = f"Export {what} as a {self.kind} figure to this file (.png, .svg or .pdf):"
        answer = await app.push_screen_wait(InputDialog(question, proposed, file_fault))
        file = Path(answer.strip()).expanduser() if answer else None
        if (
            file
            and file.exists()
            and not await app.push_screen_wait(ConfirmDialog(f"{file} already exists. Overwrite it?"))
        ):
            return None
        return file

    async def draw(self, app: "FraexpApp", file: Path) -> None:
        """Draw the figure into a file, and tell how that ended."""
        app.notify(f"drawing {file} …", timeout=3)
        ended, text = await run_command(app.backend.workspace, self.arguments(str(file)))
        app.notify(text, title="exported" if ended else "not exported", severity="information" if ended else "error")


async def run_command(workspace: WorkspaceService, arguments: Sequence[str]) -> tuple[bool, str]:
    """Run a command of fraexp that writes a file; return whether that succeeded, and the path or the error."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "fraexp", *arguments, *workspace.location_options(),
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        env=os.environ | workspace.location_environment(),
    )  # fmt: skip
    out, err = await process.communicate()
    said = (err if process.returncode else out).decode(errors="replace").strip().splitlines()
    return process.returncode == 0, said[-1] if said else str(arguments[-1])


async def ask_and_export(app: "FraexpApp", key: str) -> None:
    """Ask for a file, and export a sweep into it by ``fraexp export``, which replaces none."""
    question = f"Export sweep {short_key(key)} to this file ({', '.join(WRITERS)}):"
    answer = await app.push_screen_wait(InputDialog(question, f"{short_key(key)}.csv"))
    if answer:
        file = str(Path(answer.strip()).expanduser())
        done, text = await run_command(app.backend.workspace, ["export", short_key(key), "-o", file])
        app.notify(text, title="exported" if done else "not exported", severity="information" if done else "error")


def file_fault(text: str) -> str:
    """Return the fault of a figure's file name; empty if it is valid."""
    if not text.strip():
        return "expected a file name, such as figure.png"
    file = Path(text.strip()).expanduser()
    try:
        check_suffix(file)
        if file.is_dir():
            return "this is a folder; expected a file name"
        if not file.parent.is_dir():
            return f"{file.parent}: no such folder"
    except (FraexpError, OSError, ValueError) as error:  # too long, or with a null character
        return str(error)
    return ""
