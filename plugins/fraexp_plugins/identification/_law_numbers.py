"""The numbers of a friction law, whichever it is: with other scales, and as the search for a fit sees them."""

from collections.abc import Collection, Iterator, Mapping
from copy import copy
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from fraexp.api import ROUNDING, FrictionModel, ParameterError, Parameters

EXPONENTS = {"N": (1, 0), "m": (0, 1), "N/m": (1, -1), "N s/m": (1, -1), "m/s": (0, 1), "N/s": (1, 0)}
"""Powers of the scales of force and deflection with which a parameter of this unit changes."""
SHAPE_UNITS, MAX_SHAPE_PARAMETERS = ("N s/m", "m/s", "N/s"), 8
"""Units of the numbers that shape a law, and how many of them may be free."""
VISCOUS = "viscous_coefficient"
STATIC_RATIO, START_RATIO = 1.2, 0.5
"""Static over Coulomb force at which a search begins, and a ratio of two of the law's numbers."""
DAMPING_RATIO, ATTRACTION_RATIO = 0.01, 10.0
"""Damping over that of the Coulomb force at the speed, and attraction over the stiffness times the speed."""
Model = TypeVar("Model", bound=Parameters)
CHECK_SAMPLES, CHECK_STEP_S = 400, 1e-3


class Number(NamedTuple):
    """A number of a model, or a term beside it."""

    name: str
    """With dots to parts of the model and to places in a list: `curve.max_knot`, `stiffness.0`."""
    value: float
    unit: str

    @property
    def exponents(self) -> tuple[int, int]:
        """Powers of the scales of force and deflection; none of viscous friction, which is no part of a law."""
        return (0, 0) if self.name == VISCOUS else EXPONENTS.get(self.unit, (0, 0))

    @property
    def is_scaled(self) -> bool:
        """Whether the scales change it."""
        return any(self.exponents) and self.value != 0


def numbers_of(model: Parameters, prefix: str = "") -> Iterator[Number]:
    """Yield all numbers of a model, and of its parts."""
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        numbered = {f".{place}": each for place, each in enumerate(value)} if isinstance(value, tuple) else {"": value}
        for place, each in numbered.items():
            path = f"{prefix}{name}{place}"
            if isinstance(each, Parameters):
                yield from numbers_of(each, f"{path}.")
            elif isinstance(each, float):
                yield Number(path, each, unit_of_field(info))


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
    try:
        changed = _scaled(model, scales)
    except ParameterError:
        return None
    return changed if _is_scaled(model, changed, scales, stroke) else None


def unit_of_field(info: FieldInfo) -> str:
    """Return the unit of a parameter."""
    declared = info.json_schema_extra
    return str(declared.get("unit", "")) if isinstance(declared, dict) else ""


def _scaled(model: Model, scales: tuple[float, float]) -> Model:
    """Return a model, or a part of one, all of whose numbers change at once: their bounds depend on each other."""
    units = {name: unit_of_field(info) for name, info in type(model).model_fields.items()} | {VISCOUS: ""}
    values = {name: _scaled_value(getattr(model, name), units[name], scales) for name in type(model).model_fields}
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
    return bool(np.abs(found - expected).max() <= ROUNDING * np.abs(expected).max(initial=0.0))


class LawNumber(NamedTuple):
    """A number of a law that is estimated."""

    field: str
    place: int | None
    """Place in a list of numbers; None for a number alone."""
    unit: str
    value: float
    """At the start."""
    upper: float
    """Bound above; infinite if there is none."""
    base: float
    """Bound below; the law's first force for one that must not be less."""

    @property
    def name(self) -> str:
        """Name as in a fit: `stiffness.0`."""
        return self.field if self.place is None else f"{self.field}.{self.place}"

    def coordinate(self) -> float:
        """Return where a search begins: a logarithm, of the odds where there is a bound above."""
        above = max(self.value - self.base, ROUNDING * self.value)
        return float(np.log(above / (self.upper - self.value) if np.isfinite(self.upper) else above))

    def value_at(self, coordinate: float) -> float:
        """Return the value of a coordinate."""
        if np.isfinite(self.upper):
            return float(self.base + (self.upper - self.base) * min(1 / (1 + np.exp(-coordinate)), 1 - 1e-9))
        return float(self.base + np.exp(coordinate))


