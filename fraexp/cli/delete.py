"""``fraexp delete``: move runs or sweeps to the trash, or empty it."""

import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import find_run_number, workspace_folder
from fraexp.errors import FraexpError
from fraexp.views.deletion import deletion_text, run_loss_text, sweep_loss_text


def execute(arguments: Namespace) -> ExitCode:
    """Delete the named runs and sweeps, or empty the trash, after confirmation."""
    if bool(arguments.ids) == arguments.purge:
        raise FraexpError("delete: expected runs or sweeps to delete, or --purge to empty the trash")
    with workspace_folder(arguments).open_store("write") as store:
        if arguments.purge:
            deletions = store.trash()
            losses = [deletion_text(sum(len(of.runs) for of in deletions), sum(len(of.keys) for of in deletions))]
            if _is_confirmed(arguments, [f"{losses[0]} in the trash, for good"]):
                gone = store.empty_trash()
                say(f"{deletion_text(len(gone.runs), len(gone.keys))} deleted for good")
            return ExitCode.OK
        found = {identifier: find_run_number(store, identifier) for identifier in arguments.ids}
        named = next((of for of, number in found.items() if number is not None and str(number) != of), None)
        if named:  # by its study
            raise FraexpError(f"delete: '{named}' is a study; expected a run number (its newest run is {found[named]})")
        runs = list(dict.fromkeys(number for number in found.values() if number is not None))
        keys = list(dict.fromkeys(store.find(of).key for of, number in found.items() if number is None))
        losses = [run_loss_text(store, number) for number in runs] + ([sweep_loss_text(store, keys)] if keys else [])
        if _is_confirmed(arguments, losses):
            count = store.delete(keys, runs)
            say(f"{deletion_text(len(runs), count)} deleted; 'fraexp undelete' brings this back")
    return ExitCode.OK


def _is_confirmed(arguments: Namespace, losses: list[str]) -> bool:
    """Return whether the user agrees; FraexpError without a terminal to ask on."""
    if arguments.yes:
        return True
    for loss in losses:
        say(f"will be deleted: {loss}")
    if not sys.stdin.isatty():
        raise FraexpError("delete: cannot ask for confirmation without a terminal; give --yes")
    print("delete? [y/N] ", end="", file=sys.stderr, flush=True)
    is_agreed = sys.stdin.readline().strip().casefold() in ("y", "yes")
    if not is_agreed:
        say("nothing was deleted")
    return is_agreed
