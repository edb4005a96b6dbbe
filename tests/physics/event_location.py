"""The sampled loop by an adaptive integrator with event location: shares no code and no idea with the simulation.

Between two samples the control input is constant, and between two events (an element sticks or slips, the velocity
changes its sign) the equations are smooth: there DOP853 integrates them to ten digits. Friction laws are written as
differential equations from their publications.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

RELATIVE, ABSOLUTE = 1e-9, 1e-8
"""Tolerances of the integrator; the absolute one times the scale of each state."""
POSITION, VELOCITY = 1e-6, 1e-3
"""Scales of a mode's states."""
SLACK = 1e-12
"""By how much a guard may be crossed before it counts [m/s, or relative]: at rest it is zero."""
MAX_EVENTS = 200
"""Events within one sample: more would be chatter."""
LATE_S = 1e-12
"""Time before a sample's end at which an event counts as at its end."""


class EventLaw:
    """A friction law whose equations are smooth until one of its guards crosses zero.

    `sign` is the direction of motion; `modes` are those of its parts.
    """

    scale: NDArray[np.float64]
    """Size of each state, shape (states,)."""

    def __init__(self) -> None:
        self.sign = 1.0

    def force(self, z: NDArray[np.float64], v: float, hold: float) -> float:
        """Return the force [N]; `hold` is what would keep the velocity as it is."""
        raise NotImplementedError

    def rate(self, z: NDArray[np.float64], v: float) -> NDArray[np.float64]:
        """Return dz/dt."""
        raise NotImplementedError

    def guards(self, z: NDArray[np.float64], v: float, hold: float) -> list[float]:
        """Return numbers that stay above zero until the equations change; the first one is that of the direction."""
        return [self.sign * v]

    def switch(self, guard: int, z: NDArray[np.float64], hold: float) -> None:
        """Go over to the equations after a guard has crossed zero."""
        self.sign = -self.sign


class Elements(EventLaw):
    """Elasto-slide elements: K_i z_i, where z_i follows the displacement up to ±Y_i."""

    def __init__(self, stiffness: tuple[float, ...], limit_force: tuple[float, ...]) -> None:
        super().__init__()
        self.stiffness = np.array(stiffness)
        self.scale = self.width = np.array(limit_force) / self.stiffness
        self.slips = np.zeros(self.width.size, dtype=bool)

    def force(self, z, v, hold):
        return float(self.stiffness @ z)

    def rate(self, z, v):
        return np.where(self.slips, 0.0, v)

    def guards(self, z, v, hold):
        return [self.sign * v, *np.where(self.slips, 1.0, (self.width - self.sign * z) / self.width)]

    def switch(self, guard, z, hold):
        if guard == 0:
            self.sign, self.slips = -self.sign, np.zeros_like(self.slips)
        else:
            self.slips[guard - 1] = True
            z[guard - 1] = self.sign * self.width[guard - 1]


class Stribeck(NamedTuple):
    """Fc + (Fs - Fc) exp(-(v/vs)²)."""

    coulomb_force: float
    static_force: float
    velocity: float = 1e-3

    def at(self, v: float) -> float:
        """Return the force at a velocity [m/s]."""
        return self.coulomb_force + (self.static_force - self.coulomb_force) * np.exp(-((v / self.velocity) ** 2))


class Bristle(EventLaw):
    """ż = v (1 - α z σ0/g(v) sgn v), F = σ0 z + σ1 ż: LuGre; Dahl without σ1 and Stribeck effect; elastoplastic."""

    def __init__(self, stiffness: float, damping: float, curve: Stribeck, elastic_limit: float = 0.0) -> None:
        super().__init__()
        self.stiffness, self.damping, self.curve, self.elastic_limit = stiffness, damping, curve, elastic_limit
        self.scale = np.array([curve.coulomb_force / stiffness])

    def force(self, z, v, hold):
        return float(self.stiffness * z[0] + self.damping * self.rate(z, v)[0])

    def rate(self, z, v):
        steady, along = self.curve.at(v) / self.stiffness, self.sign * z[0]
        alpha = 1.0
        if self.elastic_limit > 0 and along < steady:
            middle = (along - 0.5 * (steady + self.elastic_limit)) / (steady - self.elastic_limit)
            alpha = 0.5 + 0.5 * np.sin(np.pi * middle) if along > self.elastic_limit else 0.0
        return np.array([v * (1 - alpha * along / steady)])


class MaxwellSlip(EventLaw):
    """GMS: Ḟ = k v until sgn(v) F = α S(v), then Ḟ = sgn(v) C (α - sgn(v) F/S) until the velocity turns."""

    def __init__(self, stiffness, force_fractions, curve: Stribeck, attraction_rate: float) -> None:
        super().__init__()
        self.stiffness, self.fractions = np.array(stiffness), np.array(force_fractions)
        self.curve, self.attraction_rate = curve, attraction_rate
        self.slips = np.zeros(self.stiffness.size, dtype=bool)
        self.scale = self.fractions * curve.coulomb_force

    def force(self, z, v, hold):
        return float(np.sum(z))

    def rate(self, z, v):
        attraction = self.attraction_rate * (self.sign * self.fractions - z / self.curve.at(v))
        return np.where(self.slips, attraction, self.stiffness * v)

    def guards(self, z, v, hold):
        room = self.fractions * self.curve.at(v) - self.sign * z
        return [self.sign * v, *np.where(self.slips, 1.0, room / self.scale)]

    def switch(self, guard, z, hold):
        if guard == 0:
            self.sign, self.slips = -self.sign, np.zeros_like(self.slips)
        else:
            self.slips[guard - 1] = True


