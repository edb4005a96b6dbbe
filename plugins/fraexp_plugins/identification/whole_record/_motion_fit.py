"""Plant and friction along the measured motion: near the right ones in a second or two, without a replay.

The motion drives the friction model, and what G U - F - Y/P leaves is minimised at the excited lines and, of sines, at
their odd harmonics. That is no estimate to trust, as rounded positions drive friction. It tells laws apart at once, and
a fit to whole records begins next to where it ends: static force, damping and viscous coefficient included, which may
hide a mode of the plant.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, Motion, ParameterError, Plant, Segment, Signals, fourier_sums, phasors
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.friction.dahl import Dahl
from fraexp_plugins.friction.lugre import LuGre
from fraexp_plugins.friction.none import Frictionless
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.usable_records import FORCE_FLOOR, with_harmonics
from fraexp_plugins.identification.whole_record._free_parameters import (
    DEAD_TIME,
    SCALES,
    FreeParameters,
    Models,
    nonzero_numbers,
)
from fraexp_plugins.identification.whole_record._machine_problem import MachineProblem
from fraexp_plugins.identification.whole_record._observed_response import ObservedStart, ScaleSearch
from fraexp_plugins.plants.modal import Modal

FORCE_RATIO, FORCE_RANGE = 0.55, 5.5
"""Coulomb force over the largest control input that is tried first, and the largest factor on it."""
WIDTH_RATIOS = (1 / 3, 1 / 27, 1 / 243)
"""Presliding distances over the largest motion, each of which stands for those within a factor of three."""
ELEMENTS, MIN_KNOT_RATIO, MAX_KNOT_RATIO = 20, 0.01, 2.2
"""Elements of the curve, and its knots over the presliding distance."""
STATIC_RATIO, STRIBECK_RATIO, VISCOUS_RATIO = 1.2, 0.1, 0.05
"""Static over Coulomb force, Stribeck over largest velocity, and viscous over Coulomb force at that velocity."""
DAMPING_TIME_S = 5e-4
"""Bristle damping over stiffness [s]."""


ROUGH_LAWS = (Rolling.name, Dahl.name, LuGre.name)
"""Laws that are replayed in lanes, and begin with what an observer tells."""


class RoughFriction(NamedTuple):
    """What an observer tells of friction, whatever its law."""

    force: float
    """Coulomb force [N]."""
    width: float
    """Presliding distance [m]."""
    velocity: float
    """Largest velocity of the records [m/s]."""

    def rolling(self) -> FrictionModel:
        """Return elements along an exponential curve."""
        curve = {
            "shape": "exponential", "coulomb_force": self.force, "characteristic_displacement": self.width,
            "elements": ELEMENTS, "min_knot": MIN_KNOT_RATIO * self.width, "max_knot": MAX_KNOT_RATIO * self.width,
        }  # fmt: skip
        return Rolling.parse({"curve": curve, "viscous_coefficient": self.viscous}, "rolling")

    @property
    def viscous(self) -> float:
        """Viscous coefficient [N s/m] that is tried first."""
        return VISCOUS_RATIO * self.force / self.velocity

    def model(self, law: str) -> FrictionModel:
        """Return a model of one of `ROUGH_LAWS`."""
        stiffness = self.force / self.width
        common = {"coulomb_force": self.force, "viscous_coefficient": self.viscous}
        if law == Rolling.name:
            return self.rolling()
        if law == Dahl.name:
            return Dahl.parse({"stiffness": stiffness, **common}, law)
        stribeck = {"static_force": STATIC_RATIO * self.force, "stribeck_velocity": STRIBECK_RATIO * self.velocity}
        bristles = {"bristle_stiffness": stiffness, "bristle_damping": DAMPING_TIME_S * stiffness}
        return LuGre.parse({**bristles, **common, **stribeck}, law)


def rough_friction(signals: Signals, observer: EffectiveInput) -> RoughFriction:
    """Return what the response of an observer tells of friction: that with which it is most like a plant's."""
    thrust = max(float(np.abs(segment.channels[observer.input]).max()) for segment in signals.segments)
    motion = max(float(np.ptp(segment.channels[observer.output])) for segment in signals.segments) / 2
    velocity = _velocity(signals, observer)
    starts = [RoughFriction(FORCE_RATIO * thrust, ratio * motion, velocity) for ratio in WIDTH_RATIOS]
    found = [_plausible_friction(signals, observer, start) for start in starts]
    return min(found, key=lambda each: each[0])[1]


