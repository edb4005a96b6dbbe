"""What a controller needs of a study, as blocks that can be translated: friction, observer, delay, feedback, moves."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Controller, FrictionModel
from fraexp.components.periods import Feedforward
from fraexp.components.translation import blocks
from fraexp.components.translation.blocks import Block, BlockInput, FeedbackForm, Setting
from fraexp.simulation.discretisation import SignalPath
from fraexp.simulation.experiments import Compensation

RELATIVE_ROUNDING = 1e-12
"""Value of a polynomial at z = 1, over the sum of its coefficients' magnitudes, that is 0 but for rounding."""

Polynomial = list[Fraction]
"""Coefficients in ascending powers of z⁻¹."""


def feedback_form(controller: Controller, sample_time: float) -> FeedbackForm:
    """Return a controller u = N/D (r - y) - (N - T)/D r, of which T/D acts on the reference.

    N - T vanishes at z = 1, hence (N - T)/D r is a filter of the movements of r. With D = (1 - z⁻¹) D1 the integral of
    N/D is N(1)/D1(1) z⁻¹/(1 - z⁻¹); it waits for a sample if its growth is taken off by z⁻¹ D1/D.
    """
    fractions = *controller.transfer_function(sample_time), controller.reference_numerator(sample_time)
    size = max(part.size for part in fractions)
    n, d, t = (_padded(map(Fraction, part.tolist()), size) for part in fractions)
    derivative = _padded(_divided([a - b for a, b in zip(n, t, strict=True)]), size)
    rest = d
    while any(rest[1:]) and abs(float(sum(rest))) <= RELATIVE_ROUNDING * float(sum(map(abs, rest))):
        rest = _divided(rest)
    has_integral = len(rest) < size
    integral = _padded([Fraction(0), *rest] if has_integral else [], size)
    centres = delta_centres(fractions[1], size)
    parts = [delta_form(part, centres) for part in (n, derivative, d, integral)]
    gain = float(sum(n) / sum(rest)) if has_integral else 0.0
    return parts[0], parts[1], parts[2], parts[3], np.concatenate([[0.0], centres]), gain


def _padded(coefficients: Iterable[Fraction], size: int) -> Polynomial:
    found = list(coefficients)
    return found + [Fraction(0)] * (size - len(found))


def _divided(polynomial: Polynomial) -> Polynomial:
    """Return a polynomial that is 0 at z = 1, but for rounding, divided by 1 - z⁻¹."""
    return list(accumulate(polynomial))[:-1]


