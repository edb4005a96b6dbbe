"""Guard rows around a law's memory: they show what a law has written beyond its state, once the kernel has returned.

The memory lies in one array: guard, one half of the state, guard, the other half, guard. A guard is not a number: a law
that reads it has a force that is none, which is noticed as well.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

GUARD_ROWS = 8
"""Rows of each guard: a cache line of one machine, so that both halves of its state begin at a line."""
GUARD_BITS = np.uint64(0x7FF8_6672_6165_7870)
"""A quiet NaN that no computation gives."""


def memory_rows(states: int) -> int:
    """Return the rows of a law's memory with its guards."""
    return 2 * states + 3 * GUARD_ROWS


def guarded_rows(states: int) -> NDArray[np.bool_]:
    """Return which rows of a law's memory are guards, shape (rows,)."""
    is_guard = np.ones(memory_rows(states), dtype=bool)
    for first in (GUARD_ROWS, 2 * GUARD_ROWS + states):
        is_guard[first : first + states] = False
    return is_guard


@cache  # looked at whenever compiled code returns
def _guard_rows(states: int) -> NDArray[np.intp]:
    """Return the rows of a law's memory that are guards, ascending."""
    return np.flatnonzero(guarded_rows(states))


def set_guards(memory: NDArray[np.float64]) -> None:
    """Write the guards of a law's memory, shape (rows, lanes), in place."""
    memory.view(np.uint64)[guarded_rows(state_count(memory))] = GUARD_BITS


def written_index(memory: NDArray[np.float64]) -> int | None:
    """Return the index beyond z_next that a law has written, in a memory of shape (rows, lanes); None if it has not.

    From the middle guard on it counts from the nearest half.
    """
    states = state_count(memory)
    guards = _guard_rows(states)
    is_written = memory.view(np.uint64)[guards] != GUARD_BITS
    if not is_written.any():
        return None
    row = int(guards[is_written.any(axis=1)][0])
    if row < GUARD_ROWS:
        return row - GUARD_ROWS
    after_first = row - GUARD_ROWS - states
    if 0 <= after_first < GUARD_ROWS and after_first >= GUARD_ROWS // 2:
        return after_first - GUARD_ROWS
    return states + after_first % (GUARD_ROWS + states)


def state_count(memory: NDArray[np.float64]) -> int:
    """Return the number of states in a law's memory of shape (rows, lanes)."""
    return (memory.shape[0] - 3 * GUARD_ROWS) // 2


def state_half(memory: NDArray[np.float64], half: int) -> NDArray[np.float64]:
    """Return one half of the memory, 0 or 1, shape (states, lanes)."""
    states = state_count(memory)
    first = GUARD_ROWS + half * (states + GUARD_ROWS)
    return memory[first : first + states]
