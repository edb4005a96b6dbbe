"""Forces of one friction law each, driven by the measured motion: sizes and a few shape parameters are unknown."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, Motion
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.stop_operator import stop_operators
from fraexp_plugins.identification.autonomous._shared.autonomous_lines import history

MIN_STATIC_EXCESS = 1e-3
"""Static over Coulomb force, less 1, below which there is no Stribeck effect."""
RELAXATIONS = (0.0, 0.6, 1.7)
"""Dampers of an element over the relaxation time."""
REFINEMENT, MIN_SHARE = 4, 1e-3
"""Thresholds on either side up to the neighbour, and least share of the force of an element around which they are."""
SLOW_STEP_S = 1e3
"""Time step of a slow displacement."""
NO_DAMPING = 1e-12
"""Bristle damping over stiffness [s] of a law whose damper is a column of its own."""


@dataclass(frozen=True)
class LawElements(ABC):
    """The forces of a law [N] per newton of their size: those that keep their force in gross sliding come first.

    `shape` has the logarithms of the law's shape parameters.
    """

    shape: NDArray[np.float64]
    """Logarithms of shape parameters, in the units m, m/s, 1/s and 1, shape (S,)."""

    name: ClassVar[str]
    """Name of the friction law."""

    @property
    @abstractmethod
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""

    @abstractmethod
    def forces(self, motions: Sequence[Motion]) -> Iterable[NDArray[np.float64]]:
        """Return each column along each periodic motion, each of shape (n, N)."""

    @abstractmethod
    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a first slow displacement x [m], shape (n, N)."""

    @abstractmethod
    def model(self, sizes: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the friction model for forces of these sizes [N], shape (N,), and a viscous coefficient [N s/m]."""

    def refine(self, sizes: NDArray[np.float64]) -> "LawElements":
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        return self

    def acting(self, sizes: NDArray[np.float64]) -> tuple["LawElements", NDArray[np.float64]]:
        """Return the elements that have a force, and the sizes of their columns: the same force in less time."""
        return self, sizes

    @property
    def widths(self) -> NDArray[np.float64]:
        """Factor that makes a coefficient of each column its force, shape (N,)."""
        return np.ones(self.is_coulomb.size)

    @property
    def static_excess(self) -> float:
        """Static over Coulomb force, less 1."""
        return 0.0

    def columns(self, motion: Motion) -> NDArray[np.float64]:
        """Return each column along a period of motion, shape (n, N)."""
        return next(iter(self.forces([motion])))


@dataclass(frozen=True)
class RollingElements(LawElements):
    """Elasto-slide elements of many thresholds, each with several dampers D_i, one of which is 0.

    Shape: relaxation time D/K [s], of which the dampers are multiples.
    """

    name: ClassVar[str] = "rolling"
    thresholds: NDArray[np.float64]
    """Thresholds [m], ascending, shape (E,)."""

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """All of them, shape (N,)."""
        return np.ones(self.thresholds.size * len(RELAXATIONS), dtype=bool)

    def forces(self, motions: Sequence[Motion]) -> Iterator[NDArray[np.float64]]:
        """Yield each column along each periodic motion, each of shape (n, N): all at once would fill the memory."""
        for motion in motions:
            y, size = history(motion), motion.displacement.size
            spring = stop_operators(y, self.thresholds)[-size:]  # the start has no effect then
            change = np.diff(y)
            velocity = (1.5 * change[-size:] - 0.5 * change[-size - 1 : -1]) / motion.time_step  # as the law takes it
            damper = np.exp(self.shape[0]) * velocity[:, None]
            parts = [np.clip(spring + ratio * damper, -self.thresholds, self.thresholds) for ratio in RELAXATIONS]
            yield np.concatenate([part / self.thresholds for part in parts], axis=1)

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a first slow displacement x [m], shape (n, N)."""
        return np.tile(np.minimum(x[:, None] / self.thresholds, 1.0), (1, len(RELAXATIONS)))

    def refine(self, sizes: NDArray[np.float64]) -> LawElements:
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        return replace(self, thresholds=_refined_grid(self.thresholds, sizes.reshape(len(RELAXATIONS), -1).sum(axis=0)))

    def acting(self, sizes: NDArray[np.float64]) -> tuple[LawElements, NDArray[np.float64]]:
        """Return the elements that have a force, and the sizes of their columns: the same force in less time."""
        parts = sizes.reshape(len(RELAXATIONS), -1)
        acts = parts.any(axis=0)
        return replace(self, thresholds=self.thresholds[acts]), parts[:, acts].ravel()

    def model(self, sizes: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the elements that have a force, with the mean of their dampers."""
        parts = sizes.reshape(len(RELAXATIONS), -1)
        force, places = parts.sum(axis=0), np.flatnonzero(parts.sum(axis=0) > 0)
        stiffness = (force / self.thresholds)[places]
        relaxation = np.exp(self.shape[0]) * np.array(RELAXATIONS) @ parts
        damping = (relaxation / self.thresholds)[places]
        return Rolling(
            stiffness=stiffness.tolist(),
            limit_force=force[places].tolist(),
            damping=damping.tolist(),
            viscous_coefficient=max(viscous, 0.0),
        )


@dataclass(frozen=True)
class WeakeningElements(LawElements):
    """Elements of many thresholds whose force follows one Stribeck curve with a lag: generalized Maxwell slip.

    Shape: static over Coulomb force less 1, Stribeck velocity [m/s], and rate of attraction over Coulomb force, less
    the lowest one [1/s].
    """

    name: ClassVar[str] = "gms"
    thresholds: NDArray[np.float64]
    """Thresholds in sliding [m], ascending, shape (E,)."""
    lowest_rate: float = 0.0
    """Lowest rate of attraction over Coulomb force [1/s]: what is far slower than a record never weakens there."""

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """Which columns keep their force in gross sliding, shape (N,)."""
        return np.ones(self.thresholds.size, dtype=bool)

    @property
    def static_excess(self) -> float:
        """Static over Coulomb force, less 1."""
        return float(np.exp(self.shape[0]))

    def _model(self, stiffness: Sequence[float], fractions: Sequence[float], force: float = 1.0) -> FrictionModel:
        excess, velocity, rate = np.exp(self.shape).tolist()
        return GeneralizedMaxwellSlip(
            stiffness=tuple(stiffness),
            force_fractions=tuple(fractions),
            coulomb_force=force,
            static_force=force * (1 + excess),
            stribeck_velocity=velocity,
            attraction_rate=force * (self.lowest_rate + rate),
        )

    def forces(self, motions: Sequence[Motion]) -> list[NDArray[np.float64]]:
        """Return each column along each periodic motion, each of shape (n, N)."""
        single = [self._model([1 / width], [1.0]).forces(motions) for width in self.thresholds.tolist()]
        return [np.stack(columns, axis=1) for columns in zip(*single, strict=True)]

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a first slow displacement x [m], shape (n, N)."""
        return np.minimum(x[:, None] / self.thresholds, 1 + self.static_excess)

    def refine(self, sizes: NDArray[np.float64]) -> LawElements:
        """Return elements with finer thresholds around those that have a force, of the same shape."""
        return replace(self, thresholds=_refined_grid(self.thresholds, sizes))

    def acting(self, sizes: NDArray[np.float64]) -> tuple[LawElements, NDArray[np.float64]]:
        """Return the elements that have a force, and the sizes of their columns: the same force in less time."""
        acts = sizes > 0
        return (replace(self, thresholds=self.thresholds[acts]), sizes[acts]) if acts.any() else (self, sizes)

    def model(self, sizes: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return the model of the elements that have a force."""
        places, total = np.flatnonzero(sizes > 0), float(sizes.sum())
        force = sizes[places]
        found = self._model((force / self.thresholds[places]).tolist(), (force / total).tolist(), total)
        return found.model_copy(update={"viscous_coefficient": max(viscous, 0.0)})


@dataclass(frozen=True)
class BristleElements(LawElements):
    """Bristles of one width with a Stribeck curve and a damper: LuGre, and Dahl where nothing weakens.

    Shape: width Fc/σ0 [m], static over Coulomb force less 1, and Stribeck velocity [m/s]; then, for elastoplastic
    bristles, the ratio of elastic limit z_ba to the rest of the width.
    """

    name: ClassVar[str] = "lugre"

    @property
    def is_coulomb(self) -> NDArray[np.bool_]:
        """The first column: the second one is the damper."""
        return np.array([True, False])

    @property
    def static_excess(self) -> float:
        """Static over Coulomb force, less 1."""
        return float(np.exp(self.shape[1]))

    def _parameters(self, force: float, damping: float) -> dict[str, float]:
        width, excess, velocity = np.exp(self.shape[:3]).tolist()
        return {
            "bristle_stiffness": force / width,
            "bristle_damping": damping,
            "coulomb_force": force,
            "static_force": force * (1 + excess),
            "stribeck_velocity": velocity,
        }

    def _model(self, force: float, damping: float) -> FrictionModel:
        return LuGre(**self._parameters(force, damping))

    def forces(self, motions: Sequence[Motion]) -> list[NDArray[np.float64]]:
        """Return each column along each periodic motion, each of shape (n, N)."""
        width = float(np.exp(self.shape[0]))
        found = []
        for force, motion in zip(self._model(1.0, NO_DAMPING / width).forces(motions), motions, strict=True):
            change = force - np.roll(force, 1)
            rate = (
                1.5 * change - 0.5 * np.roll(change, 1)
            ) / motion.time_step  # as the laws take it, at the step's end
            found.append(np.stack([force, 1e-3 * rate], axis=1))
        return found

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a first slow displacement x [m], shape (n, N)."""
        limit = 1 + self.static_excess
        bristle = -limit * np.expm1(-x / (limit * np.exp(self.shape[0])))
        return np.stack([bristle, np.zeros(x.size)], axis=1)

    def model(self, sizes: NDArray[np.float64], viscous: float) -> FrictionModel:
        """Return LuGre's model, or Dahl's if nothing weakens and there is no damper."""
        force, width = float(sizes[0]), float(np.exp(self.shape[0]))
        if self.static_excess < MIN_STATIC_EXCESS and sizes[1] == 0:
            return Dahl(stiffness=force / width, coulomb_force=force, viscous_coefficient=max(viscous, 0.0))
        found = self._model(force, max(1e-3 * float(sizes[1]), NO_DAMPING * force) / width)
        return found.model_copy(update={"viscous_coefficient": max(viscous, 0.0)})


@dataclass(frozen=True)
class DahlElements(BristleElements):
    """Bristles of one width without Stribeck effect, and a damper. Shape: width [m]."""

    name: ClassVar[str] = "dahl"

    @property
    def static_excess(self) -> float:
        """Nothing."""
        return 0.0

    def _parameters(self, force: float, damping: float) -> dict[str, float]:
        stiffness = force / float(np.exp(self.shape[0]))
        return {
            "bristle_stiffness": stiffness,
            "bristle_damping": damping,
            "coulomb_force": force,
            "static_force": force,
        }


@dataclass(frozen=True)
class ElastoplasticElements(BristleElements):
    """Bristles that are elastic up to z_ba."""

    name: ClassVar[str] = "elastoplastic"

    def _model(self, force: float, damping: float) -> FrictionModel:
        odds = float(np.exp(self.shape[3]))
        return Elastoplastic(**self._parameters(force, damping), elastic_limit_ratio=odds / (1 + odds))

    def virgin_columns(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how much of each column's force acts after a slow displacement x [m], ascending, shape (n, N)."""
        model = self._model(1.0, NO_DAMPING / float(np.exp(self.shape[0])))
        bristle = model.force(np.concatenate([[0.0], x]), SLOW_STEP_S)[1:]
        return np.stack([bristle, np.zeros(x.size)], axis=1)


def _refined_grid(thresholds: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return thresholds [m] between the neighbours of those that have a force, ascending; no more than before.

    They are the same if none has one.
    """
    places = np.flatnonzero(sizes > MIN_SHARE * sizes.sum())
    if not places.size:
        return thresholds
    steps = np.linspace(-1.0, 1.0, 2 * REFINEMENT + 1)
    if places.size * steps.size > thresholds.size:  # many elements: each is small, and the grid fine enough
        steps = np.array([-0.5, 0.0, 0.5])
    ratio = np.log(thresholds[1] / thresholds[0])
    found = np.log(thresholds[places])[:, None] + ratio * steps
    return np.asarray(np.exp(np.unique(np.round(found, 6))))