def _plausible_friction(
    signals: Signals, observer: EffectiveInput, start: RoughFriction
) -> tuple[float, RoughFriction]:
    """Return the cost of the most plausible friction around a start, and that friction."""
    changed = observer.model_copy(update={"friction": start.rolling()})
    segments = signals.segments
    search = ScaleSearch(segments, changed.resolve_oversampling(segments), SCALES, force_range=FORCE_RANGE)
    (best, *_) = search.starts()
    cost = float(search.costs(best[None, :])[0])
    force, width = np.exp(best)
    return cost, start._replace(force=start.force * float(force), width=start.width * float(width))


def _velocity(signals: Signals, observer: EffectiveInput) -> float:
    """Return the largest velocity that an excited line causes [m/s]."""
    speeds: Sequence[float] = [
        float((2 * np.pi * segment.frequency * np.abs(phasors(segment, observer.output)).max(axis=0)).max())
        for segment in signals.segments
    ]
    return max(speeds)


MIN_HARMONIC_SAMPLES = 10
"""Samples of a cycle of the highest harmonic."""
FRICTION_DIFFERENCE, PLANT_DIFFERENCE = 1e-3, 1e-5
"""Differences of the logarithms of friction's and the plant's parameters for derivatives."""
START_LOG_STD = 1.0
"""Standard deviation of the logarithms of friction's parameters around the start."""
MAX_ITERATIONS, MAX_STARTS, MAX_ROUNDS = 15, 2, 4
"""Maximum numbers of steps of a search, of starts, and of plants that are looked for from each."""
COST_TOLERANCE = 1e-7
"""Relative change of the cost at which a search ends."""
FRICTION_ERRORS = (0.01, 0.001)
"""By how much friction may be wrong where a plant is looked for: at a start, and after a search."""
SUFFICIENT_RATIO = 0.8
"""Cost over that of the best one before from which another plant is better."""
EXPLAINED = 1.0
"""Residual over what is allowed for up to which no other start is tried."""


@dataclass(frozen=True)
class MotionFit:
    """Plant and friction with which a law explains the measured motion best."""

    plant: Plant
    """Plant at the start."""
    shared: NDArray[np.float64]
    """Logarithms of the factors on friction's and the plant's numbers, shape (p,)."""
    residual: float
    """What is left over what is allowed for, shortened where it is much (soft L1), in the mean over all lines."""


