"""A friction law's arguments: numbers, arrays and sizes, nested in tuples; how they lie in memory and are read."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from fraexp.kernels.addresses import ONE_DIMENSION, make_array, make_rows
from fraexp.kernels.lanes import VECTOR, WIDTH, lanes, rows

CACHE_LINE = 64
FLOAT, ARRAY, SIZE = "float", "array", "size"
"""What a law takes: a number, several numbers, or a size that is the same for all machines; nested in tuples."""


def structure(arguments: Any) -> Any:
    """Return of what kind each of a law's arguments is, nested as they are."""
    if isinstance(arguments, tuple):
        return tuple(structure(argument) for argument in arguments)
    if isinstance(arguments, int):
        return SIZE
    return FLOAT if isinstance(arguments, float) else ARRAY


def sizes(arguments: Any) -> list[int]:
    """Return the size of each argument, one after another: the numbers that it has, or the number that it is."""
    if isinstance(arguments, tuple):
        return [size for argument in arguments for size in sizes(argument)]
    if isinstance(arguments, int):
        return [arguments]
    return [1 if isinstance(arguments, float) else arguments.size]


def flatten(arguments: Any) -> np.ndarray:
    """Return all numbers of a law's arguments, one after another, without the sizes."""
    if isinstance(arguments, tuple):
        return np.concatenate([np.zeros(0), *map(flatten, arguments)])
    return np.zeros(0) if isinstance(arguments, int) else np.atleast_1d(np.asarray(arguments, dtype=float))


def aligned_zeros(count: int, width: int) -> np.ndarray:
    """Return zeros of shape (count, width) that begin where a vector register likes it."""
    place = np.zeros(count * width + CACHE_LINE // 8)
    first = (-place.ctypes.data % CACHE_LINE) // 8
    return place[first : first + count * width].reshape(count, width)


def argument_reader(kinds: Any, wide: bool) -> Any:
    """Return a compiled function that reads a law's arguments: from the address of their numbers, and that of sizes."""
    row = 8 * WIDTH if wide else 8  # bytes

    def kind_of(kind: Any) -> types.Type:
        if isinstance(kind, tuple):
            return types.Tuple([kind_of(part) for part in kind])
        return {
            SIZE: types.int64,
            FLOAT: lanes if wide else types.float64,
            ARRAY: rows if wide else ONE_DIMENSION,
        }[kind]

    def read(typingctx: Any, numbers: Any, sizes: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            place, index = values[0], 0
            first_size = builder.inttoptr(values[1], ir.IntType(64).as_pointer())

            def taken(kind: Any) -> Any:
                nonlocal place, index
                if isinstance(kind, tuple):
                    return context.make_tuple(builder, kind_of(kind), [taken(part) for part in kind])
                size = builder.load(builder.gep(first_size, [ir.Constant(ir.IntType(64), index)]))
                index += 1
                if kind == SIZE:
                    return size
                here = place
                place = builder.add(here, builder.mul(size, ir.Constant(ir.IntType(64), row)))
                if kind == ARRAY and wide:
                    return make_rows(context, builder, rows, here, size)
                if kind == ARRAY:
                    return make_array(context, builder, here, size)
                pointee = VECTOR if wide else ir.DoubleType()
                return builder.load(builder.inttoptr(here, pointee.as_pointer()), align=8)

            return taken(kinds)

        return kind_of(kinds)(types.int64, types.int64), emit

    return intrinsic(read)
