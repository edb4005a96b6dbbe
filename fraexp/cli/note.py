"""``fraexp note``: write a note on a sweep."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import database
from fraexp.store import Store
from fraexp.views.words import short


def execute(arguments: Namespace) -> ExitCode:
    """Change the note of a sweep."""
    with Store.open(database(arguments)) as store:
        key = store.find(arguments.id).key
        store.annotate(key, arguments.text)
    say(f"sweep {short(key)} {'has the note' if arguments.text.strip() else 'has no note'} now")
    return ExitCode.OK