def delta_centres(denominator: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the numbers of -1, 0 and 1 that are nearest to the poles, in ascending order, shape (size - 1,)."""
    poles = np.roots(denominator).real
    centres = np.zeros(size - 1)
    centres[: poles.size] = np.clip(np.rint(poles), -1, 1)
    centres.sort()
    return centres


def delta_form(polynomial: Polynomial, centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a polynomial as coefficients of 1, 1/(z - c1), 1/((z - c1)(z - c2)), … with the centres c.

    An integrator, which adds up its input, is the innermost. With all centres 1 this is the form in the delta operator
    (R. Middleton and G. Goodwin, Digital Control and Estimation, 1990), with all of them 0 that in z⁻¹. The division by
    each z - c is exact.
    """
    quotient, found = list(polynomial), Polynomial()
    for centre in reversed(centres.tolist()):
        for i in range(1, len(quotient)):
            quotient[i] += Fraction(centre) * quotient[i - 1]
        found.append(quotient.pop())
    return np.array([*quotient, *reversed(found)], dtype=float)


TEST_SAMPLES = 160
"""Samples of a test vector."""
TEST_SLIDE = 30.0
"""Greatest amplitude of the test's motion, over the displacement in which the law's stiffness builds up its force."""
RELATIVE_ZERO = 1e-9
"""Thrust at rest, relative to the greatest one, that is rounding."""
TEST_FORCE_LIMIT = 1e3
"""Limit of the control input [N] along a test vector where none is known."""
DEFAULT_SCALE_M = 1e-6
"""Displacement of the test where a law states no force bound."""


@dataclass(frozen=True)
class ControllerParts:
    """What was identified or designed, as far as it is known."""

    friction: FrictionModel | None
    """Friction model that was identified, or that the observer uses."""
    controller: Controller | None
    sample_time: float | None
    """Sample time of the controller [s]."""
    input_path: SignalPath
    """What delays the control input on its way to the thrust."""
    output_path: SignalPath
    """What delays the position on its way to its sample."""
    feedforward: Feedforward | None = None
    compensation: Compensation | None = None
    units: tuple[str, str] = ("N", "m")
    """Units of force and displacement."""
    force_limit: float | None = None
    """Greatest control input [N]; None if it is not known, so that the user of the code has to state it."""

    def blocks(self) -> list[Block]:
        """Return the blocks for which everything is known."""
        found = [] if self.friction is None else [self._friction_block(self.friction)]
        if self.sample_time is None:
            return found
        if self.friction is not None:
            found.append(self._observer(self.friction, self.sample_time))
        found.append(self._smith_delay(self.sample_time))
        if self.controller is not None:
            found += self._controllers(self.controller, self.sample_time)
        return found

    def _friction_block(self, friction: FrictionModel) -> Block:
        time = BlockInput("time", "s", "time of the movement, such as the sample time")
        return Block(
            "friction",
            f"Friction force by the law {friction.name}, as it is identified, viscous friction included",
            blocks.friction_force,
            _law_states(friction),
            (BlockInput("moved", self._length, "displacement since the last call"), time),
            _law(friction),
            BlockInput("force", self._force, "friction force against the motion"),
            np.column_stack([np.diff(_motion(friction), prepend=0.0), np.full(TEST_SAMPLES, self.sample_time or 1e-3)]),
        )

    def _observer(self, friction: FrictionModel, sample_time: float) -> Block:
        dead_time = self.input_path.dead_time + self.output_path.dead_time
        size, older_share = _mean_held_delay(dead_time, sample_time)
        gains = [
            -np.expm1(-sample_time / np.array(path.lags, dtype=float)) for path in (self.input_path, self.output_path)
        ]
        position = _motion(friction)
        control = np.cos(np.arange(TEST_SAMPLES)) * (friction.force_bound or 1.0)
        states = {"line": size, "input_lags": gains[0].size, "output_lags": gains[1].size, "past": 2}
        return Block(
            "observer",
            "Effective control input: what is left of the thrust once friction is subtracted; it moves the plant",
            blocks.effective_input,
            {**states, **_law_states(friction)},
            (BlockInput("control", self._force, "control input of this sample"), self._position),
            {"path": (older_share, *gains, sample_time), **_law(friction)},
            BlockInput("effective", self._force, "effective control input"),
            np.column_stack([control, position]),
        )

    def _smith_delay(self, sample_time: float) -> Block:
        delay = (self.input_path.dead_time + self.output_path.dead_time) / sample_time
        whole = int(np.floor(delay + 1e-9))
        return Block(
            "smith_delay",
            "Dead time of the loop, by which a reference is delayed before it is compared with the measured position",
            blocks.delay_value,
            {"line": whole + 1},
            (BlockInput("value", "1", "value of this sample"),),
            {"older_share": max(delay - whole, 0.0)},
            BlockInput("late", "1", "value as the loop delays it"),
            np.sin(np.arange(TEST_SAMPLES) ** 1.5)[:, None],
        )

    def _controllers(self, controller: Controller, sample_time: float) -> Iterator[Block]:
        constants = {"controller": feedback_form(controller, sample_time)}
        derived = "whose derivative acts on the measured position alone"
        yield self._feedback("feedback", blocks.feedback, {"last_setpoint": 2}, derived, constants)
        follows = "for a reference that moves smoothly, such as a planned move: its derivative acts on the error"
        yield self._feedback("tracking", blocks.tracking, {}, follows, constants)
        if self.feedforward is not None:
            yield self._positioning(self.feedforward, constants, sample_time)
        elif self.compensation is not None:
            yield self._compensated(self.compensation, constants, sample_time)

    def _feedback(
        self,
        name: str,
        function: Callable[..., float],
        states: dict[str, int],
        derivative: str,
        constants: dict[str, Any],
    ) -> Block:
        k = np.arange(TEST_SAMPLES)
        setpoint, position = np.where(k < TEST_SAMPLES // 2, 0.0, 2e-5), np.sin(0.3 * k) * 1e-5
        return Block(
            name,
            f"Feedback C(z), {derivative}; its integral waits while the control input is at its limit",
            function,
            {**_feedback_states(constants), **states},
            (self._setpoint, self._position),
            constants,
            self._control,
            np.column_stack([setpoint, position]),
            self._settings,
        )

    def _positioning(self, feedforward: Feedforward, constants: dict[str, Any], sample_time: float) -> Block:
        short = feedforward.without_rest()
        friction = short.friction
        law = _law(friction) if friction else {"friction": (_no_friction, (), 0.0)}
        rest = float(short.thrust[-1])
        holding = rest if abs(rest) > RELATIVE_ZERO * np.abs(short.thrust).max() else 0.0
        limit = "" if short.max_distance is None else f", over distances up to {short.max_distance:g} {self._length}"
        target = np.where(np.arange(TEST_SAMPLES) < 3, 0.0, short.max_distance or 1e-3)
        position = target[-1] * np.clip((np.arange(TEST_SAMPLES) - 5.0) / 60, 0.0, 1.0)
        return Block(
            "control",
            f"Two degrees of freedom: moves to each new target with feedforward, compensates friction{limit}",
            blocks.positioning_control,
            {
                "course": blocks.COURSE_STATES,
                **_feedback_states(constants),
                **(_law_states(friction) if friction else {"z": 1, "z_next": 1}),
            },
            (
                self._position,
                BlockInput("target", self._length, "target; at the first call the position at which the axis rests"),
            ),
            {
                "tables": (
                    short.thrust,
                    short.reference,
                    np.diff(short.displacement),
                    holding,
                    short.points,
                    sample_time,
                ),
                **constants,
                **law,
            },
            self._control,
            np.column_stack([position, target]),
            self._settings,
        )

    def _compensated(self, compensation: Compensation, constants: dict[str, Any], sample_time: float) -> Block:
        friction = compensation.friction
        position = _motion(friction)
        return Block(
            "control",
            f"Feedback, and {compensation.gain:g} of the friction force by the law {friction.name}",
            blocks.compensated_feedback,
            {**_feedback_states(constants), "last_setpoint": 2, "past": 2, **_law_states(friction)},
            (self._position, self._setpoint),
            {**constants, "compensation": (float(compensation.gain), sample_time, _law(friction)["friction"])},
            self._control,
            np.column_stack([position, np.roll(position, -2)]),
            self._settings,
        )

    @property
    def _settings(self) -> tuple[Setting, ...]:
        limit = self.force_limit
        meaning = "greatest control input of the drive"
        return (Setting("force_limit", self._force, meaning, limit, limit or TEST_FORCE_LIMIT),)

    @property
    def _position(self) -> BlockInput:
        return BlockInput("position", self._length, "measured position")

    @property
    def _setpoint(self) -> BlockInput:
        return BlockInput("setpoint", self._length, "where it is to be")

    @property
    def _control(self) -> BlockInput:
        return BlockInput("control", self._force, "control input")

    @property
    def _force(self) -> str:
        return self.units[0]

    @property
    def _length(self) -> str:
        return self.units[1]


def _no_friction(z: NDArray[np.float64], dy: float, dt: float, z_next: NDArray[np.float64]) -> float:
    """Friction force [N]: none is compensated."""
    z_next[0] = 0.0
    return 0.0


def _law(friction: FrictionModel) -> dict[str, Any]:
    """Return the constants of a block that uses a friction model."""
    return {"friction": (friction.law, friction.law_arguments(), float(friction.viscous))}


def _feedback_states(constants: dict[str, Any]) -> dict[str, int]:
    return {"filtered": 2 * constants["controller"][0].size}


def _law_states(friction: FrictionModel) -> dict[str, int]:
    return {"z": friction.state_size, "z_next": friction.state_size}


def _motion(friction: FrictionModel) -> NDArray[np.float64]:
    """Return a displacement [m] that sticks, slides and turns, shape (TEST_SAMPLES,)."""
    bound, stiffness = friction.force_bound, friction.max_stiffness
    scale = bound / stiffness if bound and stiffness else DEFAULT_SCALE_M
    k = np.arange(TEST_SAMPLES)
    return np.asarray(scale * np.geomspace(0.3, TEST_SLIDE, TEST_SAMPLES) * np.sin(0.21 * k) * np.cos(0.05 * k))


def _mean_held_delay(dead_time: float, sample_time: float) -> tuple[int, float]:
    """Return length of a delay line and share of its oldest value, for the mean thrust around the present sample.

    A control input is held over the sample that follows it. Its mean over the half samples before and after an
    instant, a dead time ago, consists of two values. This mean has the phase of the hold.
    """
    begin = -dead_time / sample_time - 0.5
    oldest = int(np.floor(begin + 1e-9))
    return -oldest, float(1.0 - max(begin - oldest, 0.0))
