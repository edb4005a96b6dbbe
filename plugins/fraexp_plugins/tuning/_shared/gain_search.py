"""The search for the feedback that is stiffest among those that keep the margins."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fraexp_plugins.controllers.notched_pid import NotchedPid
from fraexp_plugins.positioning._shared.design_model import DesignModel
from fraexp_plugins.tuning._shared.loop_margins import LoopFamily
from fraexp_plugins.tuning._shared.sampled_loop import closed_loop_radius

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
