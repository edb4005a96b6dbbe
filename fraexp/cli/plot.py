"""``fraexp plot``: a figure of a run or of sweeps."""

from argparse import Namespace
from collections.abc import Sequence

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path, say
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number
from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_folder, check_suffix
from fraexp.figures.elements.view import View
from fraexp.reports.published_comparisons import run_title
from fraexp.store import Store
from fraexp.views.comparison import with_all_labels
from fraexp.views.words import plural
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Draw sweeps into a file unless it is up to date, and print its path."""
    check_suffix(arguments.output)
    check_folder(arguments.output)
    view = View.parse(arguments.frequency_range, arguments.wrap_phase)
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        if all(find_run_number(store, identifier) is None for identifier in arguments.ids):
            sweeps = with_all_labels(sweeps)
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
