"""In what sweeps differ: parameters, metrics and responses."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from fraexp.figures.difference import Difference, response_difference
from fraexp.results import Result
from fraexp.store import Store, StoredSweep


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


def metrics_of(result: Result | None) -> dict[str, Any]:
    """Return a result's metrics by name and unit."""
    return {f"{metric.name} [{metric.unit}]": metric.value for metric in result.metrics} if result else {}


def differing(values: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the values of each path in which the sweeps differ, None where one has none."""
    paths = dict.fromkeys(path for of in values for path in of)
    rows = {path: [of.get(path) for of in values] for path in paths}
    return {path: row for path, row in rows.items() if any(value != row[0] for value in row)}


def differences_from_first(
    sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
) -> list[tuple[StoredSweep, Difference | None]]:
    """Return how the response of each other sweep differs from that of the first; None where it cannot be told."""
    responses = [results[sweep.key].response if sweep.key in results else None for sweep in sweeps]
    first = responses[0]
    return [
        (sweep, response_difference(first, other) if first is not None and other is not None else None)
        for sweep, other in zip(sweeps[1:], responses[1:], strict=True)
    ]
