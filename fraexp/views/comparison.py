"""The differences between sweeps: parameters, metrics and responses."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import median
from typing import Any

from fraexp.components.registry import Registry
from fraexp.data.identity import key_of
from fraexp.data.results import Result
from fraexp.figures.kinds.response_errors import Difference, response_difference
from fraexp.store import StoredSweep
from fraexp.study.paths import unit_at
from fraexp.views.words import flatten, number_text, scale_values, short_key, value_text, with_unit

ABSENT = "-"


def with_all_labels(sweeps: Sequence[StoredSweep]) -> list[StoredSweep]:
    """Return sweeps that all have the labels of each, so that their names are made in the same way."""
    paths = dict.fromkeys(path for sweep in sweeps for path in sweep.labels)
    found = [{path: _label_value(sweep, path) for path in paths} | sweep.labels for sweep in sweeps]
    return [
        replace(sweep, labels={path: value for path, value in labels.items() if value is not None})
        for sweep, labels in zip(sweeps, found, strict=True)
    ]


def _label_value(sweep: StoredSweep, path: str) -> object:
    """Return the value of a sweep at the path of a label: a plain value, or the name of a component."""
    value: object = sweep.sections
    for part in path.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value.get("name") if isinstance(value, Mapping) else value


def metric_values(result: Result | None) -> dict[str, Any]:
    """Return a result's metrics by name and unit."""
    return {f"{metric.name} [{metric.unit}]": metric.value for metric in result.metrics} if result else {}


def fit_texts(result: Result | None) -> dict[str, str]:
    """Return the identified parameters with their 95 % limits, by kind, name and unit."""
    if result is None or not result.fits:
        return {}
    from fraexp.views.result_rows import fit_rows

    rows = [(fit.kind, row) for fit in result.fits for row in fit_rows(fit)]
    return {
        f"{kind} {name}{f' [{unit}]' if unit else ''}": f"{value} ± {band}" if band else value
        for kind, (name, value, band, unit) in rows
    }


def parameter_values(sweep: StoredSweep) -> dict[str, Any]:
    """Return all parameters of a sweep by dotted path."""
    return flatten(sweep.sections)


def difference_rows(
    groups: Sequence[Sequence[StoredSweep]], results: Mapping[str, Result], registry: Registry
) -> list[list[str]]:
    """Return a row for each parameter, metric and fit that differs: its name with its unit, and a text per group.

    What differs within a group, which may have many sweeps, is the median.
    """
    sweeps = [group[0] for group in groups]
    found = [[results.get(sweep.key) for sweep in group] for group in groups]
    parameters = differing_values([_group_parameters(group) for group in groups])
    metrics = differing_values([merge_values([metric_values(of) for of in group]) for group in found])
    fits = differing_values([merge_values([fit_texts(of) for of in group]) for group in found])
    rows = [_parameter_row(path, row, sweeps, registry) for path, row in parameters.items()]
    rows += [_metric_row(name, row) for name, row in metrics.items()]
    return rows + [[path, *(text or ABSENT for text in row)] for path, row in fits.items()]


def _group_parameters(group: Sequence[StoredSweep]) -> dict[str, Any]:
    """Return the parameters of a group by path; those that its first and last two sweeps share are common to all."""
    some = {of.key: parameter_values(of) for of in (*group[:2], *group[-2:])}
    varying = differing_values(list(some.values()))
    values = [{path: _label_value(sweep, path) for path in varying} for sweep in group] if varying else []
    return next(iter(some.values())) | merge_values(values)


def merge_values(values: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return one value for each path: the common one, the median of different numbers, or how many others there are."""
    paths = dict.fromkeys(path for of in values for path in of)
    return {path: _merge([of.get(path) for of in values]) for path in paths}


def _merge(values: Sequence[Any]) -> object:
    if all(value == values[0] for value in values):
        return values[0]
    known = [value for value in values if value is not None]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in known):
        return median(known)
    return f"{len({repr(value) for value in known})} different"


def _parameter_row(path: str, row: Sequence[object], sweeps: Sequence[StoredSweep], registry: Registry) -> list[str]:
    units = [
        declared_unit(sweep, path, registry) for sweep, value in zip(sweeps, row, strict=True) if value is not None
    ]
    scaled, unit = scale_values(row, units[0] if len(set(units)) == 1 else "")
    return [with_unit(path, f"[{unit}]" if unit else ""), *_texts(scaled)]


def declared_unit(sweep: StoredSweep, path: str, registry: Registry) -> str:
    """Return the unit that is declared for a value of a sweep; empty without one."""
    try:
        return unit_at(sweep.sections, path, registry)
    except (ValueError, IndexError):  # the section of a record has a different structure
        return ""


def _metric_row(title: str, row: Sequence[float | None]) -> list[str]:
    name, _, unit = title.removesuffix("]").rpartition(" [")
    scaled, unit = scale_values(row, unit)
    return [with_unit(name, f"[{unit}]" if unit else ""), *(_metric_text(value) for value in scaled)]


def _metric_text(value: object) -> str:
    return number_text(value if isinstance(value, int | float) else None)


def fold_incomparable(rows: Sequence[Sequence[str]]) -> tuple[list[Sequence[str]], dict[str, int]]:
    """Return the rows without those that only some sweeps have, and how many these are by differing component.

    Parameters of two friction laws have nothing to be compared with; their names say all.
    """
    owners = {path.removesuffix(".name") for path, *texts in rows if path.endswith(".name")}
    folded: dict[str, int] = {}
    kept = []
    for row in rows:
        owner = max(
            (of for of in owners if row[0].startswith(f"{of}.") and row[0] != f"{of}.name"), key=len, default=""
        )
        if owner and (ABSENT in row[1:] or row[0] == f"{owner}.version"):
            folded[owner] = folded.get(owner, 0) + 1
        else:
            kept.append(row)
    return kept, folded


def _texts(row: Sequence[object]) -> list[str]:
    """Return the values in short form; different long lists with the same short form get a hash of their content."""
    texts = [ABSENT if value is None else value_text(value) for value in row]
    marked = len(set(texts)) < len({key_of(value) for value in row})
    if not marked:
        return texts
    return [f"{text} #{short_key(key_of(value))[:4]}" for text, value in zip(texts, row, strict=True)]


def differing_values(values: Sequence[Mapping[str, object]]) -> dict[str, list[Any]]:
    """Return the values of each path that differs between the sweeps; a missing value is None."""
    paths = dict.fromkeys(path for of in values for path in of)
    rows = {path: [of.get(path) for of in values] for path in paths}
    return {path: row for path, row in rows.items() if any(value != row[0] for value in row)}


def differences_from_first(
    sweeps: Sequence[StoredSweep], results: Mapping[str, Result]
) -> list[tuple[StoredSweep, Difference | None]]:
    """Return the difference of each response from that of the first sweep; None where they cannot be compared."""
    responses = [results[sweep.key].response if sweep.key in results else None for sweep in sweeps]
    first = responses[0]
    return [
        (sweep, response_difference(first, other) if first is not None and other is not None else None)
        for sweep, other in zip(sweeps[1:], responses[1:], strict=True)
    ]
