"""``fraexp export``: the result of a sweep as a file for other programs."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_path
from fraexp.cli.sweep_lookup import find_run_number, find_sweeps, workspace_folder
from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.figures.result_files import WRITERS, export, json_value
from fraexp.reports.published_comparisons import compare_sweep, comparison_document
from fraexp.store import StoredSweep
from fraexp.views.words import short_key
from fraexp.workspace.controller_export import CONTROLLER_SUFFIXES, export_controller
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Write one sweep, and print the file's path."""
    with workspace_folder(arguments).open_store() as store:
        sweeps = find_sweeps(store, arguments.id)
        if len(sweeps) != 1:
            some = ", ".join(short_key(sweep.key) for sweep in sweeps[:6]) + (", ..." if len(sweeps) > 6 else "")
            run = f"run {find_run_number(store, arguments.id)}"
            raise FraexpError(f"export: {run} has {len(sweeps)} sweeps; expected one of them: {some}")
        sweeps[0].check_sound()
        result = store.result(sweeps[0].key)
        suffix, known = arguments.output.suffix, (*WRITERS, *CONTROLLER_SUFFIXES)
        if suffix.lower() not in known:
            name = arguments.output.name
            raise FraexpError(f"{name}: '{suffix}' is not an export format; known: {', '.join(known)}")
        if suffix.lower() in CONTROLLER_SUFFIXES:
            return _export_code(sweeps[0], result, arguments)
        published = compare_sweep(store, sweeps[0], result, workspace_folder(arguments).folder)
    header = {
        "key": sweeps[0].key,
        "labels": json_value(sweeps[0].labels),
        "created": json_value(sweeps[0].created),
        "experiment": json_value(sweeps[0].experiment),
        "estimator": json_value(sweeps[0].estimator),
        "published": [comparison_document(one) for one in published],
        "models": WorkspaceService.open(arguments.workspace, arguments.db).models(result),
    }
    export(result, header, arguments.output, force=arguments.force)
    print_path(arguments.output)
    return ExitCode.OK


def _export_code(sweep: StoredSweep, result: Result, arguments: Namespace) -> ExitCode:
    """Write the controller of a sweep as code."""
    service = workspace_folder(arguments)
    export_controller(service, sweep, result, arguments.output, is_single=arguments.single, force=arguments.force)
    print_path(arguments.output)
    return ExitCode.OK