class MotionRecords:
    """Records whose lines, with odd harmonics, show the force of friction beside the plant."""

    def __init__(self, segments: Sequence[Segment], observer: EffectiveInput) -> None:
        self._segments = [with_harmonics(segment, MIN_HARMONIC_SAMPLES) for segment in segments]
        bare = observer.model_copy(update={"friction": Frictionless(), "force_scale": 1.0, "displacement_scale": 1.0})
        self._motions = [bare.motion(segment) for segment in self._segments]
        self._omega = 2 * np.pi * np.concatenate([segment.frequency for segment in self._segments])
        self._thrust = np.concatenate([each.mean(axis=0) for each in bare.linear_phasors(self._segments)])
        self._output = np.concatenate([phasors(s, bare.output).mean(axis=0) for s in self._segments])
        self._factor = bare.force_factor(self._omega)
        self._periods = [len(segment.channels[bare.output]) for segment in self._segments]
        counts = [segment.lines.size for segment in self._segments]
        amplitudes = [np.sqrt(2 * np.mean(segment.channels[bare.input] ** 2)) for segment in self._segments]
        self._force_floor = FORCE_FLOOR * np.repeat(amplitudes, counts)
        spread = np.hypot(bare.noise, bare.resolution / np.sqrt(12))
        sizes = np.array([segment.channels[bare.output].size for segment in self._segments])
        self._output_error = np.repeat(spread * np.sqrt(2 / sizes), counts)

    @property
    def lines(self) -> int:
        """Number of all lines."""
        return self._omega.size

    def forces(self, models: Models) -> NDArray[np.complex128]:
        """Return G U - F [N] at all lines, shape (n,)."""
        friction = models.friction
        ((force_scale, displacement_scale),) = models.replay.scales.values()
        forces = friction.forces([_scaled_motion(motion, displacement_scale) for motion in self._motions])
        sums = [
            fourier_sums(force.reshape(periods, -1), segment.lines).mean(axis=0)
            for force, segment, periods in zip(forces, self._segments, self._periods, strict=True)
        ]
        viscous = 1j * self._omega * friction.viscous * self._output
        thrust = self._thrust * np.exp(-1j * self._omega * models.added_dead_time)
        return np.asarray(thrust - viscous - force_scale * self._factor * np.concatenate(sums))

    def residual(self, forces: NDArray[np.complex128], plant: Plant) -> NDArray[np.float64]:
        """Return what forces [N], less those that move a plant, leave over what is allowed for, shape (2 n,)."""
        inverse = 1 / plant.response(self._omega)
        left = (forces - self._output * inverse) / np.hypot(self._force_floor, np.abs(inverse) * self._output_error)
        size = np.abs(left)
        short = left * np.sqrt(2 / (1 + np.hypot(1, size)))
        return np.concatenate([short.real, short.imag])


def _scaled_motion(motion: Motion, scale: float) -> Motion:
    return motion._replace(displacement=motion.displacement / scale, lead_in=motion.lead_in / scale)


