"""``fraexp restore``: a checked copy in the place of the database, or a copy of it elsewhere."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.store import masked_url
from fraexp.views.words import plural


def execute(arguments: Namespace) -> ExitCode:
    """Restore the database, and print what it contains and where the earlier one is."""
    workspace = workspace_folder(arguments)
    aside = workspace.restore_database(arguments.copy)
    with workspace.open_store() as store:
        contents = f"{plural(len(store.runs()), 'run')} and {plural(store.page(limit=0).total, 'sweep')}"
    say(f"{masked_url(workspace.database)}: a copy of {masked_url(arguments.copy)}, with {contents}")
    if aside:
        say(f"the earlier database is {aside}")
    return ExitCode.OK
