"""``fraexp compare --against plant``: errors of responses against the plant that was simulated."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from fraexp.cli.documents import json_value
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.summary import Quantity, is_sample, needs_summary, print_quantiles, quantile_rows
from fraexp.cli.sweep_lookup import choose_sweeps
from fraexp.cli.terminal_figure import print_figure
from fraexp.figures.kinds.plant_errors import (
    FREQUENCY_FACTOR,
    TABLE_FREQUENCIES_HZ,
    ErrorCurve,
    ErrorsInfo,
    errors_info,
)
from fraexp.store import leave_out_damaged
from fraexp.views.text_tables import TextTable
from fraexp.views.words import fixed_text, number_text, plural, short_key
from fraexp.workspace.workspace_service import WorkspaceService

COVERAGE_COLUMN = "95 % limits that cover P [%]"
MIN_REPORTED_OFFSET = 0.005
"""Relative distance of a point from the frequency of its column above which it is reported."""


def execute(arguments: Namespace) -> ExitCode:
    """Print the errors of the responses at some frequencies, and the effort of the estimates."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        results = store.results(sweep.key for sweep in sweeps)
        sweeps = leave_out_damaged(sweeps, results, say)
    shown = workspace.figures.shown_results(sweeps, results)
    info = errors_info(shown, spots=arguments.frequencies or TABLE_FREQUENCIES_HZ)
    if arguments.json:
        print_json(_document(info, {sweep.key: sweep.labels for sweep in sweeps}))
    else:
        if needs_summary(len(info.curves)) and not arguments.all:
            _print_summary(info, is_sample([sweep.labels for sweep in sweeps]))
        else:
            print_errors(info)
        outside = [f"{spot:g}" for spot in arguments.frequencies or () if spot not in info.spots]
        if outside:
            say(f"no response reaches {', '.join(outside)} Hz")
        left_out = len(sweeps) - len(info.curves)
        if left_out:
            say(f"{plural(left_out, 'sweep')} without a response of a simulated plant left out")
        if arguments.terminal:
            with workspace.open_store() as store:
                print()
                print_figure(workspace, store, sweeps, "errors")
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


def _print_summary(info: ErrorsInfo, sampled: bool) -> None:
    """Print the range of the errors over many responses, and quantiles if they are random draws."""
    rows = []
    for part, unit, decimals in (("magnitude", "dB", 3), ("phase", "deg", 2)):
        for spot in info.spots:
            pairs = [(getattr(curve, part), curve.index_near(spot)) for curve in info.curves]
            values = np.array([np.nan if at is None else column[at] for column, at in pairs], dtype=float)
            rows += quantile_rows(
                [Quantity(f"error at {spot:g} Hz [{unit}]", values, decimals)], [""] * len(values), sampled
            )
    share = Quantity(COVERAGE_COLUMN, 100 * np.array([curve.coverage for curve in info.curves]), 0)
    print_quantiles(rows + quantile_rows([share], [""] * len(info.curves), sampled), "against P(jω)")
    say("--all shows each sweep")


def _points(curve: ErrorCurve, spots: Sequence[float]) -> list[tuple[float, int | None]]:
    return [(spot, curve.index_near(spot)) for spot in spots]


def _document(info: ErrorsInfo, labels: dict[str, dict[str, object]]) -> dict[str, object]:
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
