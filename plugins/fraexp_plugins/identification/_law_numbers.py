"""The numbers of a friction law, whichever it is: with other scales, and as the search for a fit sees them."""

from collections.abc import Collection, Iterator, Mapping
from copy import copy
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from fraexp.api import CURVE_POINTS, ROUNDING, FrictionModel, ParameterError, Parameters

EXPONENTS = {"N": (1, 0), "m": (0, 1), "N/m": (1, -1), "N s/m": (1, -1), "m/s": (0, 1), "N/s": (1, 0)}
"""Powers of the scales of force and deflection with which a parameter of this unit changes."""
SHAPE_UNITS, MAX_SHAPE_PARAMETERS = ("N s/m", "m/s", "N/s"), 8
"""Units of the numbers that shape a law, and how many of them may be free."""
VISCOUS = "viscous_coefficient"
LAW_ELEMENTS = 4
"""Elements of a law with a Stribeck effect, where their number is not stated. Half of them make its rise two straight
lines."""
STATIC_RATIO = 1.2
"""Static over Coulomb force at which a search begins."""
DAMPING_RATIO, ATTRACTION_RATIO = 0.01, 10.0
"""Damping over that of the Coulomb force at the speed, and attraction over the stiffness times the speed."""
Model = TypeVar("Model", bound=Parameters)


