"""Structures that Python and compiled code share: a class of annotated fields, and the numpy type of an array of them.

The class is the one place where a field is named, explained and typed: numpy lays the fields out in memory, numba reads
and writes them by name, and the type checker knows them in the functions that are compiled.
"""

from typing import Protocol, TypeVar, get_type_hints

import numpy as np
from numba import from_dtype, types

FIELD_TYPES: dict[object, type[np.generic]] = {int: np.int64, float: np.float64, np.uint64: np.uint64}
"""How a field of each annotation is stored: always in eight bytes, so that no field needs padding."""

Struct_co = TypeVar("Struct_co", covariant=True)


class StructArray(Protocol[Struct_co]):
    """A one-dimensional array of structures, as compiled code uses it."""

    @property
    def size(self) -> int:
        """Number of structures."""

    def __getitem__(self, index: int, /) -> Struct_co:
        """Return one structure; what is assigned to its fields is assigned in the array."""


def struct_dtype(fields: type) -> np.dtype[np.void]:
    """Return the numpy type of a class's annotated fields, in their order."""
    return np.dtype([(name, FIELD_TYPES[kind]) for name, kind in get_type_hints(fields).items()])


def struct_array_type(dtype: np.dtype[np.void]) -> types.Array:
    """Return the compiler's type of a one-dimensional array of structures."""
    return types.Array(from_dtype(dtype), 1, "C")


def float_array_type(dimensions: int) -> types.Array:
    """Return the compiler's type of a contiguous array of doubles."""
    return types.Array(types.float64, dimensions, "C")
