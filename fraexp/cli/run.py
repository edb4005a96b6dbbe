"""``fraexp run`` and ``fraexp stop``: compute the missing sweeps of studies, and show the results; or stop."""

import shlex
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, print_outcome
from fraexp.cli.output import print_json, print_path, say
from fraexp.errors import StudyError
from fraexp.execution.executors import ResourceLimits
from fraexp.execution.scheduler import RunOptions
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Run the studies and print their sweeps."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    if arguments.detach:
        return _detach(arguments, workspace)
    limits = ResourceLimits.parse(arguments.time_limit, arguments.memory_limit, arguments.database_timeout)
    events = workspace.run(
        arguments.study, arguments.executor, arguments.overrides, arguments.dry_run, arguments.rerun, limits
    )
    followed = follow(events)
    return print_outcome(followed, arguments, workspace)


def _detach(arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Start the run in the background, and print its log file; invalid options are reported here, not there."""
    if arguments.dry_run:
        raise StudyError("--detach starts a run, --dry-run computes nothing; give only one of them")
    limits = ResourceLimits.parse(arguments.time_limit, arguments.memory_limit, arguments.database_timeout)
    RunOptions(arguments.executor, arguments.rerun, limits).check()
    workspace.studies(arguments.study, arguments.overrides)
    started = workspace.launch(arguments.study, arguments.overrides, arguments.executor, arguments.rerun, limits, True)
    number = started.await_begin()
    if arguments.json:
        print_json({"started": {"pid": started.pid, "run": number, "log": str(started.log)}})
        return ExitCode.OK
    here = workspace.shown_options()
    if number is None:
        say(f"process {started.pid} prepares its run; fraexp list{here} shows it as soon as it has begun")
    else:
        say(f"started as run {number}; fraexp show {number}{here} shows it, fraexp stop {number}{here} stops it")
    print_path(started.log, "log ")
    return ExitCode.OK


def stop(arguments: Namespace) -> ExitCode:
    """Ask a run on this machine to stop, or kill its processes."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        run = store.run(arguments.run)
    workspace.stop(run, arguments.kill)
    what = "is killed; stored results are kept" if arguments.kill else "is stopping; finished sweeps are kept"
    say(f"run {run.number} {what}, fraexp run {shlex.quote(run.study)}{workspace.shown_options()} continues it")
    return ExitCode.OK
