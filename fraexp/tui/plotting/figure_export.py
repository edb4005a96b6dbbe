"""Writing a figure: by the very command that the screen shows, in a process of its own."""

import asyncio
import sys
from collections.abc import Sequence
from pathlib import Path

from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_suffix
from fraexp.figures.elements.view import View
from fraexp.tui.plotting.compared_sweeps import plot_arguments
from fraexp.workspace.workspace import Workspace


def wrong_file(text: str) -> str:
    """Return what is wrong with the name of a figure's file, or nothing."""
    if not text.strip():
        return "a name, such as figure.png"
    file = Path(text.strip()).expanduser()
    try:
        check_suffix(file)
        if file.is_dir():
            return "that is a folder"
        if not file.parent.is_dir():
            return f"{file.parent}: there is no such folder"
    except (FraexpError, OSError, ValueError) as error:  # a name that is too long, or has a zero in it
        return str(error)
    return ""


async def draw(workspace: Workspace, keys: Sequence[str], kind: str, file: Path, view: View) -> tuple[bool, str]:
    """Draw what is seen of sweeps into a file; return whether that went well, and the path or the error."""
    arguments = [*plot_arguments(keys, kind, str(file), view), *workspace.place()]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "fraexp", *arguments,
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    out, err = await process.communicate()
    said = (err if process.returncode else out).decode(errors="replace").strip().splitlines()
    return process.returncode == 0, said[-1] if said else str(file)
