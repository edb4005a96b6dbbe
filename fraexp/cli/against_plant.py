"""``fraexp compare --against plant``: errors of responses against the plant that was simulated."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.summary import TITLES, Quantity, quantile_rows, to_summarise
from fraexp.cli.sweep_lookup import chosen, database, open_store
from fraexp.figures.kinds.plant_errors import NEAR, SPOTS, ErrorCurve, ErrorsInfo, errors_info
from fraexp.views.text_tables import Table
from fraexp.views.words import fixed, number, plural, short
from fraexp.workspace.workspace import Workspace

SHARE = "95 % limits that hold P [%]"
FAR = 0.005
"""Relative distance of a frequency from the one of its column that is told."""


def execute(arguments: Namespace) -> ExitCode:
    """Print the errors at some frequencies, and what the responses have cost."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    with open_store(arguments) as store:
        sweeps = chosen(store, arguments.ids)
        results = store.results(sweep.key for sweep in sweeps)
    shown = workspace.figures.shown(sweeps, results)
    info = errors_info(shown, spots=arguments.at or SPOTS)
    if arguments.json:
        print_json(_document(info, {sweep.key: sweep.labels for sweep in sweeps}))
    else:
        if to_summarise(len(info.curves)) and not arguments.all:
            _print_summary(info)
        else:
            print_errors(info)
        left_out = len(sweeps) - len(info.curves)
        if left_out:
            say(f"{plural(left_out, 'sweep')} without a response of a simulated plant left out")
    return ExitCode.OK


def print_errors(info: ErrorsInfo) -> None:
    """Print a table of the magnitudes' errors and what they have cost, and one of the phases'."""
    for table in error_tables(info):
        print_table(*table)
        print()
    found = [(curve, spot, at) for curve in info.curves for spot, at in _points(curve, info.spots) if at is not None]
    away = max((abs(curve.frequency[at] / spot - 1) for curve, spot, at in found), default=0.0)
    if away > FAR:
        say(f"each at the nearest settled frequency, up to {100 * away:.1f} % away")
    missing = [f"{spot:g}" for spot in info.spots if spot not in {spot for _, spot, _ in found}]
    if missing:
        say(f"no response has a settled frequency within {100 * (NEAR - 1):.0f} % of {', '.join(missing)} Hz")


def error_tables(info: ErrorsInfo) -> tuple[Table, Table]:
    """Return the errors in dB and in degrees, a row for each response."""
    names = ["sweep", "name", *(f"{spot:g} Hz" for spot in info.spots)]
    magnitudes, phases = [], []
    for curve in info.curves:
        head, effort = [short(curve.key), curve.label], curve.effort
        indices = [curve.at(spot) for spot in info.spots]
        cost = [number(effort[name], 4) if name in effort else "" for name in info.effort]
        share = "" if curve.inside != curve.inside else fixed(100 * curve.inside, 0)
        magnitudes.append([*head, *("" if at is None else fixed(curve.magnitude[at], 3) for at in indices), *cost])
        phases.append([*head, *("" if at is None else fixed(curve.phase[at], 2) for at in indices), share])
    return (
        ([*names, *info.effort], magnitudes, "error against P(jω) in dB"),
        ([*names, SHARE], phases, "error against P(jω) in degrees"),
    )


def _print_summary(info: ErrorsInfo) -> None:
    """Print quantiles of the errors over many responses."""
    rows = []
    for part, unit, decimals in (("magnitude", "dB", 3), ("phase", "deg", 2)):
        for spot in info.spots:
            pairs = [(getattr(curve, part), curve.at(spot)) for curve in info.curves]
            values = np.array([np.nan if at is None else column[at] for column, at in pairs], dtype=float)
            rows += quantile_rows([Quantity(f"error at {spot:g} Hz [{unit}]", values, decimals)], [""] * len(values))
    share = Quantity(SHARE, 100 * np.array([curve.inside for curve in info.curves]), 0)
    print_table(TITLES, rows + quantile_rows([share], [""] * len(info.curves)), "against P(jω)")
    say("--all shows each sweep")


def _points(curve: ErrorCurve, spots: Sequence[float]) -> list[tuple[float, int | None]]:
    return [(spot, curve.at(spot)) for spot in spots]


def _document(info: ErrorsInfo, labels: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the errors by sweep; those at a frequency without a settled point near it are null."""
    return {
        "against": "plant",
        "sweeps": [
            {
                "key": curve.key,
                "name": curve.label,
                "labels": plain(labels[curve.key]),
                "errors": [
                    {
                        "at": spot,
                        "frequency": None if at is None else plain(curve.frequency[at]),
                        "magnitude_db": None if at is None else plain(curve.magnitude[at]),
                        "phase_deg": None if at is None else plain(curve.phase[at]),
                    }
                    for spot, at in _points(curve, info.spots)
                ],
                "limits_that_hold_the_plant": plain(curve.inside),
                "cost": plain([asdict(metric) for metric in curve.cost]),
            }
            for curve in info.curves
        ],
    }
