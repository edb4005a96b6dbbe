"""A law's arguments: their kinds, sizes and numbers, nested as they are."""

import numpy as np

from fraexp.kernels.law_arguments import (
    ARRAY,
    CACHE_LINE_BYTES,
    FLOAT,
    SIZE,
    aligned_zeros,
    argument_kinds,
    argument_sizes,
    flatten_arguments,
)

ARGUMENTS = (2.0, np.array([1.0, 3.0]), (np.array([4.0]), 7, ()))


def test_kinds_are_nested_as_the_arguments_and_do_not_depend_on_their_numbers() -> None:
    assert argument_kinds(ARGUMENTS) == (FLOAT, ARRAY, (ARRAY, SIZE, ()))
    assert argument_kinds((5.0, np.zeros(9), (np.zeros(3), 1, ()))) == argument_kinds(ARGUMENTS)


def test_numbers_lie_one_after_another_without_the_sizes() -> None:
    assert flatten_arguments(ARGUMENTS).tolist() == [2.0, 1.0, 3.0, 4.0]
    assert argument_sizes(ARGUMENTS) == [1, 2, 1, 7]


def test_rows_of_lanes_begin_at_a_cache_line() -> None:
    for count in range(1, 20):
        rows = aligned_zeros(count, 8)
        assert rows.shape == (count, 8)
        assert rows.ctypes.data % CACHE_LINE_BYTES == 0
