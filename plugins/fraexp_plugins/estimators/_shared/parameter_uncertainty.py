"""The uncertainty of a model of friction or of a plant: standard deviations of parameters, and their correlation."""

from collections.abc import Mapping, Sequence
from functools import cache
from math import inf
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import MAX_ITERATIONS, ROUNDING, ParameterError, Parameters, did_you_mean, param

Model = TypeVar("Model", bound=Parameters)


class Deviation(Parameters):
    """The standard deviation of one parameter of a model."""

    parameter: str = param(
        "", "name of the parameter, with dots to parts and to places in a list: `coulomb_force`, `stiffness.0`"
    )
    std: object = param("", "its standard deviation: a number in the parameter's SI unit, or text such as `0.5 N s/m`")
    """A text is read once the model is known, which has the parameter's unit."""

    def model_post_init(self, context: object) -> None:
        """Check that it is a text or a positive number."""
        given = self.std
        is_number = isinstance(given, float | int) and not isinstance(given, bool) and 0 < given < inf
        if not is_number and not isinstance(given, str):
            raise ParameterError(f"deviations: std of '{self.parameter}' is {given!r}; expected a number above 0")

    def in_si_units(self, model: Model) -> float:
        """Return the standard deviation in the parameter's SI unit."""
        unit = _target(model, self.parameter).unit
        return _std_in(unit).parse({"std": self.std}, f"deviations: '{self.parameter}'").std


class _Std(Parameters):
    """A standard deviation in SI units."""

    std: float = param("1", "standard deviation", above=0)


@cache
def _std_in(unit: str) -> type[_Std]:
    """Return a class that reads texts of this unit."""

    class StdInUnit(_Std):
        std: float = param(unit, "standard deviation", above=0)

    return StdInUnit


def check_deviations(model: Model, deviations: Sequence[Deviation], correlation: Sequence[Sequence[float]]) -> None:
    """Raise ParameterError unless each deviation has a parameter of its own, whose bounds allow it."""
    correlation_matrix(correlation, len(deviations))
    for number, each in enumerate(deviations):
        with_moved_parameters(model, [each], [each.in_si_units(model)])
        path = _target(model, each.parameter).path
        if any(_target(model, other.parameter).path == path for other in deviations[:number]):
            raise ParameterError(f"deviations: '{each.parameter}' is given twice; give each parameter once")


def correlation_matrix(correlation: Sequence[Sequence[float]], count: int) -> NDArray[np.float64]:
    """Return the correlation matrix, shape (count, count); the unit matrix if none is given."""
    if not correlation:
        return np.eye(count)
    rows = [len(row) for row in correlation]
    if rows != [count] * count:
        raise ParameterError(
            f"correlation has rows of {rows} numbers; expected {count} rows of {count}, one for each deviation"
        )
    matrix = np.array(correlation, dtype=float)
    if np.abs(matrix - matrix.T).max() > ROUNDING or np.abs(np.diag(matrix) - 1).max() > ROUNDING:
        raise ParameterError("correlation: expected a symmetric matrix with 1 on its diagonal")
    if np.linalg.eigvalsh(matrix)[0] < -ROUNDING:
        raise ParameterError("correlation has a negative eigenvalue; expected a positive semi-definite matrix")
    return matrix


