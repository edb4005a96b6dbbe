"""Friction force along a prescribed displacement."""

from typing import Any

import numpy as np

from fraexp.kernels.law import Law, cached, call

PASSES = 500
"""Times that a periodic record is run through at most."""
CLOSED = 1e-10
"""Change of the force from one pass to the next, relative to the greatest force, that counts as periodic."""


def drive(
    law: Law,
    arguments: tuple[Any, ...],
    states: int,
    displacement: np.ndarray,
    time_step: float,
    periodic: bool,
    lead_in: tuple[np.ndarray, float],
) -> np.ndarray:
    """Return the force [N], shape (n,), along a displacement [m], shape (n,), from the state at rest.

    A periodic record is run through again until its force repeats itself; from its end to its beginning the
    displacement moves by their difference. `lead_in` is the displacement before, from rest, and its time step.
    """
    force = np.empty_like(displacement)
    z = np.zeros((2, max(states, 1)))
    passes = PASSES if periodic else 1
    call(_make_drive, law, displacement, time_step, passes, *lead_in, z, force, arguments)
    return force


def _make_drive(law: Law, fingerprint: str) -> Any:
    @cached
    def run(displacement, time_step, passes, lead_in, lead_in_step, z, force, arguments):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        now = 0
        last = displacement[0]
        if lead_in.size:
            last = lead_in[0]
            for k in range(1, lead_in.size):
                law(z[now], lead_in[k] - last, lead_in_step, z[1 - now], *arguments)
                last = lead_in[k]
                now = 1 - now
        for done in range(passes):
            greatest = 0.0
            for k in range(displacement.size):
                force[k] = law(z[now], displacement[k] - last, time_step, z[1 - now], *arguments)
                greatest = max(greatest, abs(force[k]))
                last = displacement[k]
                now = 1 - now
            again = law(z[now], displacement[0] - last, time_step, z[1 - now], *arguments)
            if done > 0 and abs(again - force[0]) <= CLOSED * greatest:
                break

    return run
