"""Structures that Python and compiled code share: laid out from a class's annotations, read and written by name."""

import numpy as np
import pytest

from fraexp.kernels.decorators import compiled
from fraexp.kernels.structs import StructArray, struct_dtype


class Counter:
    """A structure with a field of each kind."""

    count: int
    total: float
    seed: np.uint64


def test_fields_lie_in_the_order_of_the_class_in_eight_bytes_each() -> None:
    dtype = struct_dtype(Counter)
    assert dtype.names == ("count", "total", "seed")
    assert [dtype[name] for name in dtype.names] == [np.int64, np.float64, np.uint64]
    assert dtype.itemsize == 24


def test_compiled_code_changes_fields_in_place() -> None:
    @compiled()
    def add(counters: StructArray[Counter], value: float) -> int:
        for i in range(counters.size):
            counter = counters[i]
            counter.count += 1
            counter.total += value
        return counters.size

    counters = np.zeros(2, struct_dtype(Counter))
    assert add(counters, 0.5) == 2
    assert add(counters[:1], 0.25) == 1
    assert counters["count"].tolist() == [2, 1]
    assert counters["total"].tolist() == [0.75, 0.5]


def test_a_field_of_another_kind_is_refused() -> None:
    class Named:
        name: str

    with pytest.raises(KeyError):
        struct_dtype(Named)
