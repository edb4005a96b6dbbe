"""``fraexp undelete``: bring runs and sweeps back from the trash."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.data.identity import key_heads
from fraexp.errors import FraexpError
from fraexp.store import Deletion
from fraexp.views.deletion import deletion_text


def execute(arguments: Namespace) -> ExitCode:
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
