"""``fraexp run``: compute what studies ask for, and show what came out."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.output import print_json, print_path, say
from fraexp.cli.report import report_folders
from fraexp.cli.sweep_lookup import database, place
from fraexp.errors import StudyError
from fraexp.execution.executors import ResourceLimits, workers_of
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Run the studies and print their sweeps."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    if arguments.detach:
        return _detach(arguments, workspace)
    limits = ResourceLimits.parse(arguments.time_limit, arguments.memory)
    events = workspace.run(
        arguments.study, arguments.executor, arguments.overrides, arguments.dry_run, arguments.rerun, limits
    )
    story = follow(events)
    code = report(story, arguments, workspace)
    runs = [ended.run for ended in story.ended if ended.run is not None]
    if runs and not story.interrupted:
        report_folders(arguments, runs, workspace)
    return code


def _detach(arguments: Namespace, workspace: Workspace) -> ExitCode:
    """Start the run in the background, and tell where its log is; what does not fit is told here, not in the log."""
    if arguments.dry_run:
        raise StudyError("--detach runs in the background, --dry-run runs nothing; give one of them")
    workers_of(arguments.executor or "processes")
    limits = ResourceLimits.parse(arguments.time_limit, arguments.memory)
    limits.check(arguments.executor)
    workspace.studies(arguments.study, arguments.overrides)
    started = workspace.launch(arguments.study, arguments.overrides, arguments.executor, arguments.rerun, limits)
    if arguments.json:
        print_json({"started": {"pid": started.pid, "log": str(started.log)}})
        return ExitCode.OK
    here = place(arguments)
    say(f"started as process {started.pid}; fraexp list{here} has its run, fraexp stop RUN{here} ends it")
    print_path(started.log, "log ")
    return ExitCode.OK
