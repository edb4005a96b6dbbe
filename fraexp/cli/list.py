"""``fraexp list``: the runs, the studies, or the sweeps that a filter finds."""

from argparse import Namespace
from dataclasses import asdict

from fraexp.cli.documents import plain, run_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.sweep_lookup import database, open_store
from fraexp.errors import FraexpError
from fraexp.store import RunSummary, Store
from fraexp.views.fields import took
from fraexp.views.listing import listing_columns
from fraexp.views.words import moment, plural

COLUMNS = ["run", "study", "state", "sweeps", "computed", "reused", "failed", "started", "took"]


def execute(arguments: Namespace) -> ExitCode:
    """Print what is asked for."""
    sweeps = bool(arguments.filter or arguments.sweeps)
    if arguments.studies and sweeps:
        raise FraexpError("list: --studies lists the studies, a filter the sweeps; give one of them")
    if min(arguments.limit, arguments.offset) < 0:
        raise FraexpError("list: --limit and --offset count sweeps; expected 0 or more")
    (_list_studies if arguments.studies else _list_sweeps if sweeps else _list_runs)(arguments)
    return ExitCode.OK


def _list_runs(arguments: Namespace) -> None:
    """Print the runs, newest first."""
    with open_store(arguments) as store:
        runs = store.runs()
    if arguments.json:
        print_json({"runs": [run_document(run) for run in runs]})
    elif runs:
        print_table(COLUMNS, [_run_row(run) for run in runs])
    else:
        say("there is no run yet; start one with: fraexp run STUDY")


def _run_row(run: RunSummary) -> list[str]:
    counts = (run.total, run.computed, run.reused, run.failed)
    return [str(run.number), run.study, run.state, *(str(count) for count in counts), moment(run.started), took(run)]


def _list_sweeps(arguments: Namespace) -> None:
    """Print the sweeps that a filter finds."""
    wanted = " ".join(arguments.filter)
    with open_store(arguments) as store:
        page = store.page(wanted, arguments.order, arguments.offset, arguments.limit)
    if arguments.json:
        print_json({"total": page.total, "offset": arguments.offset, "sweeps": [plain(asdict(of)) for of in page.rows]})
        return
    columns = listing_columns(page.rows, one_run=False, running={})
    rows = [[column.cells[index] for column in columns] for index in range(len(page.rows))]
    if rows:
        print_table([column.title for column in columns], rows)
    elif page.total:
        say(f"{plural(page.total, 'sweep')}, all before --offset {arguments.offset}")
    else:
        say(f"no sweep matches {wanted}" if wanted.strip() else "there is no sweep yet; a run makes them")
    left_out = page.total - arguments.offset - len(rows)
    if rows and left_out > 0:
        say(f"{plural(left_out, 'more sweep')} of {page.total}; --limit and --offset choose which are listed")


def _list_studies(arguments: Namespace) -> None:
    """Print the studies in the order of their list, and what running them would do."""
    from fraexp.views.study import STUDY_COLUMNS, newest, study_document, study_row, survey
    from fraexp.workspace.workspace import Workspace

    workspace = Workspace.open(arguments.workspace, database(arguments))
    entries = workspace.catalogue()
    found = {one.name: one for one in survey(workspace, entries)}
    runs: dict[str, RunSummary] = {}
    if workspace.has_database():
        with Store.open(workspace.database, read_only=True) as store:
            runs = newest(store.runs())
    if arguments.json:
        print_json({"studies": [plain(study_document(of, found.get(of.name), runs.get(of.name))) for of in entries]})
        return
    print_table(STUDY_COLUMNS, [study_row(of, found.get(of.name), runs.get(of.name)) for of in entries])
    for entry in entries:
        if found[entry.name].error:
            say(f"{entry.name}: {found[entry.name].error}")