class Number(NamedTuple):
    """A number of a model, or a term beside it."""

    name: str
    """With dots to parts of the model and to places in a list: `curve.max_knot`, `stiffness.0`."""
    value: float
    unit: str
    lower: float = 0.0
    """Bound below; the law's first force for one that must not be less."""
    upper: float = np.inf
    """Bound above; infinite if there is none."""

    @property
    def field(self) -> str:
        """Name of the model's field."""
        return self.name.partition(".")[0]

    @property
    def is_first(self) -> bool:
        """Whether it is the first of a list."""
        return self.name.endswith(".0")

    @property
    def exponents(self) -> tuple[int, int]:
        """Powers of the scales of force and deflection; none of viscous friction, which is no part of a law."""
        return (0, 0) if self.name == VISCOUS else EXPONENTS.get(self.unit, (0, 0))

    @property
    def is_scaled(self) -> bool:
        """Whether the scales change it."""
        return any(self.exponents) and self.value != 0

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value: a logarithm, of the odds where there is a bound above."""
        above = max(value - self.lower, ROUNDING * value)
        return float(np.log(above / (self.upper - value) if np.isfinite(self.upper) else above))

    def value_at(self, coordinate: float) -> float:
        """Return the value of a coordinate."""
        if np.isfinite(self.upper):
            return float(self.lower + (self.upper - self.lower) * min(1 / (1 + np.exp(-coordinate)), 1 - 1e-9))
        return float(self.lower + np.exp(coordinate))


def numbers_of(model: Parameters, prefix: str = "") -> Iterator[Number]:
    """Yield all numbers of a model, and of its parts."""
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        low, high = (None, None) if isinstance(value, tuple) else _bounds(info)
        numbered = {f".{place}": each for place, each in enumerate(value)} if isinstance(value, tuple) else {"": value}
        for place, each in numbered.items():
            path = f"{prefix}{name}{place}"
            if isinstance(each, Parameters):
                yield from numbers_of(each, f"{path}.")
            elif isinstance(each, float):
                yield Number(path, each, unit_of_field(info), low or 0.0, np.inf if high is None else high)


def with_numbers(model: Model, values: Mapping[str, Any]) -> Model:
    """Return a model with other values of some numbers or lists, all at once: their bounds depend on each other.

    Those that it does not have are left out.
    """

    def changed(value: Any, path: str) -> Any:
        if path in values:
            return values[path]
        if isinstance(value, tuple):
            return tuple(changed(each, f"{path}.{place}") for place, each in enumerate(value))
        if isinstance(value, Parameters):
            own = {name.removeprefix(f"{path}."): each for name, each in values.items() if name.startswith(f"{path}.")}
            return with_numbers(value, own)
        return value

    named = {name.partition(".")[0] for name in values} & type(model).model_fields.keys()
    return type(model)(**{name: changed(getattr(model, name), name) for name in model.model_fields_set | named})


def nonzero_numbers(model: Parameters) -> tuple[str, ...]:
    """Return the names of all numbers of a model, and of its parts, that are not 0."""
    return tuple(each.name for each in numbers_of(model) if each.value)


def shape_parameters(model: FrictionModel) -> tuple[str, ...]:
    """Return the names of the numbers besides the scales that a record of friction tells, but for too many of them.

    These are viscous friction, and all numbers but stiffnesses, which the scales change, with the first force and the
    first length. A pure number is one if the law has no value of its own for it.
    """
    known = [each for each in numbers_of(model) if each.is_scaled]
    of_unit = {unit: [each.name for each in known if each.unit == unit] for unit in EXPONENTS}
    viscous = (VISCOUS,) if getattr(model, VISCOUS, 0.0) else ()
    pure = [
        name
        for name, info in type(model).model_fields.items()
        if info.is_required() and unit_of_field(info) == "1" and isinstance(getattr(model, name), float)
    ]
    sized = [n for unit in SHAPE_UNITS for n in of_unit[unit]]
    names = (*viscous, *of_unit["N"][1:], *of_unit["m"][1:], *sized, *pure)
    return names if len(names) <= MAX_SHAPE_PARAMETERS else viscous


def scaled_friction(model: FrictionModel, scales: tuple[float, float], stroke: float) -> FrictionModel | None:
    """Return the model of the same law with the force s f(y/c), for scales s and c; None if its parameters cannot.

    Each parameter changes as its unit says. Whether that is the scaled law is tried along a motion of this stroke [m].
    """
    numbers = [each for each in numbers_of(model) if any(each.exponents)]
    powers = [scales[0] ** each.exponents[0] * scales[1] ** each.exponents[1] for each in numbers]
    try:
        changed = with_numbers(model, {n.name: n.value * power for n, power in zip(numbers, powers, strict=True)})
    except ParameterError:
        return None
    return changed if _is_scaled(model, changed, scales, stroke) else None


def unit_of_field(info: FieldInfo) -> str:
    """Return the unit of a parameter."""
    declared = info.json_schema_extra
    return str(declared.get("unit", "")) if isinstance(declared, dict) else ""


def _is_scaled(model: FrictionModel, changed: FrictionModel, scales: tuple[float, float], stroke: float) -> bool:
    motion = stroke * np.sin(np.linspace(0.0, 4 * np.pi, CURVE_POINTS)) * np.linspace(0.1, 1.0, CURVE_POINTS)
    step = 1 / CURVE_POINTS  # of a motion of a second
    expected: NDArray[np.float64] = scales[0] * model.force(motion / scales[1], step)
    found = changed.force(motion, step)
    return bool(np.abs(found - expected).max() <= ROUNDING * np.abs(expected).max(initial=0.0))


class LawNumbers:
    """The numbers that a friction model states, of whatever law, as a search sees them: coordinates without bounds.

    Numbers at their defaults, those that are 0 and the viscous coefficient are not estimated. The first force is no
    coordinate, as the law's force is proportional to it if all numbers change as their units say; nor is the first of
    fractions that add up to 1.
    """

    def __init__(self, model: FrictionModel, fixed: Collection[str] = ()) -> None:
        self.start = model
        known = estimated_numbers(model)
        self._force = next((each for each in known if each.unit == "N" and each.name == each.field), None)
        self.numbers = [self._bounded(each) for each in known]
        firsts = [each for each in known if each.unit == "1" and each.is_first]
        self._shares = {each.field for each in firsts if np.isclose(sum(getattr(model, each.field)), 1.0)}
        held = [self._force, *(each for each in firsts if each.field in self._shares)]
        self._free = [place for place, each in enumerate(known) if each not in held and each.field not in fixed]

    def above(self, bounds: Mapping[str, float]) -> "LawNumbers":
        """Return the numbers with bounds below for some units, for a first force of 1 N."""
        found = copy(self)
        found.numbers = [each._replace(lower=bounds.get(each.unit, each.lower)) for each in self.numbers]
        return found

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates."""
        return tuple(self.numbers[place].unit for place in self._free)

    def coordinates_at(self, sizes: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the coordinates of numbers with given distances from their bounds by unit; others as at the start."""
        chosen = [self.numbers[place] for place in self._free]
        values = [each.lower + sizes.get(each.unit, each.value - each.lower) for each in chosen]
        return np.array([each.coordinate(value) for each, value in zip(chosen, values, strict=True)])

    def force_excess(self, coordinates: NDArray[np.float64]) -> float:
        """Return the greatest force that is bounded by the first one, over that, less 1; 0 if there is none."""
        values = zip(self.numbers, self.values(coordinates).tolist(), strict=True)
        bounded = [value / each.lower - 1 for each, value in values if each.unit == "N" and each.lower > 0]
        return max(bounded, default=0.0)

    def _bounded(self, number: Number) -> Number:
        """Return a number with the first force as its bound, if the law allows no less."""
        if self._force is None or number.unit != "N" or number == self._force or number.name != number.field:
            return number
        try:
            with_numbers(self.start, {number.name: 0.5 * self._force.value})
        except ParameterError:
            return number._replace(lower=self._force.value)
        return number

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Coordinates of the start, shape (q,)."""
        return self.coordinates_at({})

    def values(self, coordinates: NDArray[np.float64], force_scale: float = 1.0) -> NDArray[np.float64]:
        """Return the values of all numbers, with forces that are larger by a factor, shape (p,)."""
        found = np.array([each.value for each in self.numbers])
        for place, coordinate in zip(self._free, coordinates.tolist(), strict=True):
            found[place] = self.numbers[place].value_at(coordinate)
        for field in self._shares:
            places = [place for place, each in enumerate(self.numbers) if each.field == field]
            found[places] /= found[places].sum()
        powers = [EXPONENTS.get(each.unit, (0, 0))[0] for each in self.numbers]
        return np.asarray(found * force_scale ** np.array(powers))

    def force(self, force_scale: float) -> float:
        """Return the law's first force [N], by which others are judged; 0 if it has none."""
        return force_scale * self._force.value if self._force is not None else 0.0

    def model(self, coordinates: NDArray[np.float64], force_scale: float = 1.0, viscous: float = 0.0) -> FrictionModel:
        """Return the model with these numbers; ParameterError for what the law does not allow."""
        with np.errstate(over="ignore", invalid="ignore"):
            values = self.values(coordinates, force_scale).tolist()
        named = {each.name: value for each, value in zip(self.numbers, values, strict=True)}
        return with_numbers(self.start, named | {VISCOUS: viscous})


def estimated_numbers(model: FrictionModel) -> list[Number]:
    """Return the numbers that a model states and that are estimated: those that are not 0, but of its parts."""
    stated = {name for name in model.model_fields_set - {VISCOUS} if not isinstance(getattr(model, name), Parameters)}
    known = [each for each in numbers_of(model) if each.field in stated and each.value]
    return [each for each in known if each.unit in EXPONENTS or each.unit == "1"]


def lists_by_unit(model: FrictionModel) -> dict[str, str]:
    """Return the names of the lists of numbers of elements that a model states, by their unit."""
    names = [name for name in type(model).model_fields if name in model.model_fields_set]
    lists = [name for name in names if isinstance(getattr(model, name), tuple)]
    return {unit_of_field(type(model).model_fields[name]): name for name in lists}


def _bounds(info: FieldInfo) -> tuple[float | None, float | None]:
    """Return the bounds of a parameter; None where it has none."""
    low, high = (
        next((float(getattr(each, word)) for each in info.metadata for word in words if hasattr(each, word)), None)
        for words in (("gt", "ge"), ("lt", "le"))
    )
    return low, high


def rough_model(
    law: type[FrictionModel],
    elements: tuple[NDArray[np.float64], NDArray[np.float64]],
    speed: float,
    with_damping: bool = False,
    needed_alone: bool = False,
) -> FrictionModel:
    """Return a model of any law, at which a search begins: each number has the size that its unit says.

    With `needed_alone` numbers that have a default keep it.

    `elements` are K_i [N/m] and F_mi [N] of rolling elements, and `speed` [m/s] one at which the machine slides. A
    number of another unit that the law needs is that of its first preset, else the middle of its bounds; ParameterError
    if it has neither.
    """
    force, stiffness = (float(each.sum()) for each in reversed(elements))
    lists = {"N/m": elements[0], "N": elements[1], "1": elements[1] / force}
    sizes = {"N/m": stiffness, "m": force / stiffness, "m/s": speed, "N/s": ATTRACTION_RATIO * stiffness * speed}
    sizes["N s/m"] = DAMPING_RATIO * force / speed
    forces, fields = iter([force]), dict[str, Any]()
    for name, info in law.model_fields.items():
        unit, is_list = unit_of_field(info), "tuple" in str(info.annotation)
        is_optional = is_list or needed_alone or (unit == "N s/m" and not with_damping)
        if name == VISCOUS or (is_optional and not info.is_required()):
            continue
        if is_list and unit in lists:
            fields[name] = tuple(lists[unit].tolist())
        elif unit == "N":
            fields[name] = next(forces, STATIC_RATIO * force)
        elif unit in sizes:
            fields[name] = sizes[unit]
        elif unit == "1" and any(getattr(each, "lt", None) for each in info.metadata):
            fields[name] = sum(each or 0.0 for each in _bounds(info)) / 2
        elif info.is_required() and (stated := _stated_value(law, name)) is not None:
            fields[name] = stated
    return law.parse(fields, law.name)


def _stated_value(law: type[FrictionModel], name: str) -> Any:
    """Return what a law states of a number: a preset, or the middle of its bounds; None if there is neither."""
    low, high = _bounds(law.model_fields[name])
    preset = next((values[name] for values in law.presets.values() if name in values), None)
    return (low + high) / 2 if preset is None and low is not None and high is not None else preset
