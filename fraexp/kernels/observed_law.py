"""A law whose last call is on record: of a dropped-in law in the scalar kernel, so that a failure can be explained.

What is recorded is enough to repeat the call in plain Python, which names the line. In lanes nothing depends on values
but the numbers themselves, so that a trial step finds what a lane does wrong.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fraexp.kernels.addresses import float_pointer
from fraexp.kernels.decorators import compiled
from fraexp.kernels.law import Law
from fraexp.kernels.law_error import MAX_PLAUSIBLE_SPEED_M_S

CALL_LAW, CALL_HALF, CALL_DY, CALL_DT = range(4)
"""What is recorded of a call: which law (FRICTION or COMPENSATION), the half of its memory that held its state,
displacement increment [m], time step [s]."""
CALL_NUMBERS = 4
FRICTION, COMPENSATION = range(2)


def make_observed(law: Law, number: int) -> Callable[..., float]:
    """Return the law with an argument before its own: the address at which it records its calls.

    It raises FloatingPointError for a force that is not finite, unless the step is faster than anything plausible. The
    law finds z_next full of NaN, as in the trial: the state of two steps before, which is there otherwise, would be a
    memory beside z for a law that reads it or leaves an element unwritten.
    """

    @compiled(forceinline=True)  # further options are those of the caller
    def observed_law(
        z: object, dy: float, dt: float, z_next: NDArray[np.float64], record: int, *arguments: object
    ) -> float:
        last_call = float_pointer(record)
        last_call[CALL_LAW], last_call[CALL_DY], last_call[CALL_DT] = number, dy, dt
        for i in range(z_next.size):
            z_next[i] = np.nan
        force = law(z, dy, dt, z_next, *arguments)
        if not abs(force) < np.inf and abs(dy) <= MAX_PLAUSIBLE_SPEED_M_S * dt:
            raise FloatingPointError("the force is not finite")
        return force

    return observed_law


@compiled(forceinline=True)
def with_record(record: int, arguments: tuple[object, ...]) -> tuple[object, ...]:
    """Return the arguments of an observed law: the address of its record, then its own."""
    return (record, *arguments)


@compiled(forceinline=True)
def without_record(record: int, arguments: tuple[object, ...]) -> tuple[object, ...]:
    """Return the arguments of a law that is not observed."""
    return arguments