class SetValued(EventLaw):
    """Coulomb friction with Stribeck effect: at rest it is whatever holds the machine, up to Fs."""

    def __init__(self, curve: Stribeck) -> None:
        super().__init__()
        self.curve, self.sticks, self.scale = curve, True, np.zeros(0)

    def force(self, z, v, hold):
        return hold if self.sticks else float(self.sign * self.curve.at(v))

    def rate(self, z, v):
        return np.zeros(0)

    def guards(self, z, v, hold):
        return [1 - abs(hold) / self.curve.static_force if self.sticks else self.sign * v]

    def switch(self, guard, z, hold):
        if not self.sticks and abs(hold) < self.curve.static_force:
            self.sticks = True
        else:
            self.sticks, self.sign = False, float(np.sign(hold))


class Loop(NamedTuple):
    """The loop around a law: plant, controller, excitation; the dead time is whole samples."""

    plant: Any
    viscous: float
    numerator: NDArray[np.float64]
    denominator: NDArray[np.float64]
    sample_time: float
    dead_samples: int


class Record(NamedTuple):
    """Samples from rest: measured position [m], control input [N] and friction force [N], each of shape (n,)."""

    y: NDArray[np.float64]
    u: NDArray[np.float64]
    friction: NDArray[np.float64]


def simulate(loop: Loop, law: EventLaw, excitation: NDArray[np.float64]) -> Record:
    """Return the loop's signals from rest under an excitation [N], shape (n,)."""
    states = loop.plant.b.size
    x = np.zeros(states + law.scale.size)
    rows: list[tuple[float, float, float]] = []
    for k, added in enumerate(excitation):
        y = float(loop.plant.c @ x[:states])
        u = float(added) + _control(loop, rows, y, k, excitation)
        rows.append((y, u, 0.0))
        thrust = rows[k - loop.dead_samples][1] if k >= loop.dead_samples else 0.0
        rows[k] = (y, u, _Motion(loop, law, thrust).friction(x))
        x = _advance(loop, law, thrust, x)
    return Record(*np.array(rows).T)


def _control(loop: Loop, rows, y: float, k: int, excitation: NDArray[np.float64]) -> float:
    """Return C(z) times the position error: a recursion over past errors and outputs."""
    total = -loop.numerator[0] * y
    for lag in range(1, min(k, loop.numerator.size - 1) + 1):
        total -= loop.numerator[lag] * rows[k - lag][0]
    for lag in range(1, min(k, loop.denominator.size - 1) + 1):
        total -= loop.denominator[lag] * (rows[k - lag][1] - excitation[k - lag])
    return total


class _Motion:
    """The equations of motion at one thrust."""

    def __init__(self, loop: Loop, law: EventLaw, thrust: float) -> None:
        self.loop, self.law, self.thrust, self.states = loop, law, thrust, loop.plant.b.size
        row = loop.plant.c @ loop.plant.a
        self.velocity_row, self.mobility = row, float(row @ loop.plant.b)
        self.held_row = (row @ loop.plant.a - self.mobility * loop.viscous * row) / self.mobility

    def velocity_and_hold(self, x):
        """Return the velocity, and the friction force that would keep it as it is."""
        moved = x[: self.states]
        return float(self.velocity_row @ moved), float(self.held_row @ moved) + self.thrust

    def friction(self, x) -> float:
        """Return the friction force."""
        velocity, hold = self.velocity_and_hold(x)
        return self.law.force(x[self.states :], velocity, hold)

    def rate(self, _: float, x):
        """Return the derivative of plant and law."""
        plant, states = self.loop.plant, self.states
        velocity, hold = self.velocity_and_hold(x)
        force = self.law.force(x[states:], velocity, hold)
        drive = self.thrust - force - self.loop.viscous * velocity
        return np.concatenate([plant.a @ x[:states] + plant.b * drive, self.law.rate(x[states:], velocity)])

    def guards(self, x):
        """Return the law's guards."""
        return self.law.guards(x[self.states :], *self.velocity_and_hold(x))


def _advance(loop: Loop, law: EventLaw, thrust: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the state after one sample, event by event."""
    motion, states, now = _Motion(loop, law, thrust), loop.plant.b.size, 0.0
    absolute = np.concatenate([np.tile([POSITION, VELOCITY], states // 2), law.scale]) * ABSOLUTE

    def event(_: float, x) -> float:
        return float(min(motion.guards(x))) + SLACK

    event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]

    def go_over() -> None:
        _, hold = motion.velocity_and_hold(x)
        law.switch(int(np.argmin(motion.guards(x))), x[states:], hold)

    if event(now, x) < 0:  # the thrust has jumped
        go_over()
    for _ in range(MAX_EVENTS):
        span = (now, loop.sample_time)
        found = solve_ivp(
            motion.rate, span, x, "DOP853", events=event, rtol=RELATIVE, atol=absolute, max_step=loop.sample_time / 4
        )  # longer steps pass over a turn and its return
        x, now = found.y[:, -1].copy(), found.t[-1]
        if found.status == 1:
            go_over()
        if found.status != 1 or loop.sample_time - now < LATE_S:
            return x
    raise AssertionError("events without end")
