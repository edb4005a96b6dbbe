"""``fraexp note``: a note on a sweep."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.views.words import short_key


def execute(arguments: Namespace) -> ExitCode:
    """Change the note of a sweep."""
    with workspace_folder(arguments).open_store("write") as store:
        key = store.find(arguments.id).key
        store.annotate(key, arguments.text)
    say(f"note {'saved on' if arguments.text.strip() else 'removed from'} sweep {short_key(key)}")
    return ExitCode.OK
