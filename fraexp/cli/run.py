"""``fraexp run``: compute what studies ask for, and show what came out."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.selection import database
from fraexp.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Run the studies and print their sweeps."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    events = workspace.run(arguments.study, arguments.executor, arguments.overrides, arguments.dry_run, arguments.rerun)
    return report(follow(events), arguments, workspace)