class LawNumbers:
    """The numbers that a friction model states, of whatever law, as a search sees them: coordinates without bounds.

    Numbers at their defaults, those that are 0 and the viscous coefficient are not estimated. The first force is no
    coordinate, as the law's force is proportional to it if all numbers change as their units say; nor is the first of
    fractions that add up to 1.
    """

    def __init__(self, model: FrictionModel, fixed: Collection[str] = ()) -> None:
        self.start = model
        known = estimated_numbers(model)
        self._force = next((each for each in known if each.unit == "N" and each.place is None), None)
        self.numbers = [self._bounded(each) for each in known]
        self._shares = {
            each.field
            for each in known
            if each.unit == "1" and each.place == 0 and np.isclose(sum(getattr(model, each.field)), 1.0)
        }
        self._free = [
            place
            for place, each in enumerate(known)
            if each is not self._force
            and each.field not in fixed
            and not (each.field in self._shares and each.place == 0)
        ]

    def above(self, bases: Mapping[str, float]) -> "LawNumbers":
        """Return the numbers with bounds below for some units, for a first force of 1 N."""
        found = copy(self)
        found.numbers = [each._replace(base=bases.get(each.unit, each.base)) for each in self.numbers]
        return found

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the coordinates."""
        return tuple(self.numbers[place].unit for place in self._free)

    def coordinates_at(self, sizes: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the coordinates of numbers with given distances from their bounds by unit; others as at the start."""
        chosen = [self.numbers[place] for place in self._free]
        values = [each.base + sizes.get(each.unit, each.value - each.base) for each in chosen]
        return np.array([each._replace(value=value).coordinate() for each, value in zip(chosen, values, strict=True)])

    def force_excess(self, coordinates: NDArray[np.float64]) -> float:
        """Return the greatest force that is bounded by the first one, over that, less 1; 0 if there is none."""
        values = zip(self.numbers, self.values(coordinates).tolist(), strict=True)
        bounded = [value / each.base - 1 for each, value in values if each.unit == "N" and each.base > 0]
        return max(bounded, default=0.0)

    def _bounded(self, number: LawNumber) -> LawNumber:
        """Return a number with the first force as its bound, if the law allows no less."""
        if self._force is None or number.unit != "N" or number is self._force or number.place is not None:
            return number
        try:
            type(self.start)(**self._fields({number.name: 0.5 * self._force.value}))
        except ParameterError:
            return number._replace(base=self._force.value)
        return number

    @property
    def coordinates(self) -> NDArray[np.float64]:
        """Coordinates of the start, shape (q,)."""
        return np.array([self.numbers[place].coordinate() for place in self._free])

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
            values = self.values(coordinates, force_scale)
        if not np.isfinite(values).all():  # a search follows a number that nothing determines to any size
            raise ParameterError(f"{type(self.start).name}: a number is too large")
        named = {each.name: float(value) for each, value in zip(self.numbers, values, strict=True)}
        return type(self.start)(**{**self._fields(named), **({VISCOUS: viscous} if self.has_viscous else {})})

    @property
    def has_viscous(self) -> bool:
        """Whether the model has a viscous coefficient."""
        return VISCOUS in type(self.start).model_fields

    def _fields(self, named: Mapping[str, float]) -> dict[str, Any]:
        """Return what the start states, with other numbers."""
        fields: dict[str, Any] = {}
        for name in self.start.model_fields_set - {VISCOUS}:
            value = getattr(self.start, name)
            if isinstance(value, tuple):
                value = tuple(named.get(f"{name}.{place}", each) for place, each in enumerate(value))
            fields[name] = named.get(name, value)
        return fields


def estimated_numbers(model: FrictionModel) -> list[LawNumber]:
    """Return the numbers that a model states and that are estimated."""
    return [each for name in type(model).model_fields for each in _numbers_of(model, name)]


def lists_by_unit(model: FrictionModel) -> dict[str, str]:
    """Return the names of the lists of numbers of elements that a model states, by their unit."""
    names = [name for name in type(model).model_fields if name in model.model_fields_set]
    lists = [name for name in names if isinstance(getattr(model, name), tuple)]
    return {unit_of_field(type(model).model_fields[name]): name for name in lists}


def _numbers_of(model: FrictionModel, name: str) -> list[LawNumber]:
    """Return the numbers of a field that are estimated."""
    info, value = type(model).model_fields[name], getattr(model, name)
    unit = unit_of_field(info)
    if name not in model.model_fields_set or name == VISCOUS or not (unit in EXPONENTS or unit == "1"):
        return []
    if isinstance(value, tuple):
        return [LawNumber(name, place, unit, float(each), np.inf, 0.0) for place, each in enumerate(value) if each]
    low, high = _bounds(info)
    number = LawNumber(name, None, unit, value, np.inf if high is None else high, low or 0.0)
    return [number] if isinstance(value, float) and value else []


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
            fields[name] = START_RATIO
        elif info.is_required() and (stated := _stated_value(law, name)) is not None:
            fields[name] = stated
    return law.parse(fields, law.name)


def _stated_value(law: type[FrictionModel], name: str) -> Any:
    """Return what a law states of a number: a preset, or the middle of its bounds; None if there is neither."""
    low, high = _bounds(law.model_fields[name])
    preset = next((values[name] for values in law.presets.values() if name in values), None)
    return (low + high) / 2 if preset is None and low is not None and high is not None else preset
