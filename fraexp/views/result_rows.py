"""Metrics, fits and curves of a result as rows of text."""

import numpy as np

from fraexp.analysis.confidence import NORMAL_QUANTILE
from fraexp.data import toml
from fraexp.data.results import Curve, Fit, Result
from fraexp.data.units import with_powers
from fraexp.figures.elements.scales import column_unit
from fraexp.views.words import number_text, with_unit

FIT_COLUMNS = ["parameter", "value", "± 95 %", "unit"]
MAX_CURVE_ROWS = 12
"""Number of points up to which a curve is listed as a table."""


def metric_fields(result: Result) -> list[tuple[str, str]]:
    """Return names and values of metrics."""
    scales = [column_unit([metric.value], metric.unit) for metric in result.metrics]
    pairs = zip(result.metrics, scales, strict=True)
    return [(of.name, with_unit(number_text(factor * of.value), unit)) for of, (factor, unit) in pairs]


def fit_rows(fit: Fit) -> list[list[str]]:
    """Return a row under `FIT_COLUMNS` for each identified parameter."""
    spread = NORMAL_QUANTILE * fit.standard_deviation
    return [
        [
            name,
            number_text(value, 6),
            number_text(band, 3) if np.isfinite(band) else "",
            "" if unit == "1" else with_powers(unit),
        ]
        for name, value, band, unit in zip(fit.parameters, fit.values, spread, fit.units, strict=True)
    ]


def fit_section(fit: Fit) -> list[str]:
    """Return the section of a study that uses the identified parameters."""
    values = fit.component.items()
    told = [f"{name} = {toml.dumps(value)}" for name, value in values if name != "version" and value is not None]
    return [f"[{fit.kind}]", *told]


def curve_text(curve: Curve) -> str:
    """Return name, columns and number of points of a curve."""
    columns = ", ".join(f"{name} [{with_powers(curve.units.get(name, ''))}]" for name in curve.columns)
    return f"{curve.name}: {columns}, {len(next(iter(curve.columns.values()), ()))} points"


def curve_table(curve: Curve) -> tuple[list[str], list[list[str]]]:
    """Return the heading and a row for each point of a curve, in readable units."""
    scales = [column_unit(list(values), curve.units.get(name, "")) for name, values in curve.columns.items()]
    heading = [f"{name} [{unit}]" if unit else name for name, (_, unit) in zip(curve.columns, scales, strict=True)]
    columns = [
        [number_text(factor * value, 4) for value in values]
        for values, (factor, _) in zip(curve.columns.values(), scales, strict=True)
    ]
    return heading, [list(row) for row in zip(*columns, strict=True)]
