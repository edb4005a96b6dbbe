"""``fraexp plot``: a figure of a run or of sweeps."""

import os
import shutil
import sys
from argparse import Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_line, print_path, say
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number
from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_folder, check_suffix
from fraexp.figures.elements.view import View
from fraexp.reports.published_comparisons import run_title
from fraexp.store import Store, StoredSweep
from fraexp.views.comparison import with_all_labels
from fraexp.views.words import plural
from fraexp.workspace.workspace_service import WorkspaceService

if TYPE_CHECKING:
    from fraexp.tui.plotting.compared_sweeps import ComparedSweeps
    from fraexp.tui.plotting.plotted_curves import Picture


def execute(arguments: Namespace) -> ExitCode:
    """Draw sweeps into the terminal, or into a file unless it is up to date, and print its path."""
    if arguments.output is None and not arguments.terminal:
        raise FraexpError("plot: give --output FILE, or --terminal to draw here")
    if arguments.output is not None:
        check_suffix(arguments.output)
        check_folder(arguments.output)
    view = View.parse(arguments.frequency_range, arguments.wrap_phase)
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        if all(find_run_number(store, identifier) is None for identifier in arguments.ids):
            sweeps = with_all_labels(sweeps)
        if arguments.terminal:
            print_figure(workspace, store, sweeps, arguments.kind, arguments.group_by)
        if arguments.output is None:
            return ExitCode.OK
        title = arguments.title or _study_title(store, arguments.ids)
        drawn = workspace.figures.draw(
            store, sweeps, arguments.output, title, arguments.kind, say, view, arguments.group_by
        )
    if not drawn:
        raise FraexpError(f"plot: nothing to plot in {plural(len(sweeps), 'sweep')}; fraexp show lists their outcomes")
    without = [sweep for sweep in sweeps if sweep.outcome is None]
    if without:
        say(f"{plural(len(without), 'sweep')} without a result left out")
    if not any(drawn.values()):
        say("the figure is up to date" if len(drawn) == 1 else "the figures are up to date")
    for path in drawn:
        print_path(path)
    return ExitCode.OK


def _study_title(store: Store, identifiers: Sequence[str]) -> str:
    numbers = [find_run_number(store, identifier) for identifier in identifiers]
    runs = [store.run(number) for number in numbers if number is not None]
    titles = {run_title(run.study, "", run.command) for run in runs} if len(runs) == len(numbers) else set()
    return titles.pop() if len(titles) == 1 else ""


MAX_WIDTH = 120
"""Maximum width of a picture [cells]: a wider one is hard to read."""
MIN_ROWS, MAX_ROWS = 9, 18
"""Rows of a panel."""
ELSEWHERE = (80, 30)
"""Columns and rows where there is no terminal."""


def print_figure(
    workspace: WorkspaceService,
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
