"""Arrays that are cached: never more than their memory, and no cliff where a sweep has more than there is room for."""

import numpy as np

from fraexp.analysis.array_cache import cached_arrays
from tests.refusals import refused

SIZE = 100
"""Numbers of an array: 800 bytes."""


def counted(max_arrays: float) -> tuple[list[int], object]:
    """Return the arguments for which a cached function computes, and the function."""
    computed: list[int] = []

    @cached_arrays(int(max_arrays * SIZE * 8))
    def numbers(first: int) -> np.ndarray:
        computed.append(first)
        return first + np.arange(SIZE, dtype=float)

    return computed, numbers


def test_an_array_is_computed_once_and_is_read_only() -> None:
    computed, numbers = counted(2)
    first, again = numbers(3), numbers(3)
    assert first is again
    assert computed == [3]
    np.testing.assert_array_equal(first, 3 + np.arange(SIZE))
    with refused(ValueError, "read-only"):
        first[0] = 0


def test_a_tenth_more_than_there_is_room_for_costs_a_part_of_what_all_cost() -> None:
    """One that forgets the oldest would compute all 110 again in each round."""
    computed, numbers = counted(100)
    for _ in range(30):
        for first in range(110):
            assert numbers(first)[0] == first
    per_round = (len(computed) - 110) / 29
    assert 10 <= per_round < 50


def test_memory_is_bounded_and_counts_keys_of_bytes() -> None:
    sizes: list[int] = []

    @cached_arrays(10_000)
    def numbers(key: bytes) -> np.ndarray:
        sizes.append(len(key))
        return np.zeros(len(key) // 8)

    for length in (8000, 4000, 4000, 80_000, 80_000):
        numbers(bytes(length))
    assert sizes == [8000, 4000, 80_000, 80_000]  # 16,000 bytes and 160,000 are never kept, 8000 are
