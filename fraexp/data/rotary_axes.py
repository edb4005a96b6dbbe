"""Rotary axes: angles for displacements, torques for forces, moments of inertia for masses.

The equations of a turning machine are those of a straight one, number by number; only the units differ. Friction laws,
estimators and the loop therefore know one kind of axis, in m, N and kg, and units are translated where values enter and
results leave: m ↔ rad, N ↔ N m, kg ↔ kg m².
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from fraexp.data.findings import Finding, Quantity
from fraexp.data.results import Curve, Metric, Result
from fraexp.data.signals import Signals
from fraexp.errors import FraexpError

ENERGY = "N m"
"""Unit of work, whether by a force along a path or by a torque along an angle."""
WORD = re.compile(r"(?<![A-Za-zµμ])(kg|[kMmuµμn]?N|[kcmuµμn]?m)(?![A-Za-z])")
"""A unit that differs between both kinds of axes, with its prefix."""
ANGLE, TORQUE = re.compile(r"\b[mµμun]?rad\b"), re.compile(r"\bN ?\*? ?m\b")


def is_rotary(sections: Mapping[str, Any]) -> bool:
    """Return whether an experiment, written or resolved, is that of a rotary axis."""
    loop, record = sections.get("loop"), sections.get("record")
    if isinstance(loop, Mapping) and "record" not in sections:
        return loop.get("rotary") is True
    parts = record.get("parts", [record]) if isinstance(record, Mapping) else []
    channels = parts[0].get("channels") if parts else None
    of = channels.values() if isinstance(channels, Mapping) else ()
    return are_rotary(str(channel.get("unit", "")) for channel in of if isinstance(channel, Mapping))


def are_rotary(units: Iterable[str]) -> bool:
    """Return whether units of channels are those of a rotary axis, and none that of a straight one."""
    known = list(units)
    turns = any(ANGLE.search(unit) or TORQUE.search(unit) for unit in known)
    return turns and not any(WORD.search(TORQUE.sub("", unit)) for unit in known)


def rotary_unit(unit: str) -> str:
    """Return the unit that a straight axis's unit becomes on a rotary one: ``N s/m`` → ``N m s/rad``."""
    if unit == ENERGY:
        return unit

    def replace_word(found: re.Match[str]) -> str:
        word = found[0]
        if word.endswith("m"):
            return f"{word[:-1]}rad"
        text = "kg m**2" if word == "kg" else f"{word} m"
        is_factor = unit[: found.start()].endswith("/") or unit[found.end() :].startswith(("^", "**"))
        return f"({text})" if is_factor else text

    return WORD.sub(replace_word, unit)


def linear_unit(unit: str) -> str:
    """Return the unit that a rotary axis's unit stands for on a straight one: ``rad/s`` → ``m/s``."""
    return TORQUE.sub("N", unit.replace("rad", "m"))


def to_rotary_units(error: BaseException) -> None:
    """Give the quantities of an error the units of a rotary axis: ``12 N`` → ``12 N m``."""
    if isinstance(error, FraexpError):
        error.args = tuple(_rotary_quantity(of) if isinstance(of, Quantity) else of for of in error.args)


def as_linear(signals: Signals) -> Signals:
    """Return the signals of a rotary axis as those of a straight one."""
    return replace(signals, units={name: linear_unit(unit) for name, unit in signals.units.items()})


def rotary_signals(signals: Signals) -> Signals:
    """Return signals that were simulated as those of a straight axis in the units of a rotary one."""
    return replace(
        signals,
        units={name: rotary_unit(unit) for name, unit in signals.units.items()},
        metrics=_rotary_metrics(signals.metrics),
        findings=tuple(map(_rotary_finding, signals.findings)),
    )


def rotary_result(result: Result) -> Result:
    """Return what an estimator learnt from the signals of a straight axis in the units of a rotary one."""
    response = result.response
    return replace(
        result,
        findings=tuple(map(_rotary_finding, result.findings)),
        response=response and replace(response, unit=rotary_unit(response.unit)),
        metrics=_rotary_metrics(result.metrics),
        curves=tuple(_rotary_curve(curve) for curve in result.curves),
        fits=tuple(replace(fit, units=tuple(map(rotary_unit, fit.units))) for fit in result.fits),
    )


def _rotary_finding(finding: Finding) -> Finding:
    return replace(finding, quantities=tuple(map(_rotary_quantity, finding.quantities)))


def _rotary_quantity(quantity: Quantity) -> Quantity:
    return replace(quantity, unit=rotary_unit(quantity.unit))


def _rotary_metrics(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    return tuple(replace(metric, unit=rotary_unit(metric.unit)) for metric in metrics)


def _rotary_curve(curve: Curve) -> Curve:
    return replace(curve, units={name: rotary_unit(unit) for name, unit in curve.units.items()})
