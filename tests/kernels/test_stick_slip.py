"""A step of several dry contacts against a search of all combinations of what contacts at rest may do."""

import itertools
from functools import cache

import numpy as np
import pytest
from numba import njit

from fraexp.kernels.decorators import compiled
from fraexp.kernels.stick_slip import (
    CONTACT_DISPLACEMENT,
    CONTACT_ROWS,
    TRIAL,
    TRIAL_FORCE,
    contact_rows,
    make_stick_slip,
)
from tests.examples import thorough


@compiled()
def dry(contact, z, dy, dt, z_next, limits):
    return limits[contact] if dy > 0.0 else -limits[contact]


@cache
def compiled_step(contacts):
    step = make_stick_slip(dry, (True,) * contacts)
    return njit(lambda arguments: step(arguments))  # noqa: PLW0108 - Python cannot call the step itself


def kernel_step(compliance, limits, before, free):
    """Return mean forces and velocities at the end, from those before and those that are reached without friction."""
    n = len(limits)
    contact, z = np.zeros(contact_rows(n)), np.zeros(n)
    contact[CONTACT_DISPLACEMENT : n * CONTACT_ROWS : CONTACT_ROWS] = before
    compiled_step(n)((free, 0, -compliance.ravel(), n, contact, z, z, 1e-4, limits))
    rows = contact[: n * CONTACT_ROWS].reshape(n, CONTACT_ROWS)
    return rows[:, TRIAL_FORCE], rows[:, TRIAL]


def searched_step(ports, inverse_mass, limits, before, free):
    """Return the velocities of the bodies at the end: event by event, in bodies instead of contacts."""
    v, push, left = before.copy(), free - before, 1.0
    for _ in range(40):
        if left < 1e-12:
            break
        speed = ports @ v
        fixed = [0 if abs(each) < 1e-12 else int(np.sign(each)) for each in speed]
        at_rest = [k for k, way in enumerate(fixed) if not way]
        best, least = push, np.inf
        for choice in itertools.product((0, 1, -1), repeat=len(at_rest)):
            ways = np.array(fixed)
            ways[at_rest] = choice
            sliding = push - inverse_mass * (ports.T @ (ways * limits))
            held = ports[ways == 0]
            forces = np.zeros(0)
            if len(held):
                forces = np.linalg.lstsq((held * inverse_mass) @ held.T, held @ sliding, rcond=1e-10)[0]
            change = sliding - inverse_mass * (held.T @ forces)
            # Forces of contacts that hold the same bodies can be shared: least squares shares them evenly enough only
            # for one of them, so that others are found with one at its limit.
            wrong = max(np.max(np.abs(forces) - limits[ways == 0], initial=0.0) / limits.max(), 0.0)
            moved = ports @ change / np.abs(push).max()
            wrong = max(
                wrong, np.max([-way * moved[k] for k, way in zip(at_rest, choice, strict=True) if way] or [0.0])
            )
            if wrong < least - 1e-9:
                best, least = change, wrong
        assert least < 1e-9
        rates = ports @ best
        stops = [-s / r for s, r, way in zip(speed, rates, fixed, strict=True) if way and s * r < 0]
        until = min([left, *stops])
        v, left = v + until * best, left - until
    return v


@pytest.mark.parametrize("seed", [0, *(thorough(seed) for seed in range(1, 3))])
@pytest.mark.parametrize(
    "ports",
    [
        thorough([[1, 0], [0, 1]]),
        [[1, 0], [1, -1], [0, 1]],
        [[1, 0], [1, 0], [0, 1]],
        [[1, -1, 0], [0, 1, 0], [0, 1, -1], [0, 0, 1]],
    ],
    ids=["two bodies", "a gear", "two at one body", "a chain"],
)
def test_a_step_is_that_of_a_search(ports, seed):
    random, ports = np.random.default_rng(seed), np.array(ports, dtype=float)
    bodies = ports.shape[1]
    for _ in range(15):
        inverse_mass = 10 ** random.uniform(-1.5, 0.0, bodies)
        limits = random.uniform(0.5, 5.0, len(ports))
        before = random.normal(size=bodies) * (random.random(bodies) < 0.5)
        free = before + inverse_mass * random.normal(size=bodies) * 8.0
        compliance = (ports * inverse_mass) @ ports.T
        rounding = 1 + 1e-16 * random.integers(-2, 3, len(ports))
        forces, speeds = kernel_step(compliance, limits, ports @ before * rounding, ports @ free)
        assert np.all(np.abs(forces) <= limits * (1 + 1e-9))
        assert ports @ free - compliance @ forces == pytest.approx(speeds, abs=1e-12)
        assert speeds == pytest.approx(ports @ searched_step(ports, inverse_mass, limits, before, free), abs=1e-9)
