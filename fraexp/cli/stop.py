"""``fraexp stop``: stop a run on this machine, in the background or elsewhere."""

import shlex
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import say
from fraexp.cli.sweep_lookup import location_options
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Ask the run to stop, or kill its processes."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        run = store.run(arguments.run)
    workspace.stop(run, arguments.kill)
    what = "is killed; stored results are kept" if arguments.kill else "is stopping; finished sweeps are kept"
    say(f"run {run.number} {what}, fraexp run {shlex.quote(run.study)}{location_options(arguments)} continues it")
    return ExitCode.OK
