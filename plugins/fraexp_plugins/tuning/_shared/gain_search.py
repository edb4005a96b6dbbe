"""The search for the feedback that is stiffest among those that keep the margins."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Controller, Plant, StateSpace
from fraexp_plugins.controllers.notched_pid import NotchedPid
from fraexp_plugins.positioning._shared.design_model import DesignModel
from fraexp_plugins.tuning._shared.plant_band import PlantBand


@dataclass(frozen=True)
class Margins:
    """Margins that are guaranteed."""

    modulus: float
    """Smallest distance of the loop's response from -1, 1/max|S|."""
    gain: float
    """Factor up to which the gain may rise; infinite without a limit."""
    gain_reduction: float
    """Factor down to which the gain may fall; 0 without a limit."""
    phase: float
    """Phase lag that may be added [rad]; infinite without a limit."""


@dataclass(frozen=True)
class LoopFamily:
    """All loops of a controller: one for each plant of the band and each amplitude."""

    band: PlantBand
    friction: NDArray[np.complex128]
    """N + jω Dv [N/m], shape (frequencies, amplitudes)."""
    path: NDArray[np.complex128]
    """Response of hold, delays and aliasing images [1], shape (frequencies,)."""
    sample_time: float
    frequency_reserve: float = 0.5
    """How far from its grid a loop may be, over the distance to the neighbouring frequency's."""
    amplitude_reserve: float = 0.5
    """The same over the distance to the neighbouring amplitude's."""

    def thinned(self, frequencies: int, amplitudes: int) -> "LoopFamily":
        """Return the family at every so many frequencies and amplitudes, for a first search."""
        rows = slice(None, None, frequencies)
        return LoopFamily(
            self.band.rows(rows),
            self.friction[rows, ::amplitudes],
            self.path[rows],
            self.sample_time,
            self.frequency_reserve / frequencies,  # that of the whole family, as near as it matters
            self.amplitude_reserve / amplitudes,
        )

    def control(self, controller: Controller) -> NDArray[np.complex128]:
        """Return C G [N/m], shape (frequencies,)."""
        return controller.response(2 * np.pi * self.band.frequency, self.sample_time) * self.path

    def sensitivity(self, control: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return an upper bound of |S| for all plants, shape (frequencies, amplitudes); infinite where one may fail."""
        middle, radius, is_inside = self._sum(control)
        power = np.abs(middle) ** 2 - radius**2
        safe = np.where(is_inside, power, 1.0)
        centre = 1 - control[:, None] * np.conj(middle) / safe
        spread = np.abs(control)[:, None] * radius / np.abs(safe)
        return np.where(is_inside, np.abs(centre) + spread, np.inf)

    def margins(self, control: NDArray[np.complex128]) -> Margins:
        """Return the margins of C G; all are 0, and the gain's 1, if the loop itself may be unstable.

        They are where the disc of 1/P + N + k C G, or that with a lag, first reaches 0.
        """
        worst = float(self.sensitivity(control).max())
        if not np.isfinite(worst):
            return Margins(0.0, 1.0, 1.0, 0.0)
        middle, radius, _ = self._sum(control)
        driven = np.broadcast_to(control[:, None], middle.shape)
        plant = middle - driven
        size, product = np.abs(driven), np.real(np.conj(plant) * driven)
        surplus = np.abs(plant) ** 2 - radius**2
        with np.errstate(invalid="ignore"):
            root = np.sqrt(product**2 - size**2 * surplus)
            factors = np.array([(-product - root) / size**2, (-product + root) / size**2])
            opening = np.arccos((radius**2 - np.abs(plant) ** 2 - size**2) / (2 * np.abs(plant) * size))
        between = np.angle(driven) - np.angle(plant)
        lags = np.mod(np.array([between - opening, between + opening]), 2 * np.pi)
        return Margins(
            1 / worst,
            float(np.where(factors > 1, factors, np.inf).min()),
            float(np.where((factors > 0) & (factors < 1), factors, 0.0).max()),
            float(np.where(np.isfinite(lags), lags, np.inf).min()),
        )

    def _sum(
        self, control: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.bool_]]:
        """Return centre and radius of the disc of 1/P + N + C G, and whether 0 is none of its values."""
        band = self.band
        middle = (band.centre + control)[:, None] + self.friction
        step = self.frequency_reserve * _neighbour_gap(control)[:, None] + self._plant_reserve
        outside = band.is_outside[:, None]
        radius = np.where(outside, band.inverse_radius[:, None], band.inverse_radius[:, None] + step)
        return middle, radius, np.where(outside, np.abs(middle) < radius, np.abs(middle) > radius)

    @cached_property
    def _plant_reserve(self) -> NDArray[np.float64]:
        """How far 1/P + N may be from its grid [N/m], shape (frequencies, amplitudes)."""
        along = self.frequency_reserve * _neighbour_gap((1 / self.band.nominal)[:, None] + self.friction)
        return along + self.amplitude_reserve * _neighbour_gap(self.friction.T).T


def _neighbour_gap(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the greater one of the distances to the values before and behind, along the first axis."""
    steps = np.abs(np.diff(values, axis=0))
    gap = np.zeros(values.shape)
    gap[:-1] = steps
    gap[1:] = np.maximum(gap[1:], steps)
    return gap


def closed_loop_radius(model: DesignModel, controller: Controller) -> float:
    """Return the magnitude of the greatest pole of a loop: it is stable below 1.

    The model's thrust is held over each sample; its position is measured a dead time later.
    """
    from scipy.linalg import companion

    sample_time = model.sample_time
    late = int(np.ceil(model.dead_time / sample_time - 1e-9))
    state_part, thrust_part = model.transition(sample_time)
    rest_state, rest_thrust = model.transition(max(late * sample_time - model.dead_time, 0.0))
    numerator, denominator = controller.transfer_function(sample_time)
    n, order = model.b.size, max(numerator.size, denominator.size) - 1
    b, a = np.pad(numerator, (0, order + 1 - numerator.size)), np.pad(denominator, (0, order + 1 - denominator.size))
    filter_state = companion(a).T if order else np.zeros((0, 0))  # transposed direct form II
    size = n + order + max(late, 1)
    matrix = np.zeros((size, size))
    line = n + order
    # measured position of this sample: the line's last element, or the present one without dead time
    position = np.zeros(size)
    if late:
        position[line + late - 1] = 1.0
    else:
        position[:n] = model.measured
    thrust = -b[0] * position
    if order:
        thrust[n] += 1.0
    matrix[:n, :n] = state_part
    matrix[:n] += np.outer(thrust_part, thrust)
    matrix[n : n + order, n : n + order] = filter_state
    matrix[n : n + order] -= np.outer(b[1:] - a[1:] * b[0], position)
    if late:
        matrix[line, :n] = model.measured @ rest_state
        matrix[line] += (model.measured @ rest_thrust) * thrust
        for i in range(1, late):
            matrix[line + i, line + i - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def damped_plant(plant: Plant, viscous: float) -> StateSpace:
    """Return a plant with viscous friction [N s/m] where the thrust acts."""
    free = plant.state_space()
    return StateSpace(free.a - viscous * np.outer(free.b, free.c @ free.a), free.b, free.c)


def rigid_gain(nominal: NDArray[np.complex128], frequency: NDArray[np.float64]) -> float:
    """Return |ω² P| at the lowest frequency [m/(N s²)]: the gain of the rigid body."""
    return float(np.abs(nominal[0]) * (2 * np.pi * frequency[0]) ** 2)


ZERO_RATIOS = (2.0, 3.0, 4.5, 7.0)
"""Crossover frequency over that of the lead's zero."""
POLE_RATIOS = (3.0, 6.0, 12.0, 25.0)
"""Frequency of the lead's pole over the crossover frequency."""
INTEGRAL_RATIOS = (3.0, 5.0, 9.0, 16.0)
"""Integral time over the reciprocal of the crossover's angular frequency."""
NOTCH_WIDTH, NOTCH_DEPTH = 0.5, 0.15
CROSSOVERS = 18
"""Crossover frequencies that are tried for each form of the controller."""
REFINEMENTS = 6
"""Bisections between the highest crossover that keeps the margins and the next one."""
LOWEST_CROSSOVER_HZ = 0.2
HIGHEST_CROSSOVER = 0.12
"""Highest crossover frequency, over the sample rate."""
REDUCTION = 0.97
"""Factor on the crossover while all frequencies and amplitudes refuse what the first search found."""
MAX_REDUCTIONS = 60


class Form(NamedTuple):
    """A controller but for its crossover frequency."""

    zero_ratio: float
    pole_ratio: float
    integral_ratio: float
    """0 without integral action."""
    notches: tuple[float, ...]
    """Frequencies [Hz]."""


@dataclass(frozen=True)
class RequiredMargins:
    """Margins that all loops must keep."""

    modulus: float
    gain: float
    phase: float
    """Phase lag [rad]."""

    def hold(self, family: LoopFamily, controller: NotchedPid) -> bool:
        """Return whether a controller keeps them for all plants and amplitudes of a family."""
        found = family.margins(family.control(controller))
        return found.modulus >= self.modulus and found.gain >= self.gain and found.phase >= self.phase


@dataclass(frozen=True)
class GainSearch:
    """What is needed to judge a controller."""

    family: LoopFamily
    model: DesignModel
    """The nominal plant with viscous friction and delays."""
    rigid_body_gain: float
    requirements: RequiredMargins
    modes: tuple[float, ...]
    """Natural frequencies at which there may be notches [Hz]."""
    has_integral: bool

    def best(self) -> NotchedPid | None:
        """Return the stiffest controller that keeps the requirements, or None if there is none."""
        rough = self.family.thinned(3, 4)
        found: list[tuple[Form, float]] = []
        merit = 0.0
        for form in self._forms():
            crossover = self._highest(form, rough, merit)
            if crossover is not None:
                found.append((form, crossover))
                merit = self._merit(self.controller(form, crossover))
        verified = (self._verify(*each) for each in reversed(found))
        return next((controller for controller in verified if controller is not None), None)

    def controller(self, form: Form, crossover: float) -> NotchedPid:
        """Return a form's controller at a crossover frequency [Hz] of the rigid body."""
        omega = 2 * np.pi * crossover
        filter_time = 1 / (form.pole_ratio * omega)
        values = {
            "integral_time": form.integral_ratio / omega,
            "derivative_time": form.zero_ratio / omega - filter_time,
            "filter_time": filter_time,
        }
        s = 1j * omega
        shape = 1 + values["derivative_time"] * s / (filter_time * s + 1)
        if form.integral_ratio:
            shape += 1 / (values["integral_time"] * s)
        count = len(form.notches)
        return NotchedPid(
            proportional=omega**2 / (self.rigid_body_gain * abs(shape)),
            **values,
            notch_frequencies=form.notches,
            notch_widths=(NOTCH_WIDTH,) * count,
            notch_depths=(NOTCH_DEPTH,) * count,
        )

    def _forms(self) -> Iterator[Form]:
        integral: Sequence[float] = INTEGRAL_RATIOS if self.has_integral else (0.0,)
        sets = [chosen for count in range(3) for chosen in itertools.combinations(self.modes, count)]
        for notches, zero, pole, time in itertools.product(sets, ZERO_RATIOS, POLE_RATIOS, integral):
            yield Form(zero, pole, time, notches)

    def _merit(self, controller: NotchedPid) -> float:
        """Return the stiffness against slow disturbances: of the integral [N/(m s)], or of the proportional gain."""
        return controller.proportional / (controller.integral_time or 1.0)

    def _highest(self, form: Form, family: LoopFamily, merit: float) -> float | None:
        """Return the highest crossover [Hz] that keeps the requirements and exceeds a merit, or None."""
        highest = HIGHEST_CROSSOVER / self.family.sample_time
        tried = np.geomspace(LOWEST_CROSSOVER_HZ, highest, CROSSOVERS)
        failed = float(tried[-1])
        for crossover in tried[::-1].tolist():
            if self._merit(self.controller(form, crossover)) <= merit:
                return None
            if self._is_good(form, crossover, family):
                return self._bisect(form, family, crossover, failed)
            failed = crossover
        return None

    def _bisect(self, form: Form, family: LoopFamily, good: float, failed: float) -> float:
        for _ in range(REFINEMENTS):
            middle = float(np.sqrt(good * failed))
            good, failed = (middle, failed) if self._is_good(form, middle, family) else (good, middle)
        return good

    def _is_good(self, form: Form, crossover: float, family: LoopFamily) -> bool:
        controller = self.controller(form, crossover)
        return self.requirements.hold(family, controller) and closed_loop_radius(self.model, controller) < 1.0

    def _verify(self, form: Form, crossover: float) -> NotchedPid | None:
        """Return the controller, slower if frequencies and amplitudes between those of the search need it."""
        for _ in range(MAX_REDUCTIONS):
            if self._is_good(form, crossover, self.family):
                return self.controller(form, crossover)
            crossover *= REDUCTION
        return None
