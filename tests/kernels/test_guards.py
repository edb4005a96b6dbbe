"""Guards around a law's memory: every write beyond it shows, with the index that the law gave."""

import numpy as np
import pytest

from fraexp.kernels.guards import GUARD_ROWS, memory_rows, set_guards, state_count, state_half, written_index


def memory(states: int, lanes: int = 1) -> np.ndarray:
    rows = np.zeros((memory_rows(states), lanes))
    set_guards(rows)
    return rows


@pytest.mark.parametrize("states", [0, 1, 43])
def test_guards_leave_the_state_alone(states: int) -> None:
    rows = memory(states, 8)
    assert state_count(rows) == states
    assert written_index(rows) is None
    for half in (0, 1):
        state_half(rows, half)[:] = np.nan  # another one than that of the guards
        assert written_index(rows) is None


@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize("beyond", [0, 3])
def test_a_write_beyond_the_end_is_found(half: int, beyond: int) -> None:
    rows = memory(43)
    rows[GUARD_ROWS + half * (43 + GUARD_ROWS) + 43 + beyond] = 0.0
    assert written_index(rows) == 43 + beyond


@pytest.mark.parametrize("half", [0, 1])
def test_a_write_before_the_beginning_is_found(half: int) -> None:
    rows = memory(43)
    rows[GUARD_ROWS + half * (43 + GUARD_ROWS) - 1] = 1.0
    assert written_index(rows) == -1
