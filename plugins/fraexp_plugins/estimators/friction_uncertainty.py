"""How uncertain a friction model is: standard deviations of its parameters, and what they have in common."""

from collections.abc import Iterator, Sequence
from functools import cache
from math import inf
from typing import Any

import numpy as np

from fraexp.api import FrictionModel, ParameterError, Parameters, did_you_mean, param

ROUNDING = 1e-6
"""How far a correlation matrix may be from symmetric, and below 0 its eigenvalues, by the rounding of its numbers."""
HALVINGS = 10
"""How often a step is halved that a parameter's bounds do not allow."""


class Deviation(Parameters):
    """The standard deviation of one parameter of a friction model."""

    parameter: str = param(
        "", "name of the parameter, with dots to parts and to places in a list: `coulomb`, `curve.width`, `stiffness.0`"
    )
    deviation: object = param("", "its standard deviation: a number in the parameter's SI unit, or such as `0.5 N s/m`")
    """A text is read only when the friction model tells the parameter's unit."""

    def model_post_init(self, context: object) -> None:
        """Check a number."""
        given = self.deviation
        is_number = isinstance(given, float | int) and not isinstance(given, bool) and 0 < given < inf
        if not is_number and not isinstance(given, str):
            raise ParameterError(f"deviations: that of '{self.parameter}' is {given!r}; expected a number above 0")

    def size(self, friction: FrictionModel) -> float:
        """Return the standard deviation in the parameter's SI unit."""
        _, unit = _number(friction, self.parameter)
        return _in_unit(unit).parse({"deviation": self.deviation}, f"deviations: '{self.parameter}'").deviation


class _Size(Parameters):
    """A standard deviation in SI units."""

    deviation: float = param("1", "standard deviation", above=0)


@cache
def _in_unit(unit: str) -> type[_Size]:
    """Return one that reads texts of this unit."""

    class InUnit(_Size):
        deviation: float = param(unit, "standard deviation", above=0)

    return InUnit


def check_deviations(
    friction: FrictionModel, deviations: Sequence[Deviation], correlation: Sequence[Sequence[float]]
) -> None:
    """Raise ParameterError unless each deviates a parameter of its own, by an amount that its bounds allow."""
    correlation_matrix(correlation, len(deviations))
    for number, each in enumerate(deviations):
        moved(friction, [each], [each.size(friction)])
        if any(_places(each.parameter) == _places(other.parameter) for other in deviations[:number]):
            raise ParameterError(f"deviations: '{each.parameter}' is given twice; give each parameter once")


def correlation_matrix(correlation: Sequence[Sequence[float]], count: int) -> np.ndarray:
    """Return the correlation of so many deviations, shape (count, count); without one they are independent."""
    if not correlation:
        return np.eye(count)
    rows = [len(row) for row in correlation]
    if rows != [count] * count:
        raise ParameterError(f"correlation has rows of {rows} numbers; expected {count} rows of {count}, by deviation")
    matrix = np.array(correlation, dtype=float)
    if np.abs(matrix - matrix.T).max() > ROUNDING or np.abs(np.diag(matrix) - 1).max() > ROUNDING:
        raise ParameterError("correlation must be symmetric, with 1 on its diagonal")
    if np.linalg.eigvalsh(matrix)[0] < -ROUNDING:
        raise ParameterError("correlation has a negative eigenvalue; expected the correlation matrix of a covariance")
    return matrix


def perturbed(
    friction: FrictionModel, deviations: Sequence[Deviation], correlation: Sequence[Sequence[float]], steps: float
) -> Iterator[tuple[FrictionModel, FrictionModel, float]]:
    """Yield the model above and below along each column of a square root of its parameters' covariance.

    With them comes how many columns they are away: `steps`, or less where the bounds of a parameter do not allow that.
    """
    check_deviations(friction, deviations, correlation)
    values, vectors = np.linalg.eigh(correlation_matrix(correlation, len(deviations)))
    sizes = np.array([each.size(friction) for each in deviations])
    for value, vector in zip(values, vectors.T, strict=True):
        if value > ROUNDING:
            yield _either_side(friction, deviations, sizes * vector * np.sqrt(value), steps)


def _either_side(
    friction: FrictionModel, deviations: Sequence[Deviation], column: np.ndarray, steps: float
) -> tuple[FrictionModel, FrictionModel, float]:
    for _ in range(HALVINGS):
        try:
            return moved(friction, deviations, steps * column), moved(friction, deviations, -steps * column), steps
        except ParameterError:
            steps /= 2
    return moved(friction, deviations, steps * column), moved(friction, deviations, -steps * column), steps


def moved(
    friction: FrictionModel, deviations: Sequence[Deviation], amounts: Sequence[float | str] | np.ndarray
) -> FrictionModel:
    """Return the friction model with its parameters moved by `amounts` [their SI units], shape (deviations,).

    A text stands for one standard deviation.
    """
    for each, amount in zip(deviations, amounts, strict=True):
        _number(friction, each.parameter)
        step = each.size(friction) if isinstance(amount, str) else float(amount)
        if step:
            friction = _changed(friction, each.parameter.split("."), step)
    return friction


def _number(friction: FrictionModel, parameter: str) -> tuple[float, str]:
    """Return the value and the unit of a parameter; ParameterError unless it is there and a number."""
    found: Any = friction
    unit = ""
    for part in parameter.split("."):
        if isinstance(found, tuple):
            if not part.isdecimal() or int(part) >= len(found):
                raise ParameterError(f"deviations: '{parameter}' has no place '{part}'; expected 0 to {len(found) - 1}")
            found = found[int(part)]
            continue
        if not isinstance(found, Parameters):
            raise ParameterError(f"deviations: '{parameter}' goes beyond a number at '{part}'")
        fields = type(found).model_fields
        if part not in fields:
            raise ParameterError(f"deviations: there is no parameter '{parameter}'{did_you_mean(part, fields)}")
        found, unit = getattr(found, part), _unit(fields[part].json_schema_extra)
    if isinstance(found, bool) or not isinstance(found, float):
        raise ParameterError(f"deviations: '{parameter}' is {found!r}; only numbers deviate")
    return found, unit


def _unit(declared: Any) -> str:
    return str(declared["unit"]) if isinstance(declared, dict) else ""


def _places(parameter: str) -> list[str | int]:
    """Return the parts of a parameter's name, places in a list as numbers."""
    return [int(part) if part.isdecimal() else part for part in parameter.split(".")]


def _changed(owner: Any, path: Sequence[str], amount: float) -> Any:
    """Return a copy of a component, a group or a list in which the number at `path` is greater by `amount`."""
    if not path:
        return owner + amount
    first, *rest = path
    if isinstance(owner, tuple):
        index = int(first)
        return (*owner[:index], _changed(owner[index], rest, amount), *owner[index + 1 :])
    values = {key: getattr(owner, key) for key in type(owner).model_fields}
    values[first] = _changed(values[first], rest, amount)
    return type(owner).parse(values, f"deviations: {getattr(owner, 'name', '') or type(owner).__name__}")
