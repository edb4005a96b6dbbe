"""Friction force along a prescribed displacement."""

from typing import Any

import numpy as np
from numba import njit

from fraexp.kernels.law import Law, specialised


def drive(
    law: Law,
    arguments: tuple[Any, ...],
    states: int,
    displacement: np.ndarray,
    time_step: float,
    warm_up: int,
) -> np.ndarray:
    """Return the force [N], shape (n,), along a displacement [m], shape (n,), from the state at rest.

    The record is run through `warm_up` times beforehand; between its end and its beginning the displacement
    moves by their difference, as it does in a periodic record.
    """
    force = np.empty_like(displacement)
    z = np.zeros((2, max(states, 1)))
    specialised(_make_drive, law)(displacement, time_step, warm_up, z, force, arguments)
    return force


def _make_drive(law: Law, fingerprint: str) -> Any:
    @njit(cache=True)
    def run(displacement, time_step, warm_up, z, force, arguments):  # type: ignore[no-untyped-def]
        _ = fingerprint  # a cell of the closure: an edited law is compiled again
        now = 0
        last = displacement[0]
        for _repeat in range(warm_up + 1):
            for k in range(displacement.size):
                force[k] = law(z[now], displacement[k] - last, time_step, z[1 - now], *arguments)
                last = displacement[k]
                now = 1 - now

    return run
