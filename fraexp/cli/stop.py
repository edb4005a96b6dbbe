"""``fraexp stop``: end a run that goes on in the background, or anywhere else on this machine."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import database, open_store
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Ask the run to end, or end its processes."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    with open_store(arguments) as store:
        run = store.run(arguments.run)
    workspace.stop(run, arguments.hard)
    what = "is ended; what was stored stays" if arguments.hard else "is asked to end; what is finished is kept"
    say(f"run {run.number} {what}, and fraexp run {run.study} goes on from there")
    return ExitCode.OK
