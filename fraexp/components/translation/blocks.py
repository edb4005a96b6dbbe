"""Blocks of a controller: a function that is called once per sample, with its states and what it is given."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.language import Function, Language
from fraexp.components.translation.translator import REAL_INPUT, translate


class BlockInput(NamedTuple):
    """A number that a block takes in each sample."""

    name: str
    unit: str
    meaning: str


class Setting(NamedTuple):
    """A number that is the same in all samples, and that a user may change in the exported file."""

    name: str
    unit: str
    meaning: str
    value: float | None
    """None if the user has to state it."""
    test_value: float
    """What it is along the test vector."""


@dataclass(frozen=True)
class Block:
    """A function of a controller's program, in Python; its states are zero before the first sample.

    A sample in which an input is not a finite number gives 0 and leaves the states as they are: they would keep a NaN.
    """

    name: str
    summary: str
    function: Callable[..., float]
    """Function of the states, the inputs and the constants, all by name, which writes the states."""
    states: Mapping[str, int]
    """Sizes of its states, by name."""
    inputs: tuple[BlockInput, ...]
    constants: Mapping[str, object]
    """What is the same in all samples: numbers, arrays, tuples of them, and functions."""
    output: BlockInput
    """What it returns."""
    test_inputs: NDArray[np.float64]
    """Inputs of the test vector, shape (samples, inputs)."""
    settings: tuple[Setting, ...] = ()

    @property
    def numbers(self) -> list[str]:
        """Names of inputs and settings."""
        return [*(one.name for one in self.inputs), *(one.name for one in self.settings)]

    def program(self, language: Language) -> Function:
        """Return the function in a language."""
        given = {**dict.fromkeys(self.numbers, REAL_INPUT), **self.constants}
        return translate(self.name, self.function, given, self.states, language)

    def run(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the outputs in plain Python, from zero states, shape (samples,); inputs of shape (samples, inputs)."""
        states = {name: np.zeros(size) for name, size in self.states.items()}
        names = [one.name for one in self.inputs]
        rows = (dict(zip(names, row, strict=True)) for row in np.asarray(inputs, dtype=float).tolist())
        settings = {one.name: one.test_value for one in self.settings}
        return np.array([
            self.function(**states, **row, **settings, **self.constants) if np.isfinite([*row.values()]).all() else 0.0
            for row in rows
        ])  # fmt: skip

    @cached_property
    def test_outputs(self) -> NDArray[np.float64]:
        """Outputs of the test vector by plain Python, shape (samples,)."""
        return self.run(self.test_inputs)


Numbers = NDArray[np.float64]
FrictionLaw = tuple[Callable[..., float], tuple[Any, ...], float]
"""A friction law, its arguments behind z_next, and the viscous coefficient [N s/m]."""
FeedbackForm = tuple[Numbers, Numbers, Numbers, Numbers, Numbers, float]
"""A controller as `feedback_form` returns it: numerator, derivative of the reference, denominator, integral, centres,
all of the same size, and the gain of the integral [N/m]."""


def friction_force(z: Numbers, z_next: Numbers, moved: float, time: float, friction: FrictionLaw) -> float:
    """Friction force [N] after the displacement moved by `moved` [m] in `time` [s]."""
    law, arguments, viscous = friction
    force = law(z, moved, time, z_next, *arguments)
    for i in range(z.size):
        z[i] = z_next[i]
    return force + viscous * (moved / time)


def limited_feedback(
    filtered: Numbers, error: float, moved: float, added: float, force_limit: float, controller: FeedbackForm
) -> float:
    """Control input [N] within its limit: C(z) of the position error [m], and what is added to it [N].

    `moved` [m] is the movement of the setpoint since the last sample, whose derivative is taken off again. The
    integral waits while it would drive the control input beyond the limit. Both change nothing for a setpoint at rest
    and a control input within the limit.

    A transposed direct form whose delays are 1/(z - c). The first half of `filtered` are their values, the second half
    is what rounding took of each sum, which the next one makes good (W. Kahan, Comm. ACM 8, 1965).
    """
    numerator, derivative, denominator, integral, centres, integral_gain = controller
    size = numerator.size
    control = numerator[0] * error - derivative[0] * moved + filtered[0]
    limited = min(max(control + added, -force_limit), force_limit)
    growth = integral_gain * error
    held = 0.0
    if (control + added - limited) * growth > 0.0:
        held = growth
    for i in range(1, size):
        kept = centres[i] * filtered[i - 1]
        given = numerator[i] * error - derivative[i] * moved - integral[i] * held
        change = given - denominator[i] * control + filtered[i] - filtered[size + i - 1]
        total = kept + change
        filtered[size + i - 1] = (total - kept) - change
        filtered[i - 1] = total
    return float(limited)


def feedback(
    filtered: Numbers,
    last_setpoint: Numbers,
    setpoint: float,
    position: float,
    force_limit: float,
    controller: FeedbackForm,
) -> float:
    """Control input [N] of C(z) within its limit; its derivative acts on the measured position alone."""
    moved = setpoint_movement(last_setpoint, setpoint, position)
    return limited_feedback(filtered, setpoint - position, moved, 0.0, force_limit, controller)


