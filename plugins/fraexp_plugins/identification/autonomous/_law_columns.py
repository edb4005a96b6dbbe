"""The forces of any friction law along measured motions, whose sizes and shape are unknown.

A law is what the registry has: forces come from its compiled `advance`, and the role of a number follows from its unit.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, FrictionModel, Motion
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.law_numbers import EXPONENTS, VISCOUS, LawNumbers, rough_model, unit_of_field

RELAXATIONS = (0.0, 0.6, 1.7)
"""Dampers of an element over the relaxation time."""
REFINEMENT, MIN_SHARE = 4, 1e-5
"""Parts of the gaps between an element's threshold and its neighbours, and least share of its force."""
SLOW_STEP_S = 1e3
"""Time step of a slow displacement."""
ELEMENT_RANGE = (1e-5, 0.9)
"""Range of thresholds over the largest motion, and that of a virgin curve."""
START_EXCESS, START_RATIO, START_WIDTH = 0.2, 0.6, 4e-3
"""Static over Coulomb force, less 1, elastic limit over the width, and width over the motion, of a law at its start."""


LawKey = tuple[str, bytes, bytes, float]
Law = FrictionModel | type[FrictionModel]
"""A law with numbers from which a search may begin, or without."""


@dataclass(frozen=True)
class LawColumns:
    """The columns of force of a law [N] per newton of their size: those that keep their force in sliding come first.

    A law with lists of numbers is one of elements: each threshold of a grid is a column, and each of several dampers,
    if its elements have dampers. Otherwise it is one column for the whole law with a first force of 1 N, and one for
    each damping coefficient, in which a law's force is linear. The other numbers are its shape.
    """

    unit: FrictionModel
    """The law with a force of 1 N, and one element if it is a law of elements."""
    shape: NDArray[np.float64]
    """Coordinates of the other numbers, shape (S,); see `LawNumbers`."""
    thresholds: NDArray[np.float64]
    """Thresholds [m] of a law of elements, ascending, shape (E,); empty for another law."""
    lowest_rate: float = 0.0
    """Lowest rate of attraction over the Coulomb force [1/s]: what is far slower than a record never weakens there."""

    @property
    def name(self) -> str:
        """Name of the friction law."""
        return self.unit.name

    @property
    def key(self) -> LawKey:
        """What the forces along a motion depend on."""
        return repr(self.unit), self.shape.tobytes(), self.thresholds.tobytes(), self.lowest_rate

    @cached_property
    def numbers(self) -> LawNumbers:
        """The numbers that are the law's shape."""
        sized = [*self._lists.values(), *self._dampings]
        found = LawNumbers(self.unit, tuple(sized))
        return found.above({"N/s": self.lowest_rate}) if self.lowest_rate else found

    @cached_property
    def _units(self) -> dict[str, str]:
        fields = type(self.unit).model_fields
        return {name: unit_of_field(fields[name]) for name in self.unit.model_fields_set if name != VISCOUS}

    @cached_property
    def _lists(self) -> dict[str, str]:
        """Lists of stiffnesses, forces and shares of elements, by their unit; dampers are numbers of the shape."""
        lists = {unit: name for name, unit in self._units.items() if isinstance(getattr(self.unit, name), tuple)}
        return {unit: name for unit, name in lists.items() if unit != "N s/m"}

    @cached_property
    def _dampers(self) -> str:
        """Name of the list of the elements' dampers; empty if there is none."""
        names = [n for n, unit in self._units.items() if unit == "N s/m" and isinstance(getattr(self.unit, n), tuple)]
        return names[0] if names else ""

    @cached_property
    def _dampings(self) -> list[str]:
        """Names of the damping coefficients that are columns."""
        return [n for n, unit in self._units.items() if unit == "N s/m" and isinstance(getattr(self.unit, n), float)]

    @property
    def has_elements(self) -> bool:
        """Whether it is a law of elements, which needs thresholds."""
        return bool(self._lists)

    @property
    def is_linear(self) -> bool:
        """Whether the shape is nothing but the elements' dampers, which several columns stand for."""
        return bool(self._dampers) and len(self.units) == 1

    @property
    def ratios(self) -> tuple[float, ...]:
        """Dampers of an element over the relaxation time: one of 0 if it has none."""
        return RELAXATIONS if self._dampers else (0.0,)

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""
        if self.thresholds.size:
            return np.ones(self.thresholds.size * len(self.ratios), dtype=bool)
        return np.arange(1 + len(self._dampings)) == 0

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers of the shape."""
        return self.numbers.units

    @property
    def static_excess(self) -> float:
        """Static over Coulomb force, less 1; 0 for a law without a Stribeck effect."""
        return self.numbers.force_excess(self.shape)

    def _columns(self) -> Iterator[tuple[FrictionModel, FrictionModel | None]]:
        """Yield for each column the model whose force it is, and the one whose force is subtracted, if any."""
        model = self.numbers.model(self.shape)
        if not self.thresholds.size:
            bare = {name: ROUNDING * getattr(self.unit, name) for name in self._dampings}
            base = _changed(model, bare)
            yield base, None
            yield from ((_changed(base, {name: getattr(self.unit, name)}), base) for name in self._dampings)
            return
        for ratio, threshold in product(self.ratios, self.thresholds.tolist()):
            yield _changed(model, self._element(model, threshold, ratio)), None

    def _element(self, model: FrictionModel, threshold: float, ratio: float) -> dict[str, Any]:
        values = {"N/m": 1 / threshold, "N": 1.0, "1": 1.0}
        element = {name: (values[unit],) for unit, name in self._lists.items()}
        if self._dampers:
            element[self._dampers] = (ratio * getattr(model, self._dampers)[0] / threshold,)
        return element

    def forces(self, motions: Sequence[Motion]) -> Iterator[list[NDArray[np.float64]]]:
        """Yield each column's force along each motion: all columns at once would fill the memory."""
        known: tuple[FrictionModel | None, list[NDArray[np.float64]]] = (None, [])
        for model, base in self._columns():
            found = model.forces(motions)
            if base is None:
                known = model, found
                yield found
            else:
                yield [force - other for force, other in zip(found, known[1], strict=True)]

    def columns(self, motion: Motion) -> NDArray[np.float64]:
        """Return each column along a motion, shape (n, N)."""
        return np.stack([force for (force,) in self.forces([motion])], axis=1)

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of each column's force after a first slow displacement x [m], ascending, shape (n, N)."""
        return self.columns(Motion(np.concatenate([[0.0], x]), SLOW_STEP_S))[1:]

    def model(self, sizes: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the friction model for forces of these sizes [N], shape (N,), and a viscous coefficient [N s/m]."""
        force = max(float(sizes[self.is_coulomb].sum()), np.finfo(float).tiny)
        model = self.numbers.model(self.shape, force)
        changes: dict[str, Any] = {VISCOUS: max(viscous, 0.0)}
        if not self.thresholds.size:
            for name, size in zip(self._dampings, sizes[1:].tolist(), strict=True):
                changes[name] = (size + ROUNDING * force) * getattr(self.unit, name)
            return _changed(model, changes)
        parts = sizes.reshape(len(self.ratios), -1)
        forces = parts.sum(axis=0)
        acts, width = forces > 0, self.thresholds
        lists = {"N/m": forces / width, "N": forces, "1": forces / force}
        changes |= {name: tuple(lists[unit][acts].tolist()) for unit, name in self._lists.items()}
        if self._dampers:
            relaxation = self.numbers.model(self.shape)
            damping = getattr(relaxation, self._dampers)[0] * np.array(self.ratios) @ parts / width
            changes[self._dampers] = tuple(damping[acts].tolist())
        return _changed(model, changes)

    def refine(self, sizes: NDArray[np.float64]) -> "LawColumns":
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        if not self.thresholds.size:
            return self
        forces = sizes.reshape(len(self.ratios), -1).sum(axis=0)
        places = np.flatnonzero(forces > MIN_SHARE * forces.sum())
        if not places.size:
            return self
        # each of many elements is small, and the grid fine enough
        parts = REFINEMENT if places.size * 2 * REFINEMENT <= self.thresholds.size else 2
        known = np.log(self.thresholds)
        gaps = np.unique(np.concatenate([places - 1, places]))
        gaps = gaps[(gaps >= 0) & (gaps < known.size - 1)]
        between = known[gaps, None] + (known[gaps + 1] - known[gaps])[:, None] * np.arange(1, parts) / parts
        return replace(self, thresholds=np.exp(np.sort(np.append(between, known))))

    def starting_at(self, sizes: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the shape whose numbers have sizes given by their units, and forces an excess; others stay."""
        return self.numbers.coordinates_at(sizes)


def _changed(model: FrictionModel, values: Mapping[str, Any]) -> FrictionModel:
    fields = {name: getattr(model, name) for name in model.model_fields_set}
    known = {name: value for name, value in values.items() if name in type(model).model_fields}
    return type(model)(**{**fields, **known})


def elements_law(has_dampers: bool) -> FrictionModel:
    """Return rolling friction of one element, with a force of 1 N."""
    damping = {"damping": (1.0,)} if has_dampers else {}
    return Rolling(stiffness=(1.0,), limit_force=(1.0,), **damping)


def laws_of_fraexp(velocity: float) -> tuple[FrictionModel, ...]:
    """Return the other laws that fraexp has, with a force of 1 N, the cheapest first; that of elements is the last.

    The damper of bristles makes a force of 1 N, too, where they bend at `velocity` [m/s].
    """
    stribeck = {"coulomb_force": 1.0, "static_force": 1 + START_EXCESS, "stribeck_velocity": velocity}
    bristles = {"bristle_stiffness": 1.0, "bristle_damping": 1 / velocity, **stribeck}
    return (
        Dahl(stiffness=1.0, coulomb_force=1.0),
        LuGre(**bristles),
        Elastoplastic(**bristles, elastic_limit_ratio=START_RATIO),
        GeneralizedMaxwellSlip(stiffness=(1.0,), force_fractions=(1.0,), attraction_rate=1.0, **stribeck),
    )


def named_law(law: type[FrictionModel], motion: float, velocity: float) -> FrictionModel:
    """Return a model of a law, of one element if it has any, for a largest motion [m] and velocity [m/s].

    ParameterError for a number of which nothing is known.
    """
    width = START_WIDTH * motion
    return rough_model(law, (np.array([1 / width]), np.ones(1)), velocity, with_damping=True)


def unit_law(model: FrictionModel) -> FrictionModel:
    """Return a law that a user states, with a first force of 1 N and one element."""
    numbers = LawNumbers(model)
    scaled = numbers.model(numbers.coordinates, 1 / numbers.force(1.0)) if numbers.force(1.0) else model
    lists = {name: value for name in scaled.model_fields_set if isinstance(value := getattr(scaled, name), tuple)}
    units = {name: unit_of_field(type(scaled).model_fields[name]) for name in lists}
    return _changed(scaled, {name: (1.0,) for name, unit in units.items() if unit in (*EXPONENTS, "1")})
