"""Export of a figure by the command that the screen shows, in a separate process."""

import asyncio
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_suffix
from fraexp.figures.elements.view import View
from fraexp.tui.plotting.figure_commands import plot_arguments
from fraexp.workspace.workspace_service import WorkspaceService


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


async def draw_figure(
    workspace: WorkspaceService,
    named: Sequence[str],
    kind: str,
    file: Path,
    view: View,
    by: Sequence[str] | None = None,
) -> tuple[bool, str]:
    """Draw the visible part of sweeps into a file; return whether it succeeded, and the path or the error.

    `named` are the arguments of the command line that name the sweeps.
    """
    arguments = [*plot_arguments(named, kind, str(file), view, by), *workspace.location_options()]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "fraexp", *arguments,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        env=os.environ | workspace.location_environment(),
    )  # fmt: skip
    out, err = await process.communicate()
    said = (err if process.returncode else out).decode(errors="replace").strip().splitlines()
    return process.returncode == 0, said[-1] if said else str(file)
