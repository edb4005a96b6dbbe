"""How uncertain a friction model is: standard deviations of its parameters, and what they have in common."""

from collections.abc import Iterator, Sequence
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
    deviation: float = param("1", "its standard deviation, in the parameter's own SI unit", above=0)


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
    values, vectors = np.linalg.eigh(correlation_matrix(correlation, len(deviations)))
    sizes = np.array([each.deviation for each in deviations])
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


def moved(friction: FrictionModel, deviations: Sequence[Deviation], amounts: np.ndarray) -> FrictionModel:
    """Return the friction model with its parameters moved by `amounts` [their SI units], shape (deviations,)."""
    for each, amount in zip(deviations, amounts, strict=True):
        if amount:
            friction = _changed(friction, each.parameter.split("."), float(amount), each.parameter)
    return friction


def _changed(owner: Any, path: Sequence[str], amount: float, whole: str) -> Any:
    """Return a copy of a component, a group or a list in which the number at `path` is greater by `amount`."""
    if not path:
        if isinstance(owner, bool) or not isinstance(owner, float):
            raise ParameterError(f"deviations: '{whole}' is {owner!r}; only numbers deviate")
        return owner + amount
    first, *rest = path
    if isinstance(owner, tuple):
        if not first.isdecimal() or int(first) >= len(owner):
            raise ParameterError(f"deviations: '{whole}' has no place '{first}'; expected 0 to {len(owner) - 1}")
        index = int(first)
        return (*owner[:index], _changed(owner[index], rest, amount, whole), *owner[index + 1 :])
    if not isinstance(owner, Parameters):
        raise ParameterError(f"deviations: '{whole}' goes beyond a number at '{first}'")
    fields = type(owner).model_fields
    if first not in fields:
        raise ParameterError(f"deviations: there is no parameter '{whole}'{did_you_mean(first, fields)}")
    values = {key: getattr(owner, key) for key in fields}
    values[first] = _changed(values[first], rest, amount, whole)
    return type(owner).parse(values, f"deviations: {getattr(owner, 'name', '') or type(owner).__name__}")
