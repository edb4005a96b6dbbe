"""``fraexp compare``: in what sweeps differ."""

from argparse import Namespace
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.cli import against_plant
from fraexp.cli.documents import plain
from fraexp.cli.exits import ExitCode
from fraexp.cli.selection import chosen, open_store, run_of
from fraexp.cli.summary import TITLES, Quantity, parameter_rows, quantile_rows, to_summarise
from fraexp.cli.terminal import print_fields, print_json, print_table, say
from fraexp.cli.words import fixed, flat, number, short, value_text
from fraexp.errors import FraexpError
from fraexp.figures.difference import Difference, response_difference
from fraexp.figures.label_units import label_units
from fraexp.figures.labels import curve_names
from fraexp.identity import key_of
from fraexp.plugins import Registry, discover
from fraexp.results import Result
from fraexp.store import Store, StoredSweep

ABSENT = "-"


def execute(arguments: Namespace) -> ExitCode:
    """Print parameters and metrics that differ, and the differences of the responses from the first one.

    Against the plant, print each response's error at some frequencies instead.
    """
    if arguments.against == "plant":
        return against_plant.execute(arguments)
    if arguments.at:
        raise FraexpError("compare: --at is for --against plant; what differs from a sweep is told for all frequencies")
    with open_store(arguments) as store:
        sweeps = chosen(store, arguments.ids)
        if all(run_of(store, identifier) is None for identifier in arguments.ids):
            sweeps = completed(labelled_as_computed(store, sweeps))
        results = store.results(sweep.key for sweep in sweeps)
    if len(sweeps) < 2:
        raise FraexpError("compare: found one sweep; name at least two sweeps, or a run that has several")
    parameters = _differing([flat({**sweep.experiment, "estimator": sweep.estimator}) for sweep in sweeps])
    metrics = _differing([_metrics(results.get(sweep.key)) for sweep in sweeps])
    differences = _differences(sweeps, results)
    if arguments.json:
        print_json(_document(sweeps, parameters, metrics, differences))
    elif to_summarise(len(sweeps)) and not arguments.all:
        _print_summary(sweeps, parameters | metrics, differences)
    else:
        _print(sweeps, parameters, metrics, differences, discover(Path(arguments.workspace) / "plugins"))
    return ExitCode.OK


def labelled_as_computed(store: Store, sweeps: Sequence[StoredSweep]) -> list[StoredSweep]:
    """Return sweeps with the labels that they have in the runs that computed them, not in those that reused them."""
    labels: dict[str, dict[str, Any]] = {}
    for run in store.runs():
        end = run.ended or datetime.max.replace(tzinfo=UTC)
        wanted = {sweep.key for sweep in sweeps if sweep.created and run.started <= sweep.created <= end}
        if wanted:
            labels |= {s.key: s.labels for s in store.sweeps(run.number) if s.key in wanted and s.state == "computed"}
    return [replace(sweep, labels=labels.get(sweep.key, sweep.labels)) for sweep in sweeps]


def completed(sweeps: Sequence[StoredSweep]) -> list[StoredSweep]:
    """Return sweeps that all have the labels of each, so that names of sweeps from several studies say the same."""
    paths = dict.fromkeys(path for sweep in sweeps for path in sweep.labels)
    found = [{path: _looked_up(sweep, path) for path in paths} | sweep.labels for sweep in sweeps]
    return [
        replace(sweep, labels={path: value for path, value in labels.items() if value is not None})
        for sweep, labels in zip(sweeps, found, strict=True)
    ]


def _looked_up(sweep: StoredSweep, path: str) -> Any:
    """Return what a sweep has at a label's path: a plain value, or a component's name."""
    value: Any = {**sweep.experiment, "estimator": sweep.estimator}
    for part in path.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value.get("name") if isinstance(value, Mapping) else value


def _metrics(result: Result | None) -> dict[str, Any]:
    return {f"{metric.name} [{metric.unit}]": metric.value for metric in result.metrics} if result else {}


def _differing(values: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    paths = dict.fromkeys(path for of in values for path in of)
    rows = {path: [of.get(path) for of in values] for path in paths}
    return {path: row for path, row in rows.items() if any(value != row[0] for value in row)}


def _differences(
    sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
) -> list[tuple[StoredSweep, Difference | None]]:
    responses = [results[sweep.key].response if sweep.key in results else None for sweep in sweeps]
    first = responses[0]
    return [
        (sweep, response_difference(first, other) if first is not None and other is not None else None)
        for sweep, other in zip(sweeps[1:], responses[1:], strict=True)
    ]


def _document(
    sweeps: Sequence[StoredSweep],
    parameters: dict[str, list[Any]],
    metrics: dict[str, list[Any]],
    differences: list[tuple[StoredSweep, Difference | None]],
) -> dict[str, Any]:
    return {
        "sweeps": [{"key": sweep.key, "labels": plain(sweep.labels)} for sweep in sweeps],
        "parameters": plain(parameters),
        "metrics": plain(metrics),
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
    parameters: dict[str, list[Any]],
    metrics: dict[str, list[Any]],
    differences: list[tuple[StoredSweep, Difference | None]],
    registry: Registry,
) -> None:
    keys = [short(sweep.key) for sweep in sweeps]
    units = label_units(
        ((sweep.labels, sweep.experiment | {"estimator": sweep.estimator}) for sweep in sweeps), registry
    )
    names = dict(zip(keys, curve_names([sweep.labels for sweep in sweeps], [""] * len(sweeps), units), strict=True))
    rows = [[path, *_texts(row)] for path, row in parameters.items()]
    rows += [[path, *(number(value) for value in row)] for path, row in metrics.items()]
    print_table(["what differs", *keys], rows or [["nothing", *("" for _ in keys)]])
    print()
    title = f"responses against {keys[0]}" + (f" ({names[keys[0]]})" if names[keys[0]] else "")
    columns = ["sweep", "name", "max [dB]", "at [Hz]", "rms [dB]", "max [deg]", "at [Hz]", "rms [deg]", "points"]
    cells = [[short(sweep.key), names[short(sweep.key)], *_difference_cells(found)] for sweep, found in differences]
    print_table([*columns, "note"], cells, title)


def _texts(row: Sequence[Any]) -> list[str]:
    """Return the values in short; long lists that look alike though they differ get a mark of their content."""
    texts = [ABSENT if value is None else value_text(value) for value in row]
    marked = len(set(texts)) < len({key_of(value) for value in row})
    if not marked:
        return texts
    return [f"{text} #{short(key_of(value))[:4]}" for text, value in zip(texts, row, strict=True)]


def _difference_cells(found: Difference | None) -> list[str]:
    if found is None:
        return [*[""] * 7, "no common frequencies, or no response in the same unit"]
    note = f"{number(found.low, 4)} to {number(found.high, 4)} Hz" + (", interpolated" if found.interpolated else "")
    return [
        fixed(found.magnitude_max, 4), number(found.magnitude_max_at, 4), fixed(found.magnitude_rms, 4),
        fixed(found.phase_max, 3), number(found.phase_max_at, 4), fixed(found.phase_rms, 3), str(found.points), note,
    ]  # fmt: skip