@dataclass(frozen=True)
class _Search:
    """The search for friction and plant from a start.

    What the motion does not tell stays there: elements share a force in ways that hardly differ.
    """

    records: MotionRecords
    free: FreeParameters
    models: Models
    """The machine whose numbers the parameters are factors on."""
    start: NDArray[np.float64]
    """Logarithms of friction's factors, shape (p,)."""

    def minimum(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters around these ones with the smallest residual."""
        from scipy.optimize import least_squares  # slow to import: only when something is estimated

        size = self.free.limit(np.full(logs.size, np.inf))
        found = least_squares(
            self._weighted, logs, jac=self._jacobian, bounds=(-size, size), x_scale="jac",
            max_nfev=MAX_ITERATIONS, ftol=COST_TOLERANCE,
        )  # fmt: skip
        return np.asarray(found.x)

    def residual(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the parameters leave of the records, shape (2 n,)."""
        models = self.free.applied_to(self.models, logs)
        return self.records.residual(self.records.forces(models), models.plant)

    def _weighted(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the same, then the distance from the start, shape (2 n + p,); infinite for what no model allows."""
        try:
            left = self.residual(logs)
        except ParameterError:
            left = np.full(2 * self.records.lines, np.inf)
        return np.concatenate([left, self._known @ (logs - np.pad(self.start, (0, logs.size - self.start.size)))])

    def _jacobian(self, logs: NDArray[np.float64]) -> NDArray[np.float64]:
        models = self.free.applied_to(self.models, logs)
        forces = self.records.forces(models)
        residual = self.records.residual(forces, models.plant)
        return np.concatenate([-self._gradient(logs, forces, residual), self._known])

    @property
    def _known(self) -> NDArray[np.float64]:
        """Rows that hold friction's parameters but the dead time, shape (p, p + plant)."""
        weights = [0.0 if name == DEAD_TIME else 1 / START_LOG_STD for name in self.free.friction]
        return np.pad(np.diag(weights), ((0, 0), (0, len(self.free.plant))))

    def _gradient(
        self, logs: NDArray[np.float64], forces: NDArray[np.complex128], residual: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the derivatives of what the model explains, shape (2 n, p + plant); the plant's need no forces."""
        columns = []
        for place in range(logs.size):
            is_friction = place < len(self.free.friction)
            difference = FRICTION_DIFFERENCE if is_friction else PLANT_DIFFERENCE
            try:
                models = self.free.applied_to(self.models, logs + difference * (np.arange(logs.size) == place))
            except ParameterError:
                columns.append(np.zeros(residual.size))
                continue
            changed = self.records.residual(self.records.forces(models) if is_friction else forces, models.plant)
            columns.append((residual - changed) / difference)
        return np.stack(columns, axis=1)


def fits_along_motion(problem: MachineProblem) -> list[MotionFit]:
    """Return plant and friction with which a law explains the measured motion, from the best starts, the best first."""
    observer = problem.observer_at(np.zeros(len(problem.free.names)))
    records = MotionRecords(problem.signals.segments, observer)
    found: list[MotionFit] = []
    for start in _starts(problem, observer)[:MAX_STARTS]:
        found.append(_fit_from(problem, records, start))
        if found[-1].residual < EXPLAINED:
            break
    return sorted(found, key=lambda each: each.residual)


def _starts(problem: MachineProblem, observer: EffectiveInput) -> list[NDArray[np.float64]]:
    """Return the logarithms of the free parameters at which a fit may begin, the most plausible first."""
    if not set(SCALES) & set(problem.free.friction):
        return [np.zeros(len(problem.free.names))]
    search = ScaleSearch(problem.signals.segments, observer, problem.free.friction)
    return [problem.free.from_scales(scales) for scales in search.starts()]


def _fit_from(problem: MachineProblem, records: MotionRecords, start: NDArray[np.float64]) -> MotionFit:
    """Return the best fit from a start of friction's parameters.

    A plant is looked for in the observer's response with the friction found before: it shows more and more modes.
    """
    best: MotionFit | None = None
    for _ in range(MAX_ROUNDS):
        logs = start if best is None else best.shared[: start.size]
        found = []
        for with_delay, plant in _plants(problem, logs, best):
            names = () if problem.nominal_plant is not None else nonzero_numbers(plant)
            models = problem.fit_around(plant).start
            search = _Search(records, FreeParameters(problem.free.friction, names), models, start)
            place = search.minimum(np.concatenate([with_delay, np.zeros(len(names))]))
            found.append(MotionFit(plant, place, float(np.mean(search.residual(place) ** 2))))
        better = min(found, key=lambda each: each.residual, default=best)
        if better is None or (best is not None and better.residual > SUFFICIENT_RATIO * best.residual):
            break
        best = better
    assert best is not None
    return best


def _plants(
    problem: MachineProblem, logs: NDArray[np.float64], best: MotionFit | None
) -> Iterator[tuple[NDArray[np.float64], Plant]]:
    """Yield friction's parameters, with the dead time if it is free, and plants in the observer's response.

    They have as many modes as it shows, and one more than before.
    """
    if problem.nominal_plant is not None:
        yield from [(logs, problem.nominal_plant)] if best is None else []
        return
    observer = problem.observer_at(logs)
    observed = ObservedStart.of(observer, problem.signals)
    before = len(best.plant.frequencies) if best is not None and isinstance(best.plant, Modal) else 0
    error = FRICTION_ERRORS[best is not None]
    known: list[Plant] = []
    for modes in (problem.modes,) if problem.modes is not None else (None, before + 1):
        plant, delay = observed.plant(problem.signals, observer, modes, error, DEAD_TIME in problem.free.friction)
        if plant not in known and len(plant.frequencies) >= before:
            known.append(plant)
            yield problem.free.with_dead_time(logs, delay, problem.sample_time), plant
