"""``fraexp show``: a run with its sweeps, or a sweep with its parameters and numbers."""

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from fraexp.cli.documents import run_document, sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_table, say
from fraexp.cli.summary import print_summary, to_summarise
from fraexp.cli.sweep_lookup import open_store, run_of
from fraexp.components.registry import discover
from fraexp.data.results import Fit, Result
from fraexp.figures.elements.labels import printable
from fraexp.store import RunSummary, Store, StoredSweep
from fraexp.views.fields import remedies, run_fields, sweep_fields
from fraexp.views.result_rows import FIT_COLUMNS, curve_text, fit_rows, fit_section, metric_fields
from fraexp.views.text_tables import response_table, sweep_table
from fraexp.views.words import flat, plural, value_text, without_segments

ROWS = 12
"""Rows of a response that are shown unless all are asked for."""


def execute(arguments: Namespace) -> ExitCode:
    """Print a run or a sweep."""
    with open_store(arguments) as store:
        number_ = run_of(store, arguments.id)
        if number_ is None:
            _show_sweep(store, arguments)
        else:
            _show_run(store, number_, arguments)
    return ExitCode.OK


def _show_run(store: Store, number_: int, arguments: Namespace) -> None:
    run, sweeps = store.run(number_), store.sweeps(number_)
    results = store.results(sweep.key for sweep in sweeps)
    say_recomputed(run, sweeps)
    if arguments.json:
        documents = [sweep_document(sweep, results.get(sweep.key), arguments.points) for sweep in sweeps]
        print_json({**run_document(run), "sweeps": documents})
        return
    print_fields(run_fields(run))
    print()
    registry = discover(Path(arguments.workspace) / "plugins")
    if to_summarise(len(sweeps)) and not arguments.all:
        print_summary(sweeps, results, registry)
        say("--all shows each sweep")
    else:
        print_table(*sweep_table(sweeps, results, registry))
    for remedy in remedies(sweeps):
        say(remedy)


def say_recomputed(run: RunSummary, sweeps: Sequence[StoredSweep]) -> None:
    """Say how many of the run's sweeps have been computed again since it ended."""
    again = [sweep for sweep in sweeps if run.ended and sweep.created and sweep.created > run.ended]
    if again:
        have = "has" if len(again) == 1 else "have"
        say(f"{len(again)} of {plural(run.total, 'sweep')} {have} been computed again since; the new results are shown")


def _show_sweep(store: Store, arguments: Namespace) -> None:
    sweep = store.find(arguments.id)
    result, log = store.results([sweep.key]).get(sweep.key), store.log(sweep.key)
    if arguments.json:
        print_json(sweep_document(sweep, result))
        return
    print_fields(sweep_fields(sweep))
    print("\nparameters")
    parameters = flat({**without_segments(sweep.experiment), "estimator": sweep.estimator})
    print_fields([(path, value_text(value)) for path, value in parameters.items()], indent=2)
    print("\nsupplied by")
    sources = sweep.sources.items()
    print_fields([(name, f"{of.distribution}, source {of.source_hash[:12]}") for name, of in sources], indent=2)
    if result is not None:
        _show_result(result, None if arguments.points else ROWS)
    if log:
        print("\nlog")
        print("\n".join(printable(line) for line in log.splitlines()))


def _show_result(result: Result, rows: int | None) -> None:
    if result.numerics:
        print_fields([("numerics", result.numerics)])
    if result.metrics:
        print("\nmetrics")
        print_fields(metric_fields(result), indent=2)
    if result.response is not None:
        print(f"\nresponse {result.response.output}/{result.response.input}")
        print_table(*response_table(result.response, rows))
        left_out = len(result.response.frequency) - (rows or len(result.response.frequency))
        if left_out > 0:
            say(f"{plural(left_out, 'more frequency', 'more frequencies')}; --points shows all")
    for fit in result.fits:
        _show_fit(fit)
    for curve in result.curves:
        print(f"\ncurve {printable(curve_text(curve))}")


def _show_fit(fit: Fit) -> None:
    """Print what was identified, and the section of a study that uses it."""
    print(f"\nfit of the {fit.kind}")
    print_table(FIT_COLUMNS, fit_rows(fit))
    print()
    for line in fit_section(fit):
        print(printable(line))
