"""Figures of sweeps in the terminal, with the drawing of the terminal UI."""

import os
import shutil
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fraexp.cli.output import print_line, say
from fraexp.errors import FraexpError
from fraexp.store import Store, StoredSweep

if TYPE_CHECKING:
    from fraexp.tui.plotting.compared_sweeps import ComparedSweeps
    from fraexp.tui.plotting.plotted_curves import Picture
    from fraexp.workspace.workspace_service import WorkspaceService

MAX_WIDTH = 120
"""Maximum width of a picture [cells]: a wider one is hard to read."""
MIN_ROWS, MAX_ROWS = 9, 18
"""Rows of a panel."""
ELSEWHERE = (80, 30)
"""Columns and rows where there is no terminal."""


def print_figure(
    workspace: "WorkspaceService",
    store: Store,
    sweeps: Sequence[StoredSweep],
    kind: str = "",
    by: Sequence[str] | None = None,
) -> None:
    """Print a figure of sweeps, one picture for each unit and facet; FraexpError if the kind needs a file."""
    from fraexp.tui.plotting.compared_sweeps import VIEW_NAMES, MarkedSweeps, compare_sweeps, split_group
    from fraexp.tui.plotting.plotted_curves import REFERENCE

    view = {"errors": "difference", "hysteresis": "curves", "positioning": "curves"}.get(kind, kind)
    if view and view not in VIEW_NAMES:
        raise FraexpError(f"--terminal: {kind} figures are not drawn in a terminal; write a file with --output")
    results = store.results(sweep.key for sweep in sweeps)
    known = tuple(sweep for sweep in sweeps if sweep.key in results)
    if not known:
        raise FraexpError("--terminal: these sweeps have no result to draw; fraexp show lists their outcomes")
    found = compare_sweeps(workspace, MarkedSweeps(known, dict(results), (), ()), by)
    view = view or found.default_view
    for number, group in enumerate(found.groups(view)):
        facet = split_group(group)[1]
        picture = found.picture(view, group, REFERENCE if kind == "errors" else 0)
        if number:
            print()
        _print_picture(picture, found, view, group, facet)
    for note in found.left_out:
        say(note)


def _print_picture(picture: "Picture", found: "ComparedSweeps", view: str, group: str, facet: str) -> None:
    from rich.console import Console

    from fraexp.tui.plotting.printed_picture import legend_lines, picture_lines

    columns, rows = shutil.get_terminal_size(ELSEWHERE)
    console = Console(highlight=False, width=columns)
    plain, dark = console.no_color or not console.is_terminal, _is_dark()
    each = min(max((rows - 6) // max(len(picture.panels), 1), MIN_ROWS), MAX_ROWS)
    print_line(f"{picture.title}: {facet}" if facet else picture.title)
    lines = picture_lines(picture, (min(columns, MAX_WIDTH), each * len(picture.panels)), dark, plain)
    for line in [*lines, *legend_lines(found.labels(view, group), dark, plain)]:
        _print_segments(console, line)
    sys.stdout.flush()


def _print_segments(console: object, line: Sequence[object]) -> None:
    from rich.console import Console
    from rich.segment import Segment
    from rich.text import Text

    assert isinstance(console, Console)
    pieces = [(piece.text, piece.style or "") for piece in line if isinstance(piece, Segment)]
    console.print(Text.assemble(*pieces), overflow="ellipsis", no_wrap=True)


def _is_dark() -> bool:
    """Return whether the terminal's background is dark, as far as it says so."""
    ground = os.environ.get("COLORFGBG", "").rpartition(";")[2]
    return ground not in ("7", "15")
