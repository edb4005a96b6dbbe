"""``fraexp list``: the runs, the studies, or the sweeps that match a filter."""

from argparse import Namespace
from collections.abc import Callable
from typing import Any

from fraexp.cli.documents import listed_document, run_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.sweep_lookup import workspace_folder
from fraexp.errors import FraexpError
from fraexp.figures.result_files import json_value
from fraexp.store import RunSummary, Store, parse_filter
from fraexp.views.fields import run_duration_text, run_state_text
from fraexp.views.listing import complete_field, listing_columns
from fraexp.views.words import plural, timestamp_text

SORT_KEYS: dict[str, Callable[[RunSummary], Any]] = {
    "run": lambda run: run.number,
    "study": lambda run: run.study,
    "state": run_state_text,
    "sweeps": lambda run: run.total,
    "computed": lambda run: run.computed,
    "reused": lambda run: run.reused,
    "failed": lambda run: run.failed,
    "unusable": lambda run: run.unusable,
    "started": lambda run: run.started,
    "took": lambda run: (run.ended or run.heartbeat) - run.started,
}
"""The columns of runs, by which they can be sorted."""


def execute(arguments: Namespace) -> ExitCode:
    """Print the runs, studies or sweeps."""
    sweeps = bool(arguments.filter or arguments.sweeps)
    if arguments.studies and sweeps:
        raise FraexpError("list: --studies lists studies, a filter lists sweeps; give only one of them")
    if arguments.studies and arguments.sort:
        raise FraexpError("list: --sort sorts runs or sweeps, not studies; leave one of both out")
    if arguments.limit < 0:
        raise FraexpError("list: --limit is a number of sweeps; expected 0 or more")
    (_list_studies if arguments.studies else _list_sweeps if sweeps else _list_runs)(arguments)
    return ExitCode.OK


def _list_runs(arguments: Namespace) -> None:
    """Print the runs, newest first."""
    with workspace_folder(arguments).open_store() as store:
        runs = _sort_runs(store.runs(), arguments.sort)
    if arguments.json:
        print_json({"runs": [run_document(run) for run in runs]})
    elif runs:
        print_table(list(SORT_KEYS), [_run_row(run) for run in runs])
    else:
        say("no runs yet; start one with: fraexp run STUDY")


def _sort_runs(runs: list[RunSummary], order: str) -> list[RunSummary]:
    """Return runs sorted by one of SORT_KEYS, with a leading - in descending order; FraexpError for another name."""
    if not order:
        return runs
    field = complete_field(order, SORT_KEYS, {})
    return sorted(runs, key=SORT_KEYS[field.removeprefix("-")], reverse=field.startswith("-"))


def _run_row(run: RunSummary) -> list[str]:
    counts = (run.total, run.computed, run.reused, run.failed, run.unusable)
    return [
        str(run.number),
        run.study,
        run_state_text(run),
        *(str(count) for count in counts),
        timestamp_text(run.started),
        run_duration_text(run),
    ]


def _list_sweeps(arguments: Namespace) -> None:
    """Print the sweeps that match a filter."""
    wanted = " ".join(arguments.filter)
    folder = workspace_folder(arguments)
    with folder.open_store() as store:
        order = complete_field(arguments.sort, store.fields()) if arguments.sort else "-created"
        page = store.page(wanted, order, limit=arguments.limit, run=_asked_run(store, wanted))
    if arguments.json:
        sweeps = [listed_document(of) for of in page.rows]
        print_json({"total": page.total, "sweeps": sweeps})
        return
    columns = listing_columns(page.rows, one_run=False, running={}, registry=folder.registry if page.rows else None)
    rows = [[column.cells[index] for column in columns] for index in range(len(page.rows))]
    if rows:
        print_table([column.title for column in columns], rows)
    elif not page.total:
        say(f"no sweep matches {wanted}" if wanted.strip() else "no sweeps yet; a run creates them")
    left_out = page.total - len(rows)
    if rows and left_out > 0:
        say(f"{plural(left_out, 'more sweep')} of {page.total}; use --limit to see them")


def _asked_run(store: Store, wanted: str) -> int | None:
    """Return the run that a filter asks for, whose labels its sweeps then have; None without one."""
    asked = [of.value for of in parse_filter(wanted) if of.field == "run" and of.operator == "="]
    known = {str(run.number): run.number for run in store.runs()} if asked else {}
    return known.get(asked[0]) if len(asked) == 1 else None


def _list_studies(arguments: Namespace) -> None:
    """Print the studies, and what running them would compute."""
    from fraexp.views.study import STUDY_COLUMNS, study_document, study_row, survey_studies
    from fraexp.workspace.workspace_service import WorkspaceService

    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    entries = workspace.catalogue()
    found = {one.name: one for one in survey_studies(workspace, entries)}
    runs: dict[str, RunSummary] = {}
    if workspace.has_database():
        with workspace.open_store() as store:
            runs = {run.study: run for run in reversed(store.runs())}  # the newest
    if arguments.json:
        print_json(
            {"studies": [json_value(study_document(of, found.get(of.name), runs.get(of.name))) for of in entries]}
        )
        return
    print_table(STUDY_COLUMNS, [study_row(of, found.get(of.name), runs.get(of.name)) for of in entries])
    for entry in entries:
        if found[entry.name].error:
            say(f"{entry.name}: {found[entry.name].error}")
