"""Command lines that do with sweeps what Compare shows."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from fraexp.figures.elements.view import View
from fraexp.store import url_without_password
from fraexp.tui.plotting.compared_sweeps import ComparedSweeps
from fraexp.tui.services.selection import Selection
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService


class CurveNames:
    """What names the sweeps of curves on a command line, kept as there may be thousands of sweeps."""

    def __init__(self, compared: ComparedSweeps, marks: Selection) -> None:
        self._compared, self._marks = compared, marks
        self._found: dict[tuple[int, ...], tuple[list[str], list[str]]] = {}

    def of(self, places: Sequence[int]) -> tuple[list[str], list[str]]:
        """Return the keys of the curves' sweeps, and the arguments that name them: a run and a filter, or keys."""
        chosen = tuple(places)
        if chosen not in self._found:
            keys, origin = self._compared.keys_of(chosen), self._marks.origin
            is_whole = bool(origin) and set(keys) == set(self._marks)
            self._found[chosen] = keys, list(origin) if is_whole else list(map(short_key, keys))
        return self._found[chosen]


def compare_command(workspace: WorkspaceService, named: Sequence[str]) -> str:
    """Return the command line that prints the differences between sweeps, which are `named` by its arguments."""
    return shlex.join(["fraexp", "compare", *named, *_location_options(workspace)])


def plot_command(
    workspace: WorkspaceService,
    named: Sequence[str],
    kind: str,
    file: str,
    view: View,
    by: Sequence[str] | None = None,
) -> str:
    """Return the command line that draws a figure of sweeps."""
    return shlex.join(["fraexp", *plot_arguments(named, kind, file, view, by), *_location_options(workspace)])


def plot_arguments(
    named: Sequence[str], kind: str, file: str, view: View, by: Sequence[str] | None = None
) -> list[str]:
    """Return the arguments that draw a figure of sweeps, or the visible part of it; `by` makes its groups."""
    grouping = [] if by is None else ["--group-by", *by]
    return ["plot", *named, "--kind", kind, *view.options(), *grouping, "-o", file]


def _location_options(workspace: WorkspaceService) -> list[str]:
    """Return the options that name workspace and database, unless they are those of the current folder."""
    here = workspace.folder.resolve() == Path.cwd()
    usual = workspace.database == str(workspace.folder / "results.db")
    folder = [] if here else [f"--workspace={workspace.folder}"]
    return folder + ([] if usual else [f"--db={url_without_password(workspace.database)}"])
