"""A friction model with other scales of force and deflection, as parameters of its law."""

from collections.abc import Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, Parameters

EXPONENTS = {"N": (1, 0), "m": (0, 1), "N/m": (1, -1), "N s/m": (1, -1), "m/s": (0, 1), "N/s": (1, 0)}
"""Powers of the scales of force and deflection with which a parameter of this unit changes."""
SHAPE_UNITS, MAX_SHAPE_PARAMETERS = ("N s/m", "m/s", "N/s"), 8
"""Units of the numbers that shape a law, and how many of them may be free."""
VISCOUS = "viscous_coefficient"
Model = TypeVar("Model", bound=Parameters)
CHECK_SAMPLES, CHECK_STEP_S = 400, 1e-3
CHECK_TOLERANCE = 1e-9
"""Difference of the forces, over the largest, up to which two models are the same."""


class ScaledParameter(NamedTuple):
    """A number of a friction model."""

    name: str
    value: float
    unit: str
    exponents: tuple[int, int]
    """Powers of the scales of force and deflection."""


def scaled_parameters(model: Parameters, prefix: str = "") -> Iterator[ScaledParameter]:
    """Yield the numbers of a model, and of its parts, that its scales change."""
    for name, value, unit in _fields(model):
        numbered = {f".{place}": each for place, each in enumerate(value)} if isinstance(value, tuple) else {"": value}
        for place, each in numbered.items():
            path = f"{prefix}{name}{place}"
            if isinstance(each, Parameters):
                yield from scaled_parameters(each, f"{path}.")
            elif unit in EXPONENTS and isinstance(each, float) and each:
                yield ScaledParameter(path, each, unit, EXPONENTS[unit])


def shape_parameters(model: FrictionModel) -> tuple[str, ...]:
    """Return the names of the numbers besides the scales that a record of friction tells, but for too many of them.

    These are viscous friction, and all numbers but stiffnesses, which the scales change, with the first force and the
    first length.
    """
    known = list(scaled_parameters(model))
    of_unit = {unit: [each.name for each in known if each.unit == unit] for unit in EXPONENTS}
    viscous = (VISCOUS,) if getattr(model, VISCOUS, 0.0) else ()
    names = (*viscous, *of_unit["N"][1:], *of_unit["m"][1:], *(n for unit in SHAPE_UNITS for n in of_unit[unit]))
    return names if len(names) <= MAX_SHAPE_PARAMETERS else viscous


def scaled_friction(model: FrictionModel, scales: tuple[float, float], stroke: float) -> FrictionModel | None:
    """Return the model of the same law with the force s f(y/c), for scales s and c; None if its parameters cannot.

    Each parameter changes as its unit says. Whether that is the scaled law is tried along a motion of this stroke [m].
    """
    try:
        changed = _scaled(model, scales)
    except ParameterError:
        return None
    return changed if _is_scaled(model, changed, scales, stroke) else None


def _fields(model: Parameters) -> Iterator[tuple[str, Any, str]]:
    """Yield name, value and unit of each parameter; no unit for viscous friction, which is no part of the law."""
    for name, field in type(model).model_fields.items():
        declared = field.json_schema_extra
        unit = str(declared.get("unit", "")) if isinstance(declared, dict) and name != VISCOUS else ""
        yield name, getattr(model, name), unit


def _scaled(model: Model, scales: tuple[float, float]) -> Model:
    """Return a model, or a part of one, all of whose numbers change at once: their bounds depend on each other."""
    values = {name: _scaled_value(value, unit, scales) for name, value, unit in _fields(model)}
    return type(model).parse(values, getattr(model, "name", "friction"))


def _scaled_value(value: Any, unit: str, scales: tuple[float, float]) -> Any:
    if isinstance(value, tuple):
        return tuple(_scaled_value(each, unit, scales) for each in value)
    if isinstance(value, Parameters):
        return _scaled(value, scales)
    if unit not in EXPONENTS or not isinstance(value, float):
        return value
    force, displacement = EXPONENTS[unit]
    return value * scales[0] ** force * scales[1] ** displacement


def _is_scaled(model: FrictionModel, changed: FrictionModel, scales: tuple[float, float], stroke: float) -> bool:
    motion = stroke * np.sin(np.linspace(0.0, 4 * np.pi, CHECK_SAMPLES)) * np.linspace(0.1, 1.0, CHECK_SAMPLES)
    expected: NDArray[np.float64] = scales[0] * model.force(motion / scales[1], CHECK_STEP_S)
    found = changed.force(motion, CHECK_STEP_S)
    return bool(np.abs(found - expected).max() <= CHECK_TOLERANCE * np.abs(expected).max(initial=0.0))
