"""Friction that depends on where a contact is on its stroke: preload, ripple and cogging, around any friction model.

A law knows increments of the displacement alone. What depends on the position is a property of the contact: it scales
the force of the law, and adds a force that is a function of the position.
"""

import itertools
import math
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Component, FrictionModel, Motion
from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError

if TYPE_CHECKING:  # numba: imported only when a law is run
    from fraexp.kernels.law_arguments import LawArgument

POSITION_DEPENDENCE = "position_dependence"
"""Parameter by which any friction model becomes one that depends on the position."""
PROBE_STEPS, PROBE_STEP_M, PROBE_STEP_S = 200, 1e-5, 1e-3
"""A slide along which the greatest force of a law is looked for that states no bound."""


class Ripple(Parameters):
    """A relative variation of the friction force, a sin(2π x/p + φ), over the contact's coordinate x."""

    period: float = param("m", "period p over the coordinate, such as the lead of a screw", above=0)
    amplitude: float = param("1", "relative amplitude a", at_least=0, below=1)
    phase: float = param("rad", "phase φ", 0.0)


class Cogging(Parameters):
    """A force against the displacement, A sin(2π x/p + φ), over the contact's coordinate x."""

    period: float = param("m", "period p over the coordinate, such as the pitch of the magnets", above=0)
    amplitude: float = param("N", "amplitude A", at_least=0)
    phase: float = param("rad", "phase φ", 0.0)


