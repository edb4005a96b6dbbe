"""``fraexp fit``: a plant model fitted to stored responses."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.selection import chosen, database, open_store, run_of
from fraexp.errors import FraexpError
from fraexp.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Fit the responses of sweeps, and print what came out."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    with open_store(arguments) as store:
        numbers = [run_of(store, identifier) for identifier in arguments.ids]
        names = {store.run(number).study for number in numbers if number is not None}
        results = store.results(sweep.key for sweep in chosen(store, arguments.ids))
        sweeps = [sweep for sweep in chosen(store, arguments.ids) if sweep.key in results]
    with_response = [sweep for sweep in sweeps if results[sweep.key].response is not None]
    if not with_response:
        raise FraexpError("fit: found no frequency response; name a run or sweeps that have one")
    name = f"{names.pop() if len(names) == 1 else with_response[0].key[4:12]}-fit"
    return report(
        follow(workspace.fit(with_response, name, arguments.overrides, arguments.using)), arguments, workspace
    )
