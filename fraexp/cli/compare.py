"""``fraexp compare``: in what sweeps differ."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.cli import against_plant
from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_table, say
from fraexp.cli.summary import TITLES, Quantity, parameter_rows, quantile_rows, to_summarise
from fraexp.cli.sweep_lookup import chosen, open_store, run_of
from fraexp.components.registry import Registry, discover
from fraexp.errors import FraexpError
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import curve_names
from fraexp.figures.kinds.difference import Difference
from fraexp.store import StoredSweep
from fraexp.views.comparison import (
    differences_from_first,
    differing,
    fits_of,
    metrics_of,
    named_alike,
    parameters_of,
    rows_that_differ,
)
from fraexp.views.words import fixed, number, short


def execute(arguments: Namespace) -> ExitCode:
    """Print parameters, metrics and fits that differ, and the differences of the responses from the first one.

    Against the plant, print each response's error at some frequencies instead.
    """
    if arguments.against == "plant":
        return against_plant.execute(arguments)
    if arguments.at:
        raise FraexpError("compare: --at is for --against plant; what differs from a sweep is told for all frequencies")
    with open_store(arguments) as store:
        sweeps = chosen(store, arguments.ids)
        if all(run_of(store, identifier) is None for identifier in arguments.ids):
            sweeps = named_alike(store, sweeps)
        results = store.results(sweep.key for sweep in sweeps)
    if len(sweeps) < 2:
        raise FraexpError("compare: found one sweep; name at least two sweeps, or a run that has several")
    parameters = differing([parameters_of(sweep) for sweep in sweeps])
    found = [results.get(sweep.key) for sweep in sweeps]
    metrics, fits = differing([metrics_of(of) for of in found]), differing([fits_of(of) for of in found])
    differences = differences_from_first(sweeps, results)
    if arguments.json:
        print_json(_document(sweeps, parameters, metrics, fits, differences))
    elif to_summarise(len(sweeps)) and not arguments.all:
        _print_summary(sweeps, parameters | metrics, differences)
    else:
        _print(sweeps, rows_that_differ(sweeps, results), differences, discover(Path(arguments.workspace) / "plugins"))
    return ExitCode.OK


def _document(
    sweeps: Sequence[StoredSweep],
    parameters: dict[str, list[Any]],
    metrics: dict[str, list[Any]],
    fits: dict[str, list[Any]],
    differences: list[tuple[StoredSweep, Difference | None]],
) -> dict[str, Any]:
    return {
        "sweeps": [{"key": sweep.key, "labels": plain(sweep.labels)} for sweep in sweeps],
        "parameters": plain(parameters),
        "metrics": plain(metrics),
        "fits": plain(fits),
        "responses": [
            {"key": sweep.key, "reference": sweeps[0].key, "difference": plain(asdict(found)) if found else None}
            for sweep, found in differences
        ],
    }


def _print_summary(
    sweeps: Sequence[StoredSweep],
    values: dict[str, list[Any]],
    differences: list[tuple[StoredSweep, Difference | None]],
) -> None:
    """Print quantiles over the sweeps of what differs, and of the responses' differences from the first one."""
    counted, rows = parameter_rows(values)
    print_fields([("sweeps", str(len(sweeps))), *counted])
    print()
    print_table(TITLES, rows, "what differs")
    print()
    found = [difference for _, difference in differences if difference is not None]
    measures = {
        "max [dB]": [abs(of.magnitude_max) for of in found], "rms [dB]": [of.magnitude_rms for of in found],
        "max [deg]": [abs(of.phase_max) for of in found], "rms [deg]": [of.phase_rms for of in found],
    }  # fmt: skip
    quantities = [Quantity(title, np.array(column, dtype=float)) for title, column in measures.items()]
    print_table(TITLES, quantile_rows(quantities, [""] * len(found)), f"responses against {short(sweeps[0].key)}")
    say("--all shows each sweep")


def _print(
    sweeps: Sequence[StoredSweep],
    rows: list[list[str]],
    differences: list[tuple[StoredSweep, Difference | None]],
    registry: Registry,
) -> None:
    keys = [short(sweep.key) for sweep in sweeps]
    units = label_units(
        ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps), registry
    )
    names = dict(zip(keys, curve_names([sweep.labels for sweep in sweeps], [""] * len(sweeps), units), strict=True))
    print_table(["what differs", *keys], rows or [["nothing", *("" for _ in keys)]])
    print()
    title = f"responses against {keys[0]}" + (f" ({names[keys[0]]})" if names[keys[0]] else "")
    columns = ["sweep", "name", "max [dB]", "at [Hz]", "rms [dB]", "max [deg]", "at [Hz]", "rms [deg]", "points"]
    cells = [[short(sweep.key), names[short(sweep.key)], *_difference_cells(found)] for sweep, found in differences]
    print_table([*columns, "note"], cells, title)


def _difference_cells(found: Difference | None) -> list[str]:
    if found is None:
        return [*[""] * 7, "no common frequencies, or no response in the same unit"]
    note = f"{number(found.low, 4)} to {number(found.high, 4)} Hz" + (", interpolated" if found.interpolated else "")
    return [
        fixed(found.magnitude_max, 4), number(found.magnitude_max_at, 4), fixed(found.magnitude_rms, 4),
        fixed(found.phase_max, 3), number(found.phase_max_at, 4), fixed(found.phase_rms, 3), str(found.points), note,
    ]  # fmt: skip
