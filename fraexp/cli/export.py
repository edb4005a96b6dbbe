"""``fraexp export``: a sweep's result as a file for other programs."""

from argparse import Namespace

from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path
from fraexp.cli.sweep_lookup import database, open_store, run_of, sweeps_of
from fraexp.errors import FraexpError
from fraexp.figures.export import export
from fraexp.views.words import short
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Write one sweep, and print the file's path."""
    with open_store(arguments) as store:
        sweeps = sweeps_of(store, arguments.id)
        if len(sweeps) != 1:
            some = ", ".join(short(sweep.key) for sweep in sweeps[:6]) + (", ..." if len(sweeps) > 6 else "")
            run = f"run {run_of(store, arguments.id)}"
            raise FraexpError(f"export: {run} has {len(sweeps)} sweeps; name one of them: {some}")
        result = store.result(sweeps[0].key)
    header = {
        "key": sweeps[0].key,
        "labels": plain(sweeps[0].labels),
        "created": plain(sweeps[0].created),
        "experiment": plain(sweeps[0].experiment),
        "estimator": plain(sweeps[0].estimator),
        "models": Workspace.open(arguments.workspace, database(arguments)).models(result),
    }
    export(result, header, arguments.output, force=arguments.force)
    print_path(arguments.output)
    return ExitCode.OK
