"""The forces of any friction law along measured motions: linear in the sizes of some columns, beside a shape.

A law is what the registry has: forces come from its compiled `advance`, and the role of a number follows from its unit.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import DIFFERENCE, NORMAL_QUANTILE, ROUNDING, Curve, FrictionModel, Motion
from fraexp_plugins.estimators._shared.standstill import SLOW_STEP_S
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._law_numbers import (
    EXPONENTS,
    VISCOUS,
    LawNumbers,
    Number,
    estimated_numbers,
    lists_by_unit,
    rough_model,
    unit_of_field,
    with_numbers,
)

RELAXATIONS = (0.0, 0.6, 1.7)
"""Dampers of an element over the relaxation time."""
REFINEMENT = 4
"""Parts of the gaps between an element's threshold and its neighbours."""
LEAST_FORCE = float(np.finfo(float).tiny)
"""Least force of a model [N]: that of records without friction is 0."""

Law = FrictionModel | type[FrictionModel]
"""A law with numbers from which a search may begin, or without."""
NONE = np.empty(0)


@dataclass(frozen=True)
class LawForces(ABC):
    """The forces of a law, in columns that are linear in their sizes [N]; its other numbers are the shape."""

    unit: FrictionModel
    """A model of the law that states the numbers that are estimated."""
    shape: NDArray[np.float64] = field(default_factory=lambda: NONE)
    """Coordinates of the shape, shape (S,); see `LawNumbers`."""
    thresholds: NDArray[np.float64] = field(default_factory=lambda: NONE)
    """Thresholds [m] of elements on a grid, ascending, shape (E,)."""
    sized: tuple[str, ...] = ()
    """Names of the numbers that follow from sizes of columns, and are no part of the shape."""
    lowest_rate: float = 0.0
    """Lowest rate of attraction over the Coulomb force [1/s]: what is far slower than a record never weakens there."""

    @property
    def name(self) -> str:
        """Name of the friction law."""
        return self.unit.name

    @property
    def key(self) -> tuple[object, ...]:
        """What the forces along a motion depend on."""
        return type(self), repr(self.unit), self.shape.tobytes(), self.thresholds.tobytes(), self.lowest_rate

    @property
    @abstractmethod
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""

    @abstractmethod
    def model(self, sizes: NDArray[np.float64], viscous: float = 0.0) -> FrictionModel:
        """Return the friction model for columns of these sizes, shape (N,), and a viscous coefficient [N s/m]."""

    @abstractmethod
    def _columns(self) -> Iterator[tuple[FrictionModel, FrictionModel | None]]:
        """Yield for each column the model whose force it is, and the one whose force is subtracted, if any."""

    @cached_property
    def law_numbers(self) -> LawNumbers:
        """The numbers that are the shape."""
        found = LawNumbers(self.unit, self.sized)
        return found.above({"N/s": self.lowest_rate}) if self.lowest_rate else found

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers of the shape."""
        return self.law_numbers.units

    @property
    def static_excess(self) -> float:
        """Static over Coulomb force, less 1; 0 for a law without a Stribeck effect."""
        return self.law_numbers.force_excess(self.shape)

    @property
    def is_linear(self) -> bool:
        """Whether the shape is nothing but elements' dampers, which several columns stand for."""
        return False

    @property
    def independent(self) -> Sequence[tuple["LawForces", slice]]:
        """Laws whose forces add up, each with the places of its columns."""
        return [(self, slice(None))]

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

    def slopes(
        self, driven: Callable[["LawForces"], NDArray[Any]], sizes: NDArray[np.float64], step: float
    ) -> list[NDArray[Any]]:
        """Return the derivatives of the force of these sizes by each coordinate, from differences of this `step`.

        `driven` returns the columns of a law, shape (..., N). A linear law needs none.
        """
        found = []
        for part, columns in () if self.is_linear else self.independent:
            moved = [replace(part, shape=part.shape + step * row) for row in np.eye(part.shape.size)]
            here = driven(part) if moved else NONE
            found += [(driven(each) - here) @ sizes[columns] / step for each in moved]
        return found

    def bounds(self, thresholds: tuple[float, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bounds of the coordinates, shape (S,) each, for thresholds of free elements in a range [m]."""
        return np.full(self.shape.size, -np.inf), np.full(self.shape.size, np.inf)

    def numbers(self, sizes: NDArray[np.float64]) -> list[Number]:
        """Return the law's numbers for columns of these sizes."""
        return estimated_numbers(self.model(sizes))

    def refine(self, sizes: NDArray[np.float64]) -> "LawForces":
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        return self

    def starting_at(self, sizes: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the shape whose numbers have sizes given by their units, and forces an excess; others stay."""
        return self.law_numbers.coordinates_at(sizes)

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of each column's force after a first slow displacement x [m], ascending, shape (n, N)."""
        return self.columns(Motion(np.concatenate([[0.0], x]), SLOW_STEP_S))[1:]

    def virgin_band(
        self, x: NDArray[np.float64], sizes: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the force [N] after a first slow displacement x [m], ascending, and its standard deviation, (n,) each.

        `covariance` is that of shape and then sizes, shape (S + N, S + N).
        """
        columns = self.virgin_columns(x)
        slopes = np.column_stack([*self.slopes(lambda law: law.virgin_columns(x), sizes, DIFFERENCE), columns])
        own = covariance[-slopes.shape[1] :, -slopes.shape[1] :]
        return columns @ sizes, np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, own, slopes), 0.0))


@dataclass(frozen=True)
class WholeLaw(LawForces):
    """A law as a whole: a column for its force, and one for each of some damping coefficients.

    The size of the first is a factor on the force of the unit; a law's force is linear in its damping coefficients.
    """

    @classmethod
    def of(cls, model: FrictionModel) -> "WholeLaw":
        """Return the forces of a law in one column, with the model's numbers as the start."""
        return cls(model, LawNumbers(model).coordinates)

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""
        return np.arange(1 + len(self.sized)) == 0

    def _columns(self) -> Iterator[tuple[FrictionModel, FrictionModel | None]]:
        bare = {name: ROUNDING * getattr(self.unit, name) for name in self.sized}
        base = with_numbers(self.law_numbers.model(self.shape), bare)
        yield base, None
        yield from ((with_numbers(base, {name: getattr(self.unit, name)}), base) for name in self.sized)

    def model(self, sizes: NDArray[np.float64], viscous: float = 0.0) -> FrictionModel:
        """Return the friction model for columns of these sizes, shape (N,), and a viscous coefficient [N s/m]."""
        force = max(float(sizes[0]), LEAST_FORCE)
        changes: dict[str, Any] = {VISCOUS: max(viscous, 0.0)}
        for name, size in zip(self.sized, sizes[1:].tolist(), strict=True):
            changes[name] = (size + ROUNDING * force) * getattr(self.unit, name)
        return with_numbers(self.law_numbers.model(self.shape, force), changes)


@dataclass(frozen=True)
class GridElements(LawForces):
    """Elements with thresholds on a grid: each is a column, and each of several dampers, if it has any."""

    owner: NDArray[np.int64] | None = None
    """Place of the element as which a threshold counts, shape (E,); each by itself if it is not given."""

    @property
    def _dampers(self) -> str:
        """Name of the list of the elements' dampers, which are numbers of the shape; empty if there is none."""
        return lists_by_unit(self.unit).get("N s/m", "")

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
        """Which columns keep their force in gross sliding, shape (N,): all."""
        return np.ones(self.thresholds.size * len(self.ratios), dtype=bool)

    def _columns(self) -> Iterator[tuple[FrictionModel, FrictionModel | None]]:
        model = self.law_numbers.model(self.shape)
        for ratio, threshold in product(self.ratios, self.thresholds.tolist()):
            values = {"N/m": 1 / threshold, "N": 1.0, "1": 1.0}
            if self._dampers:
                values["N s/m"] = ratio * getattr(model, self._dampers)[0] / threshold
            yield with_numbers(model, {name: (values[unit],) for unit, name in lists_by_unit(model).items()}), None

    def element_forces(self, sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force of each threshold [N], whatever its damper, shape (E,)."""
        return sizes.reshape(len(self.ratios), -1).sum(axis=0)

    def model(self, sizes: NDArray[np.float64], viscous: float = 0.0) -> FrictionModel:
        """Return the friction model for columns of these sizes, shape (N,), and a viscous coefficient [N s/m]."""
        if not sizes.any():
            return Frictionless(viscous_coefficient=max(viscous, 0.0))
        total, width = max(float(sizes.sum()), LEAST_FORCE), self.thresholds
        owner = np.arange(width.size) if self.owner is None else self.owner
        forces = self.element_forces(sizes)
        relaxation = self.law_numbers.model(self.shape, total)
        table = {"N/m": forces / width, "N": forces, "1": forces / total}
        if self._dampers:
            time = getattr(self.law_numbers.model(self.shape), self._dampers)[0]
            table["N s/m"] = time * np.array(self.ratios) @ sizes.reshape(len(self.ratios), -1) / width
        acts = np.bincount(owner, forces) > 0
        changes: dict[str, Any] = {VISCOUS: max(viscous, 0.0)}
        for unit, name in lists_by_unit(self.unit).items():
            changes[name] = tuple(np.bincount(owner, table[unit])[acts].tolist())
        return with_numbers(relaxation, changes)

    def beside_spring(
        self, sizes: NDArray[np.float64], stiffness: float, swing: float
    ) -> tuple["GridElements", NDArray[np.float64]]:
        """Return the elements with a spring [N/m], as one that slips beyond a motion [m], and sizes with its force."""
        rows = sizes.reshape(len(self.ratios), -1)
        force = np.where(np.arange(len(rows)) == 0, stiffness * swing, 0.0)
        return replace(self, thresholds=np.append(self.thresholds, swing)), np.column_stack([rows, force]).ravel()

    def refine(self, sizes: NDArray[np.float64]) -> "GridElements":
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        forces = self.element_forces(sizes)
        places = np.flatnonzero(forces > ROUNDING * forces.sum())
        if not places.size:
            return self
        # each of many elements is small, and the grid fine enough
        parts = REFINEMENT if places.size * 2 * REFINEMENT <= self.thresholds.size else 2
        known = np.log(self.thresholds)
        gaps = np.unique(np.concatenate([places - 1, places]))
        gaps = gaps[(gaps >= 0) & (gaps < known.size - 1)]
        between = known[gaps, None] + (known[gaps + 1] - known[gaps])[:, None] * np.arange(1, parts) / parts
        return replace(self, thresholds=np.exp(np.sort(np.append(between, known))))


@dataclass(frozen=True)
class FreeElements(LawForces):
    """Rolling elements with thresholds, and dampers if they have any, of their own: a column each.

    The sensitivities go through the whole record, forward in time, which is exact and equal to back-propagation
    (R. J. Williams and D. Zipser, Neural Computation 1(2), 1989, doi:10.1162/neco.1989.1.2.270).
    """

    @classmethod
    def of(cls, model: ElementModel) -> "FreeElements":
        """Return the elements of a model, with its numbers as the start."""
        stiffness, force = (np.array(each) for each in model.elements)
        damping = np.array(model.damping or np.empty((force.size, 0))).reshape(force.size, -1)
        rows = np.log(np.column_stack([stiffness, damping]) / force[:, None])
        unit = Rolling(stiffness=(1.0,), limit_force=(1.0,), damping=(1.0,) * damping.shape[1])
        return cls(unit, rows.ravel(), sized=("limit_force",))

    @property
    def _rows(self) -> NDArray[np.float64]:
        """Coordinates of each element, shape (N, q): logarithms of stiffness, and of damping, over the force."""
        return self.shape.reshape(-1, len(self.units))

    @property
    def independent(self) -> Sequence[tuple[LawForces, slice]]:
        """The elements one by one, each with the place of its column."""
        return [(replace(self, shape=row), slice(k, k + 1)) for k, row in enumerate(self._rows)]

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,): all."""
        return np.ones(len(self._rows), dtype=bool)

    def _columns(self) -> Iterator[tuple[FrictionModel, FrictionModel | None]]:
        yield from ((self.law_numbers.model(row), None) for row in self._rows)

    def model(self, sizes: NDArray[np.float64], viscous: float = 0.0) -> FrictionModel:
        """Return the friction model for columns of these sizes, shape (N,), and a viscous coefficient [N s/m]."""
        forces = np.maximum(sizes, LEAST_FORCE)
        columns = (forces[:, None] * np.exp(self._rows)).T.tolist()
        lists = zip(("stiffness", "damping"), map(tuple, columns), strict=False)
        return Rolling(limit_force=tuple(forces.tolist()), viscous_coefficient=max(viscous, 0.0), **dict(lists))

    def bounds(self, thresholds: tuple[float, float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bounds of the coordinates for thresholds in a range [m]: what never slips is a spring."""
        lower, upper = (each.reshape(self._rows.shape) for each in super().bounds(thresholds))
        lower[:, 0] = np.minimum(-np.log(thresholds[1]), self._rows[:, 0]) - 1e-9
        upper[:, 0] = np.maximum(-np.log(max(thresholds[0], 1e-300)), self._rows[:, 0]) + 1e-9
        return lower.ravel(), upper.ravel()

    def order(self, sizes: NDArray[np.float64], least: float) -> "FreeElements":
        """Return the elements of more than the `least` part of the force, by ascending threshold."""
        kept = [place for place in np.argsort(-self._rows[:, 0]) if sizes[place] > least * sizes.sum()]
        return replace(self, shape=self._rows[kept].ravel())


def rolling_elements(
    thresholds: NDArray[np.float64], relaxation: float | None = None, owner: NDArray[np.int64] | None = None
) -> GridElements:
    """Return rolling elements with thresholds [m]; with dampers if a relaxation time [s] is given."""
    damping = {} if relaxation is None else {"damping": (1.0,)}
    unit, sized = Rolling(stiffness=(1.0,), limit_force=(1.0,), **damping), ("stiffness", "limit_force")
    shape = NONE if relaxation is None else np.log([relaxation])
    return GridElements(unit, shape, thresholds, sized, owner=owner)


def unit_law(law: Law, width: float, velocity: float) -> FrictionModel:
    """Return a law with a first force of 1 N and one element if it has any.

    Of a law without numbers those that a presliding width [m] and a velocity [m/s] imply; ParameterError for one that
    needs a number of which nothing is known.
    """
    elements = np.array([1 / width]), np.ones(1)
    model = rough_model(law, elements, velocity, with_damping=True) if isinstance(law, type) else law
    numbers = LawNumbers(model)
    scaled = numbers.model(numbers.coordinates, 1 / numbers.force(1.0)) if numbers.force(1.0) else model
    return with_numbers(
        scaled, {name: (1.0,) for unit, name in lists_by_unit(scaled).items() if unit in (*EXPONENTS, "1")}
    )


def columns_of(unit: FrictionModel, thresholds: NDArray[np.float64], lowest_rate: float = 0.0) -> LawForces:
    """Return the columns of a law: of elements on the grid if it has any, else of its force and each damping."""
    lists = tuple(name for each, name in lists_by_unit(unit).items() if each != "N s/m")
    if lists:
        return GridElements(unit, thresholds=thresholds, sized=lists, lowest_rate=lowest_rate)
    units = {name: unit_of_field(type(unit).model_fields[name]) for name in unit.model_fields_set if name != VISCOUS}
    return WholeLaw(unit, sized=tuple(n for n, each in units.items() if each == "N s/m"), lowest_rate=lowest_rate)


def virgin_curve(x: NDArray[np.float64], force: NDArray[np.float64], std: NDArray[np.float64]) -> Curve:
    """Return the virgin curve with its 95 % limits, from ascending displacement [m], force and its std [N].

    The curve begins at 0 and never falls. Nor do its limits: they leave out values that only a falling curve could
    reach from a place where it is better known.
    """
    lower, upper = force - NORMAL_QUANTILE * std, force + NORMAL_QUANTILE * std
    columns = {
        "displacement": x,
        "force": force,
        "lower 95 %": np.fmax.accumulate(np.maximum(lower, 0.0)),
        "upper 95 %": np.fmin.accumulate(upper[::-1])[::-1],
    }
    return Curve("virgin curve", columns, dict(zip(columns, ("m", "N", "N", "N"), strict=True)))


def force_over_velocity(velocity: NDArray[np.float64], force: NDArray[np.float64], model: NDArray[np.float64]) -> Curve:
    """Return force and model [N] over ascending velocity [m/s], with a gap between the two directions."""
    order = np.argsort(velocity, kind="stable")
    first_positive = int(np.sum(velocity < 0))
    columns = (
        np.insert(values[order], first_positive, gap)
        for values, gap in ((velocity, 0), (force, np.nan), (model, np.nan))
    )
    named = dict(zip(("velocity", "force", "model"), columns, strict=True))
    return Curve("force over velocity", named, {"velocity": "m/s", "force": "N", "model": "N"})
