"""Friction inside a step of the loop: explicit in lanes, implicit for one machine, set-valued for a law of velocity.

At the end of a step the displacement is y₊ = a − g·f(y₊): a is what it would be without the friction force there, and g
what this force takes away [m/N]. The law f does not fall with displacement. A law of velocity that jumps at rest is
solved in velocities: v₊ = b − h·f, with the mean force f over the step.
"""

from collections.abc import Callable

import numpy as np

from fraexp.kernels.choice import where
from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled
from fraexp.kernels.lanes import LaneRows, LaneValue
from fraexp.kernels.law import Law
from fraexp.kernels.law_arguments import LawArgument

LawInput = tuple[LaneRows, LaneRows, float, tuple[LawArgument, ...]]
"""What a law takes beside its motion: present and next state, duration of the step [s], arguments."""
StepBefore = tuple[LaneValue, LaneValue, LaneValue, LaneValue]
"""Where the step before ended: its force and that before it [N], displacement [m] or velocity [m/s], stiffness."""
StepEnd = tuple[LaneValue, LaneValue, LaneValue]
"""Force [N], displacement [m] or velocity [m/s], and local stiffness [N/m] at the end of a step."""
MAX_ITERATIONS = 60
"""Iterations of the implicit step: bisection alone halves the bracket below rounding within these."""
REST_DISPLACEMENT_M = 1e-30
"""Motion in a step that counts as rest, but has a direction."""


def make_explicit_step(law: Law) -> Callable[..., StepEnd]:
    """Return the step in lanes: force [N], displacement [m] and stiffness [N/m] at its end.

    The law is evaluated once, at the displacement that the extrapolated force predicts: all lanes take the same path,
    while a search for the root would last as long as the slowest of them.
    """

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def explicit_step(free_displacement: LaneValue, gain: float, given: LawInput, before: StepBefore) -> StepEnd:
        (z, z_next, time_step, arguments), (force, previous_force, displacement, stiffness) = given, before
        y = free_displacement - gain * (2.0 * force - previous_force)
        return law(z, y - displacement, time_step, z_next, *arguments), y, stiffness

    return explicit_step


def make_implicit_step(law: Law) -> Callable[..., StepEnd]:
    """Return the step of one machine, which finds the root of r(y) = y − a + g·f(y): force, displacement, stiffness.

    The law does not fall with displacement, so that the slope of r is 1 or more and there is one root. The secant
    method finds it in about three evaluations of the law, from the prediction of the explicit step and the slope of the
    step before; a bracket, halved where a secant leaves it, makes sure that it ends.
    """

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def implicit_step(free_displacement: LaneValue, gain: float, given: LawInput, before: StepBefore) -> StepEnd:
        (z, z_next, time_step, arguments), (force, previous_force, displacement, stiffness) = given, before
        y = free_displacement - gain * (2.0 * force - previous_force)
        next_force = law(z, y - displacement, time_step, z_next, *arguments)
        residual = y - free_displacement + gain * next_force
        slope = 1.0 + gain * stiffness
        low, high = -np.inf, np.inf
        for _ in range(MAX_ITERATIONS):
            if abs(residual) <= 1e-7 * abs(y - displacement) + 1e-17:  # of the step's motion [m], or of rounding
                break
            if residual > 0.0:
                high = y
            else:
                low = y
            trial = y - residual / slope
            if not low < trial < high:
                trial = 0.5 * (low + high)
            if trial == y:  # the bracket has no number left inside
                break
            next_force = law(z, trial - displacement, time_step, z_next, *arguments)
            trial_residual = trial - free_displacement + gain * next_force
            slope = max((trial_residual - residual) / (trial - y), 1.0)
            y, residual = trial, trial_residual
        if y != displacement:
            stiffness = max((next_force - force) / (y - displacement), 0.0)
        return next_force, y, stiffness

    return implicit_step


def make_set_valued_step(law: Law) -> Callable[..., StepEnd]:
    """Return the step of a law of velocity that jumps at rest: mean force [N], velocity [m/s] at the end, stiffness.

    The machine slides on, or comes to rest within the step; then it sticks if friction can balance the thrust, and
    otherwise slides back for what is left of the step. Without friction its velocity is linear in time within a step.
    The mean force has the exact impulse of such a motion, so that the error falls with the square of the step although
    the force jumps; the force is held over the step, because a force linear in time that keeps a velocity at zero
    would oscillate from step to step.
    """

    @compiled(forceinline=True, **COMPILER_OPTIONS)
    def set_valued_step(free_velocity: LaneValue, gain: float, given: LawInput, before: StepBefore) -> StepEnd:
        (z, z_next, time_step, arguments), (_, _, velocity, stiffness) = given, before
        balance = (free_velocity - velocity) / gain  # the friction force that would keep the velocity
        way = where(velocity > 0.0, 1.0, where(velocity < 0.0, -1.0, where(balance > 0.0, 1.0, -1.0)))
        # Sliding on, at the mean velocity that the force at the beginning predicts.
        begin_force = law(z, way * max(abs(velocity) * time_step, REST_DISPLACEMENT_M), time_step, z_next, *arguments)
        mean = 0.5 * way * (velocity + free_velocity - gain * begin_force)
        sliding_force = law(z, way * max(mean * time_step, REST_DISPLACEMENT_M), time_step, z_next, *arguments)
        onward = free_velocity - gain * sliding_force
        # Coming to rest, and sliding back if friction cannot balance the thrust there.
        rest = 1.0 - velocity / (velocity - onward)
        limit = law(z, -way * REST_DISPLACEMENT_M, time_step, z_next, *arguments)
        mean = -0.5 * way * rest * gain * (balance - limit)
        returning_force = law(z, -way * max(mean * time_step, REST_DISPLACEMENT_M), time_step, z_next, *arguments)
        back = where(way * (balance - limit) < 0.0, rest * gain * (balance - returning_force), 0.0)
        end_velocity = where(way * onward > 0.0, onward, back)
        # From rest it breaks away where the thrust exceeds friction at rest.
        limit = law(z, way * REST_DISPLACEMENT_M, time_step, z_next, *arguments)
        end_velocity = where(velocity == 0.0, where(way * (balance - limit) > 0.0, onward, 0.0), end_velocity)
        return (free_velocity - end_velocity) / gain, end_velocity, stiffness

    return set_valued_step
