"""``fraexp report``: stored runs as one HTML file."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path, say
from fraexp.cli.sweep_lookup import find_run_number
from fraexp.errors import FraexpError
from fraexp.reports.published_comparisons import verdict
from fraexp.store import Store
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Write the report of runs, and print its path."""
    from fraexp.views.html_report import check_target, report_runs

    check_target(arguments.output, arguments.force)
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        runs = list(dict.fromkeys(number for text in arguments.ids for number in _run_numbers(store, text)))
        title = arguments.title or (f"Report: {', '.join(arguments.ids)}" if len(runs) > 1 else "")
        compared = report_runs(workspace, store, runs, arguments.output, title)
    print_path(arguments.output, "report ")
    for one in compared:
        if one.remark:
            say(f"published value '{one.published.what}': {one.remark}")
    if compared:
        say(verdict(compared))
    return ExitCode.INCOMPLETE if any(one.remark for one in compared) else ExitCode.OK


def _run_numbers(store: Store, identifier: str) -> list[int]:
    """Return the run of a number or study name; for a folder name, the newest run with results of each study in it.

    Runs of fits are named after the folder too, but have no study file.
    """
    number = find_run_number(store, identifier)
    if number is not None:
        return [store.run(number).number]
    inside = f"{identifier.rstrip('/')}/"
    studies = [run for run in reversed(store.runs()) if run.study_file.endswith(".toml") and run.computed + run.reused]
    newest = {run.study: run.number for run in studies if run.study.startswith(inside)}
    if not newest:
        raise FraexpError(f"report: no run of '{identifier}' has results; fraexp list shows runs and studies")
    return [newest[study] for study in sorted(newest)]