def covariance_root(
    model: Model, deviations: Sequence[Deviation], correlation: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    """Return columns whose outer products add up to the parameters' covariance, shape (deviations, columns)."""
    check_deviations(model, deviations, correlation)
    values, vectors = np.linalg.eigh(correlation_matrix(correlation, len(deviations)))
    sizes = np.array([each.in_si_units(model) for each in deviations])
    is_free = values > ROUNDING
    return np.asarray(sizes[:, None] * vectors[:, is_free] * np.sqrt(values[is_free]))


def moved_within_bounds(model: Model, deviations: Sequence[Deviation], amounts: NDArray[np.float64]) -> Model:
    """Return the model with parameters moved by `amounts` [their SI units], or by less if bounds do not allow it."""
    for _ in range(MAX_ITERATIONS):
        try:
            return with_moved_parameters(model, deviations, amounts)
        except ParameterError:
            amounts = amounts / 2
    return model


def with_moved_parameters(
    model: Model, deviations: Sequence[Deviation], amounts: Sequence[float | str] | NDArray[np.float64]
) -> Model:
    """Return the model with its parameters moved by `amounts` [their SI units], shape (deviations,).

    A text stands for one standard deviation.
    """
    for each, amount in zip(deviations, amounts, strict=True):
        path = _target(model, each.parameter).path
        step = each.in_si_units(model) if isinstance(amount, str) else float(amount)
        moved = _increased(model, path, step) if step else model
        assert isinstance(moved, type(model))
        model = moved
    return model


def parameter_value(model: Model, parameter: str) -> float:
    """Return a parameter by its name [its SI unit]; ParameterError if it does not exist or is not a number."""
    return _target(model, parameter).value


def parameter_unit(model: Model, parameter: str) -> str:
    """Return the SI unit of a parameter by its name."""
    return _target(model, parameter).unit


def with_parameters(model: Model, values: Mapping[str, float]) -> Model:
    """Return the model with other values of some parameters [their SI units], checked together."""
    fields = _fields(model)
    for parameter, value in values.items():
        target = _target(model, parameter)
        first, *rest = target.path
        fields[str(first)] = _increased(fields[str(first)], rest, value - target.value)
    return _parse(model, fields) if values else model


class _Target(NamedTuple):
    """A parameter of a model."""

    path: tuple[str | int, ...]
    """Names of today, and places in lists."""
    value: float
    unit: str


def _target(model: Model, parameter: str) -> _Target:
    """Return a parameter by its name; ParameterError if it does not exist or is not a number."""
    found: object = model
    path: list[str | int] = []
    unit = ""
    for part in parameter.split("."):
        if isinstance(found, tuple):
            if not part.isdecimal() or int(part) >= len(found):
                raise ParameterError(f"deviations: '{parameter}' has no place '{part}'; expected 0 to {len(found) - 1}")
            path.append(int(part))
            found = found[int(part)]
            continue
        if not isinstance(found, Parameters):
            raise ParameterError(f"deviations: '{parameter}' has no part '{part}': what comes before it is a number")
        fields = type(found).model_fields
        if part not in fields:
            raise ParameterError(f"deviations: there is no parameter '{parameter}'{did_you_mean(part, fields)}")
        path.append(part)
        found, unit = getattr(found, part), _unit(fields[part].json_schema_extra)
    if isinstance(found, bool) or not isinstance(found, float):
        raise ParameterError(f"deviations: '{parameter}' is {found!r}; expected the name of a number")
    return _Target(tuple(path), found, unit)


def _unit(declared: object) -> str:
    return str(declared["unit"]) if isinstance(declared, dict) else ""


def _increased(owner: object, path: Sequence[str | int], amount: float) -> object:
    """Return a copy of a component, a group or a list whose number at `path` is larger by `amount`."""
    if isinstance(owner, float):
        return owner + amount
    first, *rest = path
    if isinstance(owner, tuple):
        index = int(first)
        return (*owner[:index], _increased(owner[index], rest, amount), *owner[index + 1 :])
    assert isinstance(owner, Parameters)  # _target has followed the path
    values = _fields(owner)
    values[str(first)] = _increased(values[str(first)], rest, amount)
    return _parse(owner, values)


def _fields(owner: Parameters) -> dict[str, object]:
    return {key: getattr(owner, key) for key in type(owner).model_fields}


def _parse(owner: Model, values: Mapping[str, object]) -> Model:
    return type(owner).parse(values, f"deviations: {getattr(owner, 'name', '') or type(owner).__name__}")
