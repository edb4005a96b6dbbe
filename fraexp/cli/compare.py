"""``fraexp compare``: the differences between sweeps, or their errors against the simulated plant."""

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict

from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.summary import ALL_REMEDY, needs_summary, print_summary
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number, workspace_folder
from fraexp.components.registry import Registry
from fraexp.data.texts import frequency_text
from fraexp.errors import FraexpError
from fraexp.figures.elements.labels import curve_names
from fraexp.figures.kinds.response_errors import (
    FREQUENCY_FACTOR,
    TABLE_FREQUENCIES_HZ,
    Difference,
    ErrorCurve,
    ErrorsInfo,
    errors_info,
)
from fraexp.figures.result_files import json_value
from fraexp.store import StoredSweep, leave_out_damaged
from fraexp.study.paths import label_units
from fraexp.views import comparison
from fraexp.views.text_tables import TextTable
from fraexp.views.words import fixed_text, number_text, plural, short_key
from fraexp.workspace.workspace_service import WorkspaceService

COVERAGE_COLUMN = "95 % limits that cover P [%]"
MIN_REPORTED_OFFSET = 0.005
"""Relative distance of a point from the frequency of its column above which it is reported."""


def _compare_with_plant(arguments: Namespace) -> ExitCode:
    """Print the errors of the responses at some frequencies, and the effort of the estimates."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        results = store.results(sweep.key for sweep in sweeps)
        sweeps = leave_out_damaged(sweeps, results, say)
    shown = workspace.figures.shown_results(sweeps, results)
    info = errors_info(shown, spots=arguments.frequencies or TABLE_FREQUENCIES_HZ)
    if arguments.json:
        print_json(_plant_document(info, {sweep.key: sweep.labels for sweep in sweeps}))
    else:
        print_errors(info)
        outside = [f"{spot:g}" for spot in arguments.frequencies or () if spot not in info.spots]
        if outside:
            say(f"no response reaches {', '.join(outside)} Hz")
        left_out = len(sweeps) - len(info.curves)
        if left_out:
            say(f"{plural(left_out, 'sweep')} without a response of a simulated plant left out")
    return ExitCode.OK


def print_errors(info: ErrorsInfo) -> None:
    """Print a table of magnitude errors with the effort of the estimates, and one of phase errors."""
    for table in error_tables(info):
        print_table(*table)
        print()
    found = [(curve, spot, at) for curve in info.curves for spot, at in _points(curve, info.spots) if at is not None]
    away = max((abs(curve.frequency[at] / spot - 1) for curve, spot, at in found), default=0.0)
    if away > MIN_REPORTED_OFFSET:
        say(f"errors are those at the nearest settled frequency, up to {100 * away:.1f} % away")
    missing = [f"{spot:g}" for spot in info.spots if spot not in {spot for _, spot, _ in found}]
    if missing:
        percent = 100 * (FREQUENCY_FACTOR - 1)
        say(f"no response has a settled frequency within {percent:.0f} % of {', '.join(missing)} Hz")


def error_tables(info: ErrorsInfo) -> tuple[TextTable, TextTable]:
    """Return the errors in dB and in degrees, a row for each response."""
    names = ["sweep", "name", *(f"{spot:g} Hz" for spot in info.spots)]
    magnitudes, phases = [], []
    for curve in info.curves:
        head, effort = [short_key(curve.key), curve.label], curve.effort
        indices = [curve.index_near(spot) for spot in info.spots]
        cost = [number_text(effort[name], 4) if name in effort else "" for name in info.effort]
        share = "" if curve.coverage != curve.coverage else fixed_text(100 * curve.coverage, 0)
        magnitudes.append([*head, *("" if at is None else fixed_text(curve.magnitude[at], 3) for at in indices), *cost])
        phases.append([*head, *("" if at is None else fixed_text(curve.phase[at], 2) for at in indices), share])
    return (
        TextTable([*names, *info.effort], magnitudes, "error against P(jω) in dB"),
        TextTable([*names, COVERAGE_COLUMN], phases, "error against P(jω) in degrees"),
    )


def _points(curve: ErrorCurve, spots: Sequence[float]) -> list[tuple[float, int | None]]:
    return [(spot, curve.index_near(spot)) for spot in spots]


def _plant_document(info: ErrorsInfo, labels: dict[str, dict[str, object]]) -> dict[str, object]:
    """Return the errors by sweep; an error is null at a frequency without a settled point nearby."""
    return {
        "against": "plant",
        "sweeps": [
            {
                "key": curve.key,
                "name": curve.label,
                "labels": json_value(labels[curve.key]),
                "errors": [
                    {
                        "at": spot,
                        "frequency": None if at is None else json_value(curve.frequency[at]),
                        "magnitude_db": None if at is None else json_value(curve.magnitude[at]),
                        "phase_deg": None if at is None else json_value(curve.phase[at]),
                    }
                    for spot, at in _points(curve, info.spots)
                ],
                "limits_that_hold_the_plant": json_value(curve.coverage),
                "cost": json_value([asdict(metric) for metric in curve.cost]),
            }
            for curve in info.curves
        ],
    }


def execute(arguments: Namespace) -> ExitCode:
    """Print parameters, metrics and fits that differ, and the differences of the responses from the first one.

    Against the plant, print each response's error at some frequencies instead.
    """
    if arguments.against == "plant":
        return _compare_with_plant(arguments)
    if arguments.frequencies:
        raise FraexpError(
            "compare: --frequencies needs --against plant; differences between sweeps are shown over all frequencies"
        )
    workspace = workspace_folder(arguments)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        if all(find_run_number(store, identifier) is None for identifier in arguments.ids):
            sweeps = comparison.with_all_labels(sweeps)
        results = store.results(sweep.key for sweep in sweeps)
        sweeps = leave_out_damaged(sweeps, results, say)
    if len(sweeps) < 2:
        raise FraexpError("compare: found one sweep; expected at least two sweeps, or a run with several")
    parameters = comparison.differing_values([comparison.parameter_values(sweep) for sweep in sweeps])
    found = [results.get(sweep.key) for sweep in sweeps]
    metrics, fits = (
        comparison.differing_values([comparison.metric_values(of) for of in found]),
        comparison.differing_values([comparison.fit_texts(of) for of in found]),
    )
    differences = comparison.differences_from_first(sweeps, results)
    if arguments.json:
        print_json(_document(sweeps, parameters, metrics, fits, differences))
        return ExitCode.OK
    if needs_summary(len(sweeps)):  # they do not fit side by side
        print_summary(sweeps, results, workspace.registry)
        say(ALL_REMEDY)
    else:
        rows = comparison.difference_rows([[sweep] for sweep in sweeps], results, workspace.registry)
        shown, folded = comparison.fold_incomparable(rows) if sys.stdout.isatty() else (rows, {})
        keys = [short_key(sweep.key) for sweep in sweeps]
        print_table(["difference", *keys], shown or [["none", *("" for _ in keys)]])
        if folded:
            counts = (f"{plural(count, 'parameter')} of {owner}" for owner, count in folded.items())
            say(f"left out: {', '.join(counts)} that not all sweeps have; {ALL_REMEDY}")
    print()
    _print_differences(sweeps, differences, workspace.registry)
    return ExitCode.OK


def _document(
    sweeps: Sequence[StoredSweep],
    parameters: dict[str, list[object]],
    metrics: dict[str, list[object]],
    fits: dict[str, list[object]],
    differences: list[tuple[StoredSweep, Difference | None]],
) -> dict[str, object]:
    return {
        "sweeps": [{"key": sweep.key, "labels": json_value(sweep.labels)} for sweep in sweeps],
        "parameters": json_value(parameters),
        "metrics": json_value(metrics),
        "fits": json_value(fits),
        "responses": [
            {"key": sweep.key, "reference": sweeps[0].key, "difference": json_value(asdict(found)) if found else None}
            for sweep, found in differences
        ],
    }


def _print_differences(
    sweeps: Sequence[StoredSweep], differences: list[tuple[StoredSweep, Difference | None]], registry: Registry
) -> None:
    keys = [short_key(sweep.key) for sweep in sweeps]
    units = label_units(((sweep.labels, sweep.sections) for sweep in sweeps), registry)
    names = dict(zip(keys, curve_names([sweep.labels for sweep in sweeps], [""] * len(sweeps), units), strict=True))
    title = f"responses against {keys[0]}" + (f" ({names[keys[0]]})" if names[keys[0]] else "")
    columns = ["sweep", "name", "max [dB]", "at [Hz]", "rms [dB]", "max [deg]", "at [Hz]", "rms [deg]", "points"]
    cells = [
        [short_key(sweep.key), names[short_key(sweep.key)], *_difference_cells(found)]
        for sweep, found in differences
        if found is not None
    ]
    if cells:
        print_table([*columns, "frequencies"], cells, title)
    apart = [short_key(sweep.key) for sweep, found in differences if found is None]
    if apart and cells:
        say(f"not compared with {keys[0]}, without common frequencies or in other units: {', '.join(apart)}")


def _difference_cells(found: Difference) -> list[str]:
    span = frequency_text([found.low, found.high])
    return [
        fixed_text(found.magnitude_max, 4),
        number_text(found.magnitude_max_at, 4),
        fixed_text(found.magnitude_rms, 4),
        fixed_text(found.phase_max, 3),
        number_text(found.phase_max_at, 4),
        fixed_text(found.phase_rms, 3),
        str(found.points),
        f"{span}, interpolated" if found.interpolated else span,
    ]
