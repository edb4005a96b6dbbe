"""``fraexp list``: the runs."""

from argparse import Namespace

from fraexp.cli.documents import run_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.selection import open_store
from fraexp.cli.terminal import print_json, print_table, say
from fraexp.store import RunSummary
from fraexp.views.fields import took
from fraexp.views.words import moment

COLUMNS = ["run", "study", "state", "sweeps", "computed", "reused", "failed", "started", "took"]


def execute(arguments: Namespace) -> ExitCode:
    """Print the runs, newest first."""
    with open_store(arguments) as store:
        runs = store.runs()
    if arguments.json:
        print_json({"runs": [run_document(run) for run in runs]})
    elif runs:
        print_table(COLUMNS, [_row(run) for run in runs])
    else:
        say("there is no run yet; start one with: fraexp run STUDY")
    return ExitCode.OK


def _row(run: RunSummary) -> list[str]:
    counts = (run.total, run.computed, run.reused, run.failed)
    return [str(run.number), run.study, run.state, *(str(count) for count in counts), moment(run.started), took(run)]
