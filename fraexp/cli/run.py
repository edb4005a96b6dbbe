"""``fraexp run``: compute what studies ask for, and show what came out."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.report import report_folders
from fraexp.cli.selection import database
from fraexp.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Run the studies and print their sweeps."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    events = workspace.run(arguments.study, arguments.executor, arguments.overrides, arguments.dry_run, arguments.rerun)
    story = follow(events)
    code = report(story, arguments, workspace)
    runs = [ended.run for ended in story.ended if ended.run is not None]
    if runs and not story.interrupted:
        report_folders(arguments, runs, workspace)
    return code
