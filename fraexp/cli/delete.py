"""``fraexp delete`` and ``fraexp undelete``: runs and sweeps move to the trash, and come back."""

import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import ask, say
from fraexp.cli.sweep_lookup import find_run_number, workspace_folder
from fraexp.data.identity import key_heads
from fraexp.errors import FraexpError
from fraexp.store import Deletion
from fraexp.views.deletion import deletion_text, run_loss_text, sweep_loss_text


def delete(arguments: Namespace) -> ExitCode:
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
            raise FraexpError(f"delete: '{named}' is a study; expected a run number, such as {found[named]}")
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
    if ask("delete?"):
        return True
    say("nothing was deleted")
    return False


def undelete(arguments: Namespace) -> ExitCode:
    """Bring back what is named, or else what was deleted last."""
    with workspace_folder(arguments).open_store("write") as store:
        trash = store.trash()
        if not trash:
            raise FraexpError("undelete: the trash is empty")
        runs, keys = _find_deleted(trash, arguments.ids)
        restored = store.undelete(keys, runs)
    say(f"{deletion_text(len(restored.runs), len(restored.keys))} brought back")
    if newer := set(keys) - set(restored.keys):
        named = ", ".join(key[4:12] for key in sorted(newer)[:8])
        say(f"{deletion_text(0, len(newer))} left in the trash: computed again since, with newer results: {named}")
    return ExitCode.OK


def _find_deleted(trash: list[Deletion], identifiers: list[str]) -> tuple[list[int], list[str]]:
    """Return the deleted runs and sweeps with these numbers and beginnings of keys."""
    runs = {str(number): number for of in trash for number in of.runs}
    keys = [key for of in trash for key in of.keys]
    found_runs, found_keys = [], []
    for identifier in identifiers:
        found = [key for key in keys if any(key.startswith(head) for head in key_heads(identifier))]
        if identifier in runs:
            found_runs.append(runs[identifier])
        elif len(found) == 1:
            found_keys += found
        elif found:
            raise FraexpError(f"undelete: several deleted sweeps' keys start with '{identifier}'; give more characters")
        else:
            known = [*(f"run {number}" for number in runs), *(f"sweep {key[4:12]}" for key in keys)]
            more = ", ..." if len(known) > 8 else ""
            raise FraexpError(f"undelete: '{identifier}' is not in the trash, which has {', '.join(known[:8])}{more}")
    return found_runs, found_keys
