"""``fraexp delete``: delete runs or sweeps with their results."""

import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import database, run_of
from fraexp.errors import FraexpError
from fraexp.store import Store
from fraexp.views.deletion import loss_of_run, loss_of_sweeps
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Delete what is named, if that is confirmed."""
    with Store.open(database(arguments)) as store:
        found = {identifier: run_of(store, identifier) for identifier in arguments.ids}
        named = next((of for of, number in found.items() if number is not None and str(number) != of), None)
        if named:  # by its study
            raise FraexpError(f"delete: '{named}' is a study; expected a run's number ({found[named]} is its newest)")
        runs = list(dict.fromkeys(number for number in found.values() if number is not None))
        keys = list(dict.fromkeys(store.find(of).key for of, number in found.items() if number is None))
        losses = [loss_of_run(store, number) for number in runs] + ([loss_of_sweeps(store, keys)] if keys else [])
        if not (arguments.yes or _confirmed(losses)):
            say("nothing was deleted")
            return ExitCode.OK
        count = sum(store.delete_run(number) for number in runs) + (store.delete_sweeps(keys) if keys else 0)
    of_runs = f"{plural(len(runs), 'run')} and " if runs else ""
    say(f"{of_runs}{plural(count, 'sweep')} deleted")
    return ExitCode.OK


def _confirmed(losses: list[str]) -> bool:
    """Ask; FraexpError if there is nobody to ask."""
    for loss in losses:
        say(f"to be deleted: {loss}")
    if not sys.stdin.isatty():
        raise FraexpError("delete: there is no terminal to ask on; --yes deletes without asking")
    print("delete? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")
