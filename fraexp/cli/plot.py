"""``fraexp plot``: a figure of a run or of sweeps."""

from argparse import Namespace
from collections.abc import Sequence

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path, say
from fraexp.cli.sweep_lookup import chosen, database, open_store, run_of
from fraexp.errors import FraexpError
from fraexp.figures.elements.stamp import check_suffix
from fraexp.figures.elements.view import View
from fraexp.store import Store
from fraexp.views.comparison import named_alike
from fraexp.views.words import plural
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Draw sweeps, unless the file shows them already, and print the file's path."""
    check_suffix(arguments.output)
    view = View.of(arguments.band, arguments.wrapped)
    workspace = Workspace.open(arguments.workspace, database(arguments))
    with open_store(arguments) as store:
        sweeps = chosen(store, arguments.ids)
        if all(run_of(store, identifier) is None for identifier in arguments.ids):
            sweeps = named_alike(store, sweeps)
        title = arguments.title or _study(store, arguments.ids)
        drawn = workspace.figures.draw(store, sweeps, arguments.output, title, arguments.kind, say, view)
    if not drawn:
        raise FraexpError(
            f"plot: found nothing to draw in {plural(len(sweeps), 'sweep')}; see their outcomes with show"
        )
    without = [sweep for sweep in sweeps if sweep.outcome is None]
    if without:
        say(f"{plural(len(without), 'sweep')} without a result left out")
    if not any(drawn.values()):
        say("the figure is up to date" if len(drawn) == 1 else "the figures are up to date")
    for path in drawn:
        print_path(path)
    return ExitCode.OK


def _study(store: Store, identifiers: Sequence[str]) -> str:
    numbers = [run_of(store, identifier) for identifier in identifiers]
    studies = {store.run(number).study if number is not None else "" for number in numbers}
    return studies.pop() if len(studies) == 1 else ""
