"""Moves of many numbers at once: copies, and rows of lanes that become one row for each lane."""

from collections.abc import Sequence

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.base import BaseContext
from numba.core.typing.templates import Signature

from fraexp.kernels.addresses import DOUBLE_BYTES
from fraexp.kernels.decorators import Intrinsic, intrinsic

TILE = 8
"""Rows and columns of a matrix that is transposed in registers."""


@intrinsic
def copy_doubles(typingctx: object, target: types.Type, source: types.Type, count: types.Type) -> Intrinsic:
    """Copy doubles from one address to another; a loop over arrays would look at the sign of each index."""

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        into, given, size = values
        pointer = ir.DoubleType().as_pointer()
        cgutils.raw_memmove(
            builder, builder.inttoptr(into, pointer), builder.inttoptr(given, pointer), size, DOUBLE_BYTES
        )
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64), emit


@intrinsic
def store_transposed(
    typingctx: object, rows: types.Type, row_bytes: types.Type, target: types.Type, offsets: types.Type
) -> Intrinsic:
    """Write TILE columns of TILE rows: column i goes to `target`, offsets[i] doubles on.

    All arguments are addresses, but for the number of bytes from one of the given rows to the next.
    """
    vector = ir.VectorType(ir.DoubleType(), TILE)

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        source, stride, into, first_offset = values
        tile = []
        for _ in range(TILE):
            tile.append(builder.load(builder.inttoptr(source, vector.as_pointer()), align=DOUBLE_BYTES))
            source = builder.add(source, stride)
        offset = builder.inttoptr(first_offset, ir.IntType(64).as_pointer())
        start = builder.inttoptr(into, ir.DoubleType().as_pointer())
        for i, column in enumerate(_transpose(builder, tile)):
            shift = builder.load(builder.gep(offset, [ir.Constant(ir.IntType(64), i)]))
            place = builder.bitcast(builder.gep(start, [shift]), vector.as_pointer())
            builder.store(column, place, align=DOUBLE_BYTES)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64, types.int64), emit


def _transpose(builder: ir.IRBuilder, tile: list[ir.Value]) -> list[ir.Value]:
    """Return the columns of a matrix of TILE rows: quarters, eighths and so on are exchanged, in registers."""
    span = 1
    while span < TILE:
        lower = [i if not i & span else i - span + TILE for i in range(TILE)]
        upper = [i + span if not i & span else i + TILE for i in range(TILE)]
        masks = [ir.Constant(ir.VectorType(ir.IntType(32), TILE), mask) for mask in (lower, upper)]
        exchanged = list(tile)
        for row in range(TILE):
            if not row & span:
                pair = tile[row], tile[row + span]
                exchanged[row], exchanged[row + span] = (builder.shuffle_vector(*pair, mask) for mask in masks)
        tile, span = exchanged, 2 * span
    return tile