def tracking(
    filtered: Numbers, setpoint: float, position: float, force_limit: float, controller: FeedbackForm
) -> float:
    """Control input [N] of C(z) within its limit; its derivative acts on the position error."""
    return limited_feedback(filtered, setpoint - position, 0.0, 0.0, force_limit, controller)


def setpoint_movement(last_setpoint: Numbers, setpoint: float, position: float) -> float:
    """Movement [m] of the setpoint since the sample before; at the first one from the measured position."""
    moved = setpoint - last_setpoint[0]
    if last_setpoint[1] == 0.0:
        moved = setpoint - position
    last_setpoint[0] = setpoint
    last_setpoint[1] = 1.0
    return float(moved)


def delay_value(line: Numbers, value: float, older_share: float) -> float:
    """Value of `line.size` samples ago, for a share of the one after it."""
    older = line[0]
    for i in range(1, line.size):
        line[i - 1] = line[i]
    line[line.size - 1] = value
    return float(older_share * older + (1.0 - older_share) * line[0])


def filter_by_lags(lags: Numbers, value: float, gains: Numbers) -> float:
    """Value behind first-order lags, exact for a value that is held over each sample."""
    result = value
    for i in range(gains.size):
        lags[i] += gains[i] * (result - lags[i])
        result = lags[i]
    return result


def movement(past: Numbers, position: float) -> float:
    """Displacement [m] since the sample before; 0 at the first one."""
    moved = position - past[0]
    if past[1] == 0.0:
        moved = 0.0
    past[0] = position
    past[1] = 1.0
    return float(moved)


def effective_input(
    line: Numbers,
    input_lags: Numbers,
    output_lags: Numbers,
    past: Numbers,
    z: Numbers,
    z_next: Numbers,
    control: float,
    position: float,
    path: tuple[float, Numbers, Numbers, float],
    friction: FrictionLaw,
) -> float:
    """Effective control input [N], G_di G_do u - f(y'): the part of the control input that moves the plant, eq (2).

    `path` has the share of the delay's older value, the gains of the lags at input and output, and the sample time.
    """
    older_share, input_gains, output_gains, sample_time = path
    law, arguments, viscous = friction
    thrust = filter_by_lags(input_lags, delay_value(line, control, older_share), input_gains)
    moved = movement(past, position)
    force = friction_force(z, z_next, moved, sample_time, (law, arguments, 0.0))
    return filter_by_lags(output_lags, thrust - force, output_gains) - viscous * (moved / sample_time)


def compensated_feedback(
    filtered: Numbers,
    last_setpoint: Numbers,
    past: Numbers,
    z: Numbers,
    z_next: Numbers,
    position: float,
    setpoint: float,
    force_limit: float,
    controller: FeedbackForm,
    compensation: tuple[float, float, FrictionLaw],
) -> float:
    """Control input [N] within its limit: feedback, and a share of the friction model's force.

    `compensation` has this share, the sample time and the law.
    """
    gain, sample_time, friction = compensation
    moved = setpoint_movement(last_setpoint, setpoint, position)
    force = gain * friction_force(z, z_next, movement(past, position), sample_time, friction)
    return limited_feedback(filtered, setpoint - position, moved, force, force_limit, controller)


COURSE_STATES = 5
"""States of a move: whether there was a sample, the sample within the move, its origin, its target, the last force."""


def positioning_control(
    course: Numbers,
    filtered: Numbers,
    z: Numbers,
    z_next: Numbers,
    position: float,
    target: float,
    force_limit: float,
    tables: tuple[Numbers, Numbers, Numbers, float, int, float],
    controller: FeedbackForm,
    friction: FrictionLaw,
) -> float:
    """Control input [N] within its limit of a move to each new target: feedforward, friction along it, and feedback.

    The axis rests at the first target when it begins. A target that changes during a move is taken after it. `tables`
    has thrust and reference of each sample and the movement of each point, per metre, the stiffness that holds the
    machine [N/m], the points per sample, and the sample time.
    """
    thrust_per_metre, reference_per_metre, moved_per_metre, holding_stiffness, points, sample_time = tables
    law, arguments, viscous = friction
    samples = thrust_per_metre.size
    if course[0] == 0.0:
        course[0] = 1.0
        course[1] = float(samples)
        course[2] = target
    k = int(course[1])
    if k >= samples and target != course[2]:
        k = 0
        course[3] = target
    origin = course[2]
    distance = 0.0
    thrust = holding_stiffness * origin
    reference = origin
    if k < samples:
        distance = course[3] - origin
        thrust = thrust + distance * thrust_per_metre[k]
        reference = origin + distance * reference_per_metre[k]
    compensation = 0.0
    travelled = 0.0
    for j in range(points):
        moved = 0.0
        if k < samples:
            moved = distance * moved_per_metre[k * points + j]
        force = friction_force(z, z_next, moved, sample_time / points, (law, arguments, 0.0))
        compensation += 0.5 * (course[4] + force) / points
        course[4] = force
        travelled += moved
    if k < samples:
        k += 1
        if k == samples:
            course[2] = course[3]
    course[1] = float(k)
    compensation += viscous * travelled / sample_time
    return limited_feedback(filtered, reference - position, 0.0, thrust + compensation, force_limit, controller)
