"""``fraexp compare``: the differences between sweeps."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from fraexp.cli import against_plant
from fraexp.cli.documents import json_value
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_fields, print_json, print_table, say
from fraexp.cli.summary import Quantity, is_sample, needs_summary, parameter_rows, print_quantiles, quantile_rows
from fraexp.cli.sweep_lookup import choose_sweeps, find_run_number, workspace_folder
from fraexp.cli.terminal_figure import print_figure
from fraexp.components.registry import Registry
from fraexp.data.frequency_text import frequency_text
from fraexp.errors import FraexpError
from fraexp.figures.elements.label_units import label_units
from fraexp.figures.elements.labels import curve_names
from fraexp.figures.kinds.difference import Difference
from fraexp.store import StoredSweep, leave_out_damaged
from fraexp.views.comparison import (
    difference_rows,
    differences_from_first,
    differing_values,
    fit_texts,
    fold_incomparable,
    metric_values,
    parameter_values,
    with_common_labels,
)
from fraexp.views.words import fixed_text, number_text, plural, short_key
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Print parameters, metrics and fits that differ, and the differences of the responses from the first one.

    Against the plant, print each response's error at some frequencies instead.
    """
    if arguments.against == "plant":
        return against_plant.execute(arguments)
    if arguments.frequencies:
        raise FraexpError(
            "compare: --frequencies needs --against plant; differences between sweeps are shown over all frequencies"
        )
    workspace = workspace_folder(arguments)
    with workspace.open_store() as store:
        sweeps = choose_sweeps(store, arguments.ids, arguments.filter)
        if all(find_run_number(store, identifier) is None for identifier in arguments.ids):
            sweeps = with_common_labels(store, sweeps)
        results = store.results(sweep.key for sweep in sweeps)
        sweeps = leave_out_damaged(sweeps, results, say)
    if len(sweeps) < 2:
        raise FraexpError("compare: found one sweep; expected at least two sweeps, or a run with several")
    parameters = differing_values([parameter_values(sweep) for sweep in sweeps])
    found = [results.get(sweep.key) for sweep in sweeps]
    metrics, fits = (
        differing_values([metric_values(of) for of in found]),
        differing_values([fit_texts(of) for of in found]),
    )
    differences = differences_from_first(sweeps, results)
    if arguments.json:
        print_json(_document(sweeps, parameters, metrics, fits, differences))
    elif needs_summary(len(sweeps)) and not arguments.all:
        _print_summary(sweeps, parameters | metrics, differences)
    else:
        rows = difference_rows(sweeps, results, workspace.registry)
        shown, folded = (rows, {}) if arguments.all else fold_incomparable(rows)
        _print(sweeps, shown, differences, workspace.registry)
        if folded:
            counts = (f"{plural(count, 'parameter')} of {owner}" for owner, count in folded.items())
            say(f"left out: {', '.join(counts)} that not all sweeps have; --all shows them")
    if arguments.terminal and not arguments.json:
        service = WorkspaceService.open(arguments.workspace, arguments.db)
        with service.open_store() as store:
            print()
            print_figure(service, store, sweeps, "difference" if differences[0][1] else "")
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


def _print_summary(
    sweeps: Sequence[StoredSweep],
    values: dict[str, list[object]],
    differences: list[tuple[StoredSweep, Difference | None]],
) -> None:
    """Print quantiles over the sweeps: of differing values, and of the responses' differences from the first one."""
    sampled = is_sample([sweep.labels for sweep in sweeps])
    counted, rows = parameter_rows(values, sampled)
    print_fields([("sweeps", str(len(sweeps))), *counted])
    print()
    print_quantiles(rows, "differences")
    print()
    found = [difference for _, difference in differences if difference is not None]
    measures = {
        "max [dB]": [abs(of.magnitude_max) for of in found], "rms [dB]": [of.magnitude_rms for of in found],
        "max [deg]": [abs(of.phase_max) for of in found], "rms [deg]": [of.phase_rms for of in found],
    }  # fmt: skip
    quantities = [Quantity(title, np.array(column, dtype=float)) for title, column in measures.items()]
    rows = quantile_rows(quantities, [""] * len(found), sampled)
    print_quantiles(rows, f"responses against {short_key(sweeps[0].key)}")
    say("--all shows each sweep")


def _print(
    sweeps: Sequence[StoredSweep],
    rows: Sequence[Sequence[str]],
    differences: list[tuple[StoredSweep, Difference | None]],
    registry: Registry,
) -> None:
    keys = [short_key(sweep.key) for sweep in sweeps]
    units = label_units(
        ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps), registry
    )
    names = dict(zip(keys, curve_names([sweep.labels for sweep in sweeps], [""] * len(sweeps), units), strict=True))
    print_table(["difference", *keys], rows or [["none", *("" for _ in keys)]])
    print()
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
