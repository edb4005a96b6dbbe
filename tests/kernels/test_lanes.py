"""Which laws are computed in lanes, and that lanes give what single machines give, bit for bit."""

import math

import numpy as np

from fraexp.components.kinds import Motion
from fraexp.kernels import prescribed_motion
from fraexp.kernels.announcement import compilation_listener
from fraexp.kernels.choice import where
from fraexp.kernels.law import Law
from fraexp.kernels.prescribed_motion import can_vectorise, friction_forces

RECORDS = [np.cumsum(np.random.default_rng(number).standard_normal(40 + 7 * number)) for number in range(10)]
MOTIONS = [Motion(1e-6 * record, 1e-3, periodic=bool(number % 2)) for number, record in enumerate(RECORDS)]
STIFFNESS, LIMIT = 4e5, 18.0


def choosing(z, dy, dt, z_next, stiffness, limit):  # type: ignore[no-untyped-def]
    """A law of min and max, a choice, and functions of math."""
    z_next[0] = min(max(z[0] + stiffness * dy, -limit), limit)
    speed = abs(dy) / dt
    return where((z_next[0] > 0.0) & (speed > 0.0), z_next[0] * (1.0 + 1e-3 * math.exp(-speed)), z_next[0])


def branching(z, dy, dt, z_next, stiffness, limit):  # type: ignore[no-untyped-def]
    """A law that takes another path where it slips."""
    z_next[0] = z[0] + stiffness * dy
    if abs(z_next[0]) > limit:
        z_next[0] = math.copysign(limit, z_next[0])
    return z_next[0]


def forces(law: Law, motions: list[Motion], is_vectorised: bool) -> list[np.ndarray]:
    return friction_forces(law, (STIFFNESS, LIMIT), 1, motions, is_vectorised)


def test_a_law_that_chooses_is_computed_in_lanes_and_one_that_branches_is_not() -> None:
    assert can_vectorise(choosing, (STIFFNESS, LIMIT))
    assert not can_vectorise(branching, (STIFFNESS, LIMIT))


def test_a_law_that_branches_is_tried_once_and_announced_never_again() -> None:
    said: list[bool] = []
    assert not can_vectorise(branching, (STIFFNESS, LIMIT))
    with compilation_listener(said.append):
        assert not can_vectorise(branching, (2 * STIFFNESS, LIMIT))
        prescribed_motion._can_vectorise.cache_clear()  # as in another process
        assert not can_vectorise(branching, (STIFFNESS, LIMIT))
    assert said == []


def test_lanes_give_the_bits_of_single_machines_whatever_lies_beside() -> None:
    together = forces(choosing, MOTIONS, is_vectorised=True)
    for motion, force in zip(MOTIONS, together, strict=True):
        (alone,) = forces(choosing, [motion], is_vectorised=False)
        assert np.array_equal(force, alone)
    reversed_order = forces(choosing, MOTIONS[::-1], is_vectorised=True)
    assert all(np.array_equal(a, b) for a, b in zip(together, reversed_order[::-1], strict=True))
