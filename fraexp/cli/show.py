"""``fraexp show``: a run with its sweeps, or a sweep with its parameters and results."""

from argparse import Namespace
from collections.abc import Sequence

from fraexp.cli.documents import run_document, sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_line, print_table, say
from fraexp.cli.summary import ALL_REMEDY, needs_summary, print_summary
from fraexp.cli.sweep_lookup import find_run_number, find_sweeps, workspace_folder
from fraexp.data.results import Fit, Result
from fraexp.data.rotary_axes import is_rotary
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError
from fraexp.figures.elements.scales import PLANT_UNITS
from fraexp.figures.result_files import json_value
from fraexp.reports.published_comparisons import comparison_document, verdict
from fraexp.store import RunSummary, Store, StoredSweep, mark_damaged
from fraexp.study.published_values import PublishedComparison
from fraexp.study.study_file import stated_controller
from fraexp.views import result_rows
from fraexp.views.fields import drawn_labels, remedies, run_fields, sweep_fields
from fraexp.views.loop_margins_table import LOOP_COLUMNS, loop_margins, loop_rows
from fraexp.views.report_tables import published_table
from fraexp.views.resolved_parameters import resolved_parameters
from fraexp.views.text_tables import response_table, sweep_table
from fraexp.views.words import plural

MAX_RESPONSE_ROWS = 12
"""Maximum number of response rows without ``--points``."""


def execute(arguments: Namespace) -> ExitCode:
    """Print a run or a sweep."""
    with workspace_folder(arguments).open_store() as store:
        number_ = find_run_number(store, arguments.id)
        if number_ is None:
            _show_sweep(store, arguments).check_sound()
        else:
            _show_run(store, number_, arguments)
    return ExitCode.OK


def _show_run(store: Store, number_: int, arguments: Namespace) -> None:
    from fraexp.reports.published_comparisons import compare_run

    if arguments.controller:
        raise FraexpError("--controller closes the loop around the response of one sweep; give the key of a sweep")
    run, sweeps = store.run(number_), find_sweeps(store, arguments.id)
    results = store.results(sweep.key for sweep in sweeps)
    sweeps = mark_damaged(sweeps, results)
    say_recomputed(run, sweeps)
    compared = compare_run(run, sweeps, results, workspace_folder(arguments).folder)
    if arguments.json:
        documents = [sweep_document(sweep, results.get(sweep.key), arguments.points) for sweep in sweeps]
        published = [comparison_document(one) for one in compared]
        print_json({**run_document(run), "sweeps": documents, "published": published})
        return
    print_fields(run_fields(run))
    print()
    registry = workspace_folder(arguments).registry
    if needs_summary(len(sweeps)):
        print_summary(sweeps, results, registry)
        say(ALL_REMEDY)
    else:
        print_table(*sweep_table(sweeps, results, registry))
    print_published(compared)
    for remedy in remedies(sweeps):
        say(remedy)


def say_recomputed(run: RunSummary, sweeps: Sequence[StoredSweep]) -> None:
    """Report how many sweeps of the run have been computed again since it ended."""
    again = [sweep for sweep in sweeps if run.ended and sweep.created and sweep.created > run.ended]
    if again:
        have = "has" if len(again) == 1 else "have"
        say(f"{len(again)} of {plural(run.total, 'sweep')} {have} been recomputed since; the new results are shown")


def _show_sweep(store: Store, arguments: Namespace) -> StoredSweep:
    """Print a sweep, and return it with the outcome that was found."""
    sweep = store.find(arguments.id)
    results, log = store.results([sweep.key]), store.log(sweep.key)
    result = results.get(sweep.key)
    (sweep,) = mark_damaged([sweep], results)
    around = _controller_around(arguments, result)
    if arguments.json:
        figures = loop_margins(sweep, result, workspace_folder(arguments).registry, around)
        print_json({**sweep_document(sweep, result), "loop": [json_value(figure._asdict()) for figure in figures]})
        return sweep
    print_fields(sweep_fields(sweep, workspace_folder(arguments).registry))
    print("\nparameters")
    drawn, registry = drawn_labels(sweep.labels), workspace_folder(arguments).registry
    parameters = resolved_parameters(sweep, registry)
    print_fields([(of.path, f"{of.quantity}{drawn.get(of.path, '')}") for of in parameters], indent=2)
    print("\nprovided by")
    sources = sweep.sources.items()
    print_fields([(name, f"{of.distribution}, source {of.source_hash[:12]}") for name, of in sources], indent=2)
    if result is not None:
        _show_result(
            result,
            None if arguments.points else MAX_RESPONSE_ROWS,
            loop_rows(loop_margins(sweep, result, registry, around)),
        )
    if log:
        print("\nlog")
        for line in log.splitlines():
            print_line(line)
    return sweep


def _controller_around(arguments: Namespace, result: Result | None) -> Plain | None:
    """Return controller and loop of the study or machine that was given; FraexpError if the sweep has no plant."""
    if not arguments.controller:
        return None
    unit = result.response.unit if result and result.response else ""
    if unit not in PLANT_UNITS:
        raise FraexpError(
            f"--controller: the sweep has {f'a response in {unit}' if unit else 'no response'}; expected one in "
            f"{' or '.join(PLANT_UNITS)}, from thrust to position"
        )
    folder = workspace_folder(arguments)
    sections = stated_controller(arguments.controller, folder.folder, folder.registry)
    if is_rotary(sections) != unit.startswith("rad"):
        kinds = "turns" if is_rotary(sections) else "moves straight", unit
        raise FraexpError(f"--controller: {arguments.controller} {kinds[0]}; the response is in {kinds[1]}")
    return sections


def _show_result(result: Result, rows: int | None, loop: Sequence[Sequence[str]]) -> None:
    if result.numerics:
        print_fields([("numerics", result.numerics)])
    if result.metrics:
        print("\nmetrics")
        print_fields(result_rows.metric_fields(result), indent=2)
    if loop:
        print()
        print_table(LOOP_COLUMNS, loop)
    if result.response is not None:
        print()
        print_line(f"response {result.response.output}/{result.response.input}")
        print_table(*response_table(result.response, rows, result.parity_levels))
        left_out = len(result.response.frequency) - (rows or len(result.response.frequency))
        if left_out > 0:
            say(f"{plural(left_out, 'more frequency', 'more frequencies')}; --points shows all")
    for fit in result.fits:
        _show_fit(fit)
    for curve in result.curves:
        print()
        heading, points = result_rows.curve_table(curve)
        if len(points) > result_rows.MAX_CURVE_ROWS:
            print_line(f"curve {result_rows.curve_text(curve)}", "  ")
        else:
            print_line(f"curve {curve.name}")
            print_table(heading, points)


def _show_fit(fit: Fit) -> None:
    """Print the identified parameters, and a section of a study that uses them."""
    print(f"\nfit of the {fit.kind}")
    print_table(result_rows.FIT_COLUMNS, result_rows.fit_rows(fit))
    print()
    for line in result_rows.fit_section(fit):
        print_line(line, "    ")


def print_published(compared: Sequence[PublishedComparison]) -> None:
    """Print the published numbers beside ours, and how many are met."""
    table = published_table(compared)
    if table:
        print()
        rows = [[*(cell.text for cell in row), row[0].detail] for row in table.rows]
        print_table([*table.titles, "note"], rows)
        say(verdict(compared))