class PositionDependence(Parameters):
    """How friction depends on the coordinate x of its contact: ratio(x) f + Σ A sin(2π x/p + φ).

    f is the force of the model. The ratio is that of the table, linear between its positions and constant beyond, times
    1 + Σ a sin(2π x/p + φ). Cogging gives back the work that it takes. Viscous friction is the same everywhere.
    """

    start: float = param("m", "coordinate of the contact where its displacement is 0", 0.0)
    positions: tuple[float, ...] = param("m", "coordinates of the table, ascending, such as those of a preload", ())
    force_ratios: tuple[float, ...] = param("1", "friction force at these over that of the model", ())
    ripples: tuple[Ripple, ...] = param("", "periodic variations of the friction force", ())
    cogging: tuple[Cogging, ...] = param("", "periodic forces that depend on the position alone", ())

    def model_post_init(self, context: object) -> None:
        """Check that the table is one, and that friction does not vanish anywhere."""
        given, ratios = self.positions, self.force_ratios
        if len(given) != len(ratios) or len(given) == 1:
            found = f"{len(given)} positions and {len(ratios)} force_ratios"
            raise ParameterError(f"{POSITION_DEPENDENCE} has {found}; expected two or more, and as many of each")
        if any(above <= below for below, above in itertools.pairwise(given)):
            raise ParameterError(f"{POSITION_DEPENDENCE}.positions are {list(given)}; expected ascending ones")
        if min(ratios, default=1.0) <= 0:
            raise ParameterError(f"{POSITION_DEPENDENCE}.force_ratios contain {min(ratios):g}; expected all above 0")
        if self._ripple >= 1:
            found = f"the amplitudes of {POSITION_DEPENDENCE}.ripples add up to {self._ripple:g}"
            raise ParameterError(f"{found}; expected less than 1: friction would drive the motion")

    @property
    def _ripple(self) -> float:
        """Sum of the ripples' amplitudes."""
        return sum(ripple.amplitude for ripple in self.ripples)

    @property
    def has_ratio(self) -> bool:
        """Whether the law's force is scaled at all."""
        return bool(self.positions or self.ripples)

    @property
    def max_ratio(self) -> float:
        """Maximum of the ratio, or somewhat more."""
        return max(self.force_ratios, default=1.0) * (1 + self._ripple)

    @property
    def max_ratio_slope(self) -> float:
        """Maximum slope of the ratio [1/m], or somewhat more."""
        table = float(np.abs(self._slopes).max(initial=0.0)) * (1 + self._ripple)
        steepest = sum(2 * np.pi * ripple.amplitude / ripple.period for ripple in self.ripples)
        return table + max(self.force_ratios, default=1.0) * steepest

    @property
    def max_cogging(self) -> float:
        """Maximum of the cogging force [N], or somewhat more."""
        return sum(each.amplitude for each in self.cogging)

    @property
    def max_cogging_slope(self) -> float:
        """Maximum slope of the cogging force [N/m], or somewhat more."""
        return sum(2 * np.pi * each.amplitude / each.period for each in self.cogging)

    @property
    def _slopes(self) -> NDArray[np.float64]:
        """Slope of the table between its positions [1/m]."""
        return np.diff(self.force_ratios) / np.diff(self.positions)

    def law_arguments(self) -> "tuple[LawArgument, ...]":
        """Return what the positioned law takes before the arguments of the law itself."""
        table = (np.array(self.positions[:-1]), np.diff(self.positions), self._slopes)
        first = float(self.force_ratios[0]) if self.force_ratios else 1.0
        return float(self.start), first, *table, *_waves(self.ripples), *_waves(self.cogging)

    def force(self, displacement: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the force at a contact [N] from displacement [m] and the law's force [N], each of shape (n,)."""
        x = self.start + displacement
        ratio = np.interp(x, self.positions, self.force_ratios) if self.positions else np.ones(x.size)
        return np.asarray(ratio * (1 + _sum_of_waves(x, self.ripples)) * force + _sum_of_waves(x, self.cogging))


def _waves(waves: Sequence[Ripple | Cogging]) -> tuple[NDArray[np.float64], ...]:
    """Return the wave numbers [rad/m], amplitudes and phases [rad], each of shape (waves,)."""
    rows = [(2 * np.pi / wave.period, wave.amplitude, wave.phase) for wave in waves]
    return tuple(np.array(rows).reshape(-1, 3).T.copy())


def _sum_of_waves(x: NDArray[np.float64], waves: Sequence[Ripple | Cogging]) -> NDArray[np.float64]:
    found = np.zeros(x.size)
    for wave in waves:
        found += wave.amplitude * np.sin(2 * np.pi * x / wave.period + wave.phase)
    return found


class PositionDependentFriction(FrictionModel):
    """A friction model whose force depends on the position of its contact as well.

    It is the class of the model, with `position_dependence` as one more parameter; see `positioned_class`. One more
    state in front of those of the law holds the displacement since rest.
    """

    position_dependence: PositionDependence = param("", "how friction depends on the position of the contact")

    @property
    def everywhere_alike(self) -> FrictionModel:
        """The model without the position's influence."""
        plain_class = cast(type[FrictionModel], type(self).__bases__[-1])
        return plain_class(**{name: getattr(self, name) for name in plain_class.model_fields})

    @property
    def state_size(self) -> int:
        """Size of the law's state, and the displacement [m]."""
        return self.everywhere_alike.state_size + 1

    @property
    def has_unique_periodic_force(self) -> bool:
        """Whether that is so for the law: a constant that it leaves open is one no more where the force is scaled."""
        return self.everywhere_alike.has_unique_periodic_force and not self.position_dependence.has_ratio

    @property
    def force_bound(self) -> float | None:
        """Maximum magnitude of friction and cogging [N]; None if that of the law is unknown."""
        bound, dependence = self.everywhere_alike.force_bound, self.position_dependence
        return None if bound is None else bound * dependence.max_ratio + dependence.max_cogging

    @property
    def max_stiffness(self) -> float:
        """Maximum slope of force over displacement [N/m], in either direction, at any position."""
        return self._stiffness_anywhere(self.everywhere_alike.max_stiffness)

    def stiffness_in_step(self, time_step: float) -> float:
        """Return the slope of force over displacement [N/m] at rest where it is greatest, rates included."""
        return self._stiffness_anywhere(self.everywhere_alike.stiffness_in_step(time_step))

    def _stiffness_anywhere(self, stiffness: float) -> float:
        dependence = self.position_dependence
        varying = dependence.max_ratio_slope * self._greatest_force() if dependence.has_ratio else 0.0
        return stiffness * dependence.max_ratio + varying + dependence.max_cogging_slope

    def _greatest_force(self) -> float:
        """Return the bound of the law's force [N], or the greatest one along a slide if it states none."""
        model = self.everywhere_alike
        if model.force_bound is not None:
            return model.force_bound
        z, greatest, arguments = np.zeros(model.state_size), 0.0, model.law_arguments()
        for _ in range(PROBE_STEPS):
            z_next = np.zeros(model.state_size)
            greatest = max(greatest, abs(model.law(z, PROBE_STEP_M, PROBE_STEP_S, z_next, *arguments)))
            z = z_next
        return greatest

    @property
    def law(self) -> Callable[..., float]:
        """The law of the model at a position that is one more state."""
        return _positioned_law(self.everywhere_alike.law)

    @property
    def velocity_law(self) -> None:
        """None: what is set-valued at rest is a stop here."""
        return None

    def law_arguments(self) -> "tuple[LawArgument, ...]":
        """Return what describes the dependence on the position, and the arguments of the model's law."""
        return self.position_dependence.law_arguments(), self.everywhere_alike.law_arguments()

    def forces(self, motions: Sequence[Motion]) -> list[NDArray[np.float64]]:
        """Return the force [N] along each of several motions, whose displacement counts from `start`."""
        forces = self.everywhere_alike.forces(motions)
        displacements = (motion.displacement for motion in motions)
        return [self.position_dependence.force(*pair) for pair in zip(displacements, forces, strict=True)]


def positioned_class(cls: type[Component], given: Mapping[str, Any]) -> type[Component]:
    """Return the class of a component with such parameters: of friction with `position_dependence`, one that has it."""
    is_positioned = POSITION_DEPENDENCE in given and issubclass(cls, FrictionModel)
    return _positioned(cls) if is_positioned and POSITION_DEPENDENCE not in cls.model_fields else cls


@cache
def _positioned(cls: type[FrictionModel]) -> type[FrictionModel]:
    bases = (PositionDependentFriction, cls)
    options = {"name": cls.name, "version": cls.version}
    return types.new_class(f"Positioned{cls.__name__}", bases, options, lambda body: body.update(__module__=__name__))


@cache
def _positioned_law(law: Callable[..., float]) -> Callable[..., float]:
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        dependence: tuple[Any, ...],
        arguments: tuple[object, ...],
    ) -> float:
        start, first, positions, widths, slopes, ripples, ratios, shifts, waves, amplitudes, phases = dependence
        z_next[0] = z[0] + dy
        x = start + z_next[0]
        table = first
        for k in range(positions.size):
            table += slopes[k] * min(max(x - positions[k], 0.0), widths[k])
        ratio = 1.0
        for k in range(ripples.size):
            ratio += ratios[k] * math.sin(ripples[k] * x + shifts[k])
        cogging = 0.0
        for k in range(waves.size):
            cogging += amplitudes[k] * math.sin(waves[k] * x + phases[k])
        return table * ratio * law(z[1:], dy, dt, z_next[1:], *arguments) + cogging

    return advance
