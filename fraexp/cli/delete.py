"""``fraexp delete``: delete runs or sweeps with their results."""

import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import find_run_number, opened_for_writing
from fraexp.errors import FraexpError
from fraexp.views.deletion import run_loss_text, sweep_loss_text
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Delete the named runs and sweeps after confirmation."""
    with opened_for_writing(arguments) as store:
        found = {identifier: find_run_number(store, identifier) for identifier in arguments.ids}
        named = next((of for of, number in found.items() if number is not None and str(number) != of), None)
        if named:  # by its study
            raise FraexpError(f"delete: '{named}' is a study; expected a run number (its newest run is {found[named]})")
        runs = list(dict.fromkeys(number for number in found.values() if number is not None))
        keys = list(dict.fromkeys(store.find(of).key for of, number in found.items() if number is None))
        losses = [run_loss_text(store, number) for number in runs] + ([sweep_loss_text(store, keys)] if keys else [])
        if not (arguments.yes or _confirm(losses)):
            say("nothing was deleted")
            return ExitCode.OK
        count = sum(store.delete_run(number) for number in runs) + (store.delete_sweeps(keys) if keys else 0)
    of_runs = f"{plural(len(runs), 'run')} and " if runs else ""
    say(f"{of_runs}{plural(count, 'sweep')} deleted")
    return ExitCode.OK


def _confirm(losses: list[str]) -> bool:
    """Ask for confirmation; FraexpError without a terminal to ask on."""
    for loss in losses:
        say(f"will be deleted: {loss}")
    if not sys.stdin.isatty():
        raise FraexpError("delete: cannot ask for confirmation without a terminal; give --yes")
    print("delete? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")
