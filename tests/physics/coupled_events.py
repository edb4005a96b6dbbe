"""Coupled bodies with dry friction at several contacts, event by event: it shares no code and no idea with the kernels.

Between events the equations of motion are smooth, and scipy integrates them: each contact slides one way or sticks, by
a constraint force. At an event every combination of what the contacts at rest may do is tried; the one is taken in
which no constraint force exceeds friction and each contact that breaks away moves against its friction.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

SAME_TIME = 1e-9
"""Part of a sample that is no time."""
MAX_PERIODS, PERIODIC = 200, 2e-6
"""Periods, at most, until they differ by no more than this part of the motion."""
REST = 1e-13
"""Velocity that is rest [m/s]: one that breaks away begins there, and has not turned."""


@dataclass(frozen=True)
class Dry:
    """Friction sgn(v) (Fc + (Fs - Fc) exp(-(v/vs)²)) along x = vᵀq, set-valued at rest."""

    port: NDArray[np.float64]
    coulomb: float
    static: float
    stribeck: float = 1e-3

    def force(self, velocity: float) -> float:
        return self.coulomb + (self.static - self.coulomb) * float(np.exp(-((velocity / self.stribeck) ** 2)))


@dataclass(frozen=True)
class Stop:
    """A spring along x = vᵀq that slides at a limit force."""

    port: NDArray[np.float64]
    stiffness: float
    limit: float


@dataclass
class EventLoop:
    """Bodies in a sampled loop, from a position that is fed back to the force along `thrust`."""

    mass: NDArray[np.float64]
    damping: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    dry: Sequence[Dry]
    stops: Sequence[Stop]
    thrust: NDArray[np.float64]
    positions: Mapping[str, NDArray[np.float64]]
    """The first is fed back."""
    controller: tuple[NDArray[np.float64], NDArray[np.float64]]
    sample_time: float
    dead_samples: int
    rest: float
    """What the dead time exceeds whole samples by [s]."""
    stops_seen: set[tuple[int, ...]] = field(default_factory=set)
    """Directions of the dry contacts between events, 0 for one that sticks."""

    def responses(self, amplitude: float, samples: int) -> dict[str, complex]:
        """Return y/u of each position at the fundamental, from rest until periods of `samples` samples are alike."""
        n = len(self.mass)
        numerator, denominator = self.controller
        x, slides = np.zeros(2 * n + len(self.stops)), [0] * len(self.stops)
        errors, outputs = np.zeros(numerator.size), np.zeros(denominator.size - 1)
        inputs, before = [0.0] * (self.dead_samples + 2), np.zeros((samples, n))
        fed_back = next(iter(self.positions.values()))
        for _ in range(MAX_PERIODS):
            recorded, used = [], []
            for sample in range(samples):
                errors = np.concatenate([[-(fed_back @ x[:n])], errors[:-1]])
                control = float(numerator @ errors - denominator[1:] @ outputs)
                outputs = np.concatenate([[control], outputs[:-1]])
                inputs = [control + amplitude * np.sin(2 * np.pi * sample / samples), *inputs[:-1]]
                recorded.append(x[:n].copy())
                used.append(inputs[0])
                x = self._advance(x, slides, inputs[-1], self.rest)
                x = self._advance(x, slides, inputs[-2], self.sample_time - self.rest)
            motion = np.array(recorded)
            if np.abs(motion - before).max() < PERIODIC * np.abs(motion).max():
                break
            before = motion
        basis = np.exp(-2j * np.pi * np.arange(samples) / samples)
        bodies, force = basis @ motion, basis @ np.array(used)
        return {name: complex(port @ bodies / force) for name, port in self.positions.items()}

    def _advance(self, x: NDArray[np.float64], slides: list[int], thrust: float, seconds: float) -> NDArray[np.float64]:
        """Return the state after a time of constant thrust; `slides` has the direction of each stop that slides."""
        n, left = len(self.mass), seconds
        while left > SAME_TIME * self.sample_time:
            velocities = np.array([contact.port @ x[n : 2 * n] for contact in self.dry])
            ways = self._directions(x, velocities, thrust)
            self.stops_seen.add(ways)
            events = [self._turning(k, way) if way else self._holding(k, ways, thrust) for k, way in enumerate(ways)]
            events += [self._stop_event(k, slide) for k, slide in enumerate(slides)]
            for event in events:
                event.terminal, event.direction = True, -1
            found = solve_ivp(
                lambda _, x: self._slope(x, ways, slides, thrust),  # noqa: B023
                (0.0, left), x, "DOP853", events=events, rtol=1e-10, atol=1e-15,
            )  # fmt: skip
            x, left = found.y[:, -1].copy(), left - found.t[-1]
            for k, times in enumerate(found.t_events):
                if times.size and k >= len(self.dry):
                    slides[k - len(self.dry)] = self._slide_after(x, k - len(self.dry), slides)
            held = [k for k, way in enumerate(ways) if not way or found.t_events[k].size]
            x[n : 2 * n] = self._without(x[n : 2 * n], [self.dry[k].port for k in held])
        return x

    def _directions(self, x: NDArray[np.float64], velocities: NDArray[np.float64], thrust: float) -> tuple[int, ...]:
        """Return in which direction each dry contact slides, 0 where it sticks."""
        at_rest = [k for k, v in enumerate(velocities) if abs(v) <= 2 * REST]
        fixed = [0 if k in at_rest else int(np.sign(v)) for k, v in enumerate(velocities)]
        best, least = tuple(fixed), np.inf
        for choice in itertools.product((0, 1, -1), repeat=len(at_rest)):
            ways = list(fixed)
            for k, way in zip(at_rest, choice, strict=True):
                ways[k] = way
            acceleration, holding = self._accelerations(x, tuple(ways), thrust)
            wrong = 0.0
            for k in at_rest:
                contact = self.dry[k]
                scale = contact.static * float(contact.port @ np.linalg.solve(self.mass, contact.port))
                excess = abs(holding[k]) / contact.static - 1 if not ways[k] else -ways[k] * acceleration[k] / scale
                wrong = max(wrong, excess)
            if wrong < least - 1e-12:
                best, least = tuple(ways), wrong
        assert least < 1e-6
        return best

    def _accelerations(
        self, x: NDArray[np.float64], ways: tuple[int, ...], thrust: float
    ) -> tuple[list[float], dict[int, float]]:
        """Return the acceleration of each dry contact, and the force that holds each that sticks."""
        n = len(self.mass)
        force = self.thrust * thrust - self.damping @ x[n : 2 * n] - self.stiffness @ x[:n]
        for stop, z in zip(self.stops, x[2 * n :], strict=True):
            force = force - stop.port * stop.stiffness * z
        for contact, way in zip(self.dry, ways, strict=True):
            force = force - contact.port * way * contact.force(float(contact.port @ x[n : 2 * n]))
        held = [k for k, way in enumerate(ways) if not way]
        inverse, holding = np.linalg.inv(self.mass), np.zeros(0)
        if held:
            ports = np.array([self.dry[k].port for k in held])
            holding = np.linalg.lstsq(ports @ inverse @ ports.T, ports @ inverse @ force, rcond=1e-12)[0]
            force = force - ports.T @ holding
        acceleration = inverse @ force
        self._bodies = acceleration
        return [float(each.port @ acceleration) for each in self.dry], dict(zip(held, holding.tolist(), strict=True))

    def _slope(
        self, x: NDArray[np.float64], ways: tuple[int, ...], slides: list[int], thrust: float
    ) -> NDArray[np.float64]:
        n = len(self.mass)
        self._accelerations(x, ways, thrust)
        moved = [0.0 if slide else float(s.port @ x[n : 2 * n]) for s, slide in zip(self.stops, slides, strict=True)]
        return np.concatenate([x[n : 2 * n], self._bodies, moved])

    def _without(self, velocity: NDArray[np.float64], ports: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return velocities without those of contacts that stick, by impulses at these contacts."""
        if not ports:
            return velocity
        at, inverse = np.array(ports), np.linalg.inv(self.mass)
        return velocity - inverse @ at.T @ np.linalg.lstsq(at @ inverse @ at.T, at @ velocity, rcond=1e-12)[0]

    def _turning(self, number: int, way: int):
        n, port = len(self.mass), self.dry[number].port
        return lambda _, x: way * (port @ x[n : 2 * n]) + REST

    def _holding(self, number: int, ways: tuple[int, ...], thrust: float):
        limit = self.dry[number].static
        return lambda _, x: limit * (1 + 1e-9) - abs(self._accelerations(x, ways, thrust)[1][number])

    def _stop_event(self, number: int, slide: int):
        n, stop = len(self.mass), self.stops[number]
        if slide:
            return lambda _, x: slide * (stop.port @ x[n : 2 * n])
        return lambda _, x: stop.limit - abs(stop.stiffness * x[2 * n + number])

    def _slide_after(self, x: NDArray[np.float64], number: int, slides: list[int]) -> int:
        if slides[number]:
            return 0
        n, z = len(self.mass), float(x[2 * len(self.mass) + number])
        return int(np.sign(z)) if z * (self.stops[number].port @ x[n : 2 * n]) > 0 else 0
