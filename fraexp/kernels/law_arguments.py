"""A friction law's arguments: numbers, arrays and sizes, nested in tuples; how they lie in memory and are read back.

All numbers of the arguments lie one after another, and their sizes lie beside them. Compiled code that gets the two
addresses can thus have the same type for every law; how the arguments are nested is known when it is compiled.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.base import BaseContext
from numba.core.typing.templates import Signature
from numpy.typing import NDArray

from fraexp.kernels.addresses import DOUBLE_BYTES, READ_ONLY, emit_array, emit_rows
from fraexp.kernels.decorators import Intrinsic, intrinsic
from fraexp.kernels.lane_layout import LaneLayout
from fraexp.kernels.lanes import LanesType, broadcast

CACHE_LINE_BYTES = 64
FLOAT, ARRAY, SIZE = "float", "array", "size"
"""Kinds of a law's argument: a number, several numbers, or a size that is the same for all machines."""
LawArgument: TypeAlias = "float | int | NDArray[np.float64] | tuple[LawArgument, ...]"
ArgumentKinds: TypeAlias = "str | tuple[ArgumentKinds, ...]"


def argument_kinds(arguments: LawArgument) -> ArgumentKinds:
    """Return the kind of each of a law's arguments, nested as they are."""
    if isinstance(arguments, tuple):
        return tuple(argument_kinds(argument) for argument in arguments)
    if isinstance(arguments, int):
        return SIZE
    return FLOAT if isinstance(arguments, float) else ARRAY


def argument_sizes(arguments: LawArgument) -> list[int]:
    """Return the size of each argument, one after another: how many numbers it has, or the size that it is."""
    if isinstance(arguments, tuple):
        return [size for argument in arguments for size in argument_sizes(argument)]
    if isinstance(arguments, int):
        return [arguments]
    return [1 if isinstance(arguments, float) else arguments.size]


def flatten_arguments(arguments: LawArgument) -> NDArray[np.float64]:
    """Return all numbers of a law's arguments, one after another, without the sizes."""
    if isinstance(arguments, tuple):
        return np.concatenate([np.zeros(0), *map(flatten_arguments, arguments)])
    return np.zeros(0) if isinstance(arguments, int) else np.atleast_1d(np.asarray(arguments, dtype=float))


def aligned_zeros(count: int, width: int) -> NDArray[np.float64]:
    """Return zeros of shape (count, width) that begin at a cache line: a row of lanes is then one load, not two."""
    memory = np.zeros(count * width + CACHE_LINE_BYTES // DOUBLE_BYTES)
    first = (-memory.ctypes.data % CACHE_LINE_BYTES) // DOUBLE_BYTES
    return memory[first : first + count * width].reshape(count, width)


def argument_reader(kinds: ArgumentKinds, layout: LaneLayout) -> Callable[[int, int], Any]:
    """Return a compiled function that reads a law's arguments from the addresses of their numbers and of their sizes.

    Of one machine it returns floats and arrays; in lanes, it returns lanes and rows of lanes.
    """
    row_bytes = DOUBLE_BYTES * layout.constants_width
    integer = ir.IntType(64)
    lanes, rows = LanesType(layout.width), layout.constant_rows(wraps=True)

    def compiled_type(kind: ArgumentKinds) -> types.Type:
        if isinstance(kind, tuple):
            return types.Tuple([compiled_type(part) for part in kind])
        if kind == SIZE:
            return types.int64
        if kind == FLOAT:
            return lanes if layout.is_vectorised else types.float64
        return rows if layout.is_vectorised else READ_ONLY

    def read_arguments(typingctx: object, numbers: types.Type, sizes: types.Type) -> Intrinsic:
        def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
            place, sizes_address = values
            first_size = builder.inttoptr(sizes_address, integer.as_pointer())
            index = 0

            def emit_argument(kind: ArgumentKinds) -> ir.Value:
                nonlocal place, index
                if isinstance(kind, tuple):
                    return context.make_tuple(builder, compiled_type(kind), [emit_argument(part) for part in kind])
                size = builder.load(builder.gep(first_size, [ir.Constant(integer, index)]))
                index += 1
                if kind == SIZE:
                    return size
                here = place
                place = builder.add(here, builder.mul(size, ir.Constant(integer, row_bytes)))
                if kind == ARRAY and layout.is_vectorised:
                    return emit_rows(context, builder, rows, here, size)
                if kind == ARRAY:
                    return emit_array(context, builder, here, size, READ_ONLY)
                pointee = lanes.vector if layout.constants_width > 1 else ir.DoubleType()
                number = builder.load(builder.inttoptr(here, pointee.as_pointer()), align=8)
                return broadcast(builder, number, lanes.vector) if layout.is_shared else number

            return emit_argument(kinds)

        return compiled_type(kinds)(types.int64, types.int64), emit

    return intrinsic(read_arguments)
