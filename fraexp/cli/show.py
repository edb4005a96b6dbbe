"""``fraexp show``: a run with its sweeps, or a sweep with its parameters and numbers."""

import json
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.cli.documents import run_document, sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.list import took
from fraexp.cli.selection import open_store, run_of
from fraexp.cli.summary import print_summary, to_summarise
from fraexp.cli.tables import outcome_text, response_table, sweep_table
from fraexp.cli.terminal import print_fields, print_json, print_table, say
from fraexp.cli.words import duration, flat, moment, number, plural, short, value_text, without_segments
from fraexp.confidence import interval_factor
from fraexp.figures.labels import label_text, printable
from fraexp.plugins import discover
from fraexp.results import Fit, Result
from fraexp.store import RunSummary, Store, StoredSweep

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
    print_fields(_run_fields(run))
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


def _run_fields(run: RunSummary) -> list[tuple[str, str]]:
    git = run.provenance.get("git") or {}
    changed = " with local changes" if git.get("dirty") else ""
    commit = f" ({git['commit'][:12]}{changed})" if git.get("commit") else ""
    return [
        ("run", str(run.number)),
        ("study", run.study),
        ("file", run.study_file),
        ("command", run.command),
        ("state", run.state),
        ("sweeps", f"{run.total}: {run.computed} computed, {run.reused} reused, {run.failed} failed"),
        ("started", moment(run.started)),
        ("took", took(run)),
        ("code", f"fraexp {run.provenance.get('fraexp') or '(version unknown)'}{commit}"),
    ]


def remedies(sweeps: Sequence[StoredSweep]) -> list[str]:
    """Return a line for each outcome that is not as wished, with the number of sweeps and the remedy."""
    outcomes = [sweep.outcome for sweep in sweeps if sweep.outcome and sweep.outcome.value]
    lines = []
    for outcome in dict.fromkeys(outcomes):
        lines.append(f"{outcomes.count(outcome)} {outcome.name.lower().replace('_', ' ')}: {outcome.value}")
    return lines


def _show_sweep(store: Store, arguments: Namespace) -> None:
    sweep = store.find(arguments.id)
    result, log = store.results([sweep.key]).get(sweep.key), store.log(sweep.key)
    if arguments.json:
        print_json(sweep_document(sweep, result))
        return
    print_fields(_sweep_fields(sweep))
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


def _sweep_fields(sweep: StoredSweep) -> list[tuple[str, str]]:
    return [
        ("sweep", short(sweep.key)),
        ("key", sweep.key),
        ("labels", ", ".join(f"{path} = {label_text(value)}" for path, value in sweep.labels.items())),
        ("state", sweep.state),
        ("outcome", outcome_text(sweep)),
        ("message", sweep.message),
        ("remedy", sweep.outcome.value if sweep.outcome else ""),
        ("computed", moment(sweep.created)),
        ("took", duration(sweep.elapsed) if sweep.created else ""),
    ]


def _show_result(result: Result, rows: int | None) -> None:
    if result.numerics:
        print_fields([("numerics", result.numerics)])
    if result.metrics:
        print("\nmetrics")
        print_fields([(metric.name, f"{number(metric.value)} {metric.unit}") for metric in result.metrics], indent=2)
    if result.response is not None:
        print(f"\nresponse {result.response.output}/{result.response.input}")
        print_table(*response_table(result.response, rows))
        left_out = len(result.response.frequency) - (rows or len(result.response.frequency))
        if left_out > 0:
            say(f"{plural(left_out, 'more frequency', 'more frequencies')}; --points shows all")
    for fit in result.fits:
        _show_fit(fit)
    for curve in result.curves:
        columns = ", ".join(f"{name} [{curve.units.get(name, '')}]" for name in curve.columns)
        print(f"\ncurve {curve.name}: {columns}, {len(next(iter(curve.columns.values())))} points")


def _show_fit(fit: Fit) -> None:
    """Print what was identified, and the section of a study that uses it."""
    print(f"\nfit of the {fit.kind}")
    spread = interval_factor(np.inf) * fit.standard_deviation
    rows = [
        [name, number(value, 6), number(band, 3) if np.isfinite(band) else "", unit]
        for name, value, band, unit in zip(fit.parameters, fit.values, spread, fit.units, strict=True)
    ]
    print_table(["parameter", "value", "± 95 %", "unit"], rows)
    print(f"\n[{fit.kind}]")
    for name, value in fit.component.items():
        if name != "version" and value is not None:
            print(f"{name} = {_toml_value(value)}")


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        return (
            "{ " + ", ".join(f"{key} = {_toml_value(item)}" for key, item in value.items() if item is not None) + " }"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)
