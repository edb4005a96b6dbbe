"""Views of memory by its address, for compiled code: numbers of one machine, rows of lanes, and functions.

The code that is compiled for each friction law takes addresses in place of arrays. As arguments, arrays would be taken
apart and put together again at every call, and code for that would have to be compiled with each law.
"""

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.base import BaseContext
from numba.core.cpu import CPUContext
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import Signature
from numba.np.arrayobj import populate_array

from fraexp.kernels.decorators import Intrinsic, compiled, intrinsic
from fraexp.kernels.lane_rows import RowsType

ONE_DIMENSION = types.Array(types.float64, 1, "C")
READ_ONLY = types.Array(types.float64, 1, "C", readonly=True)
"""Type of what a law must not write: its state before the step, and its parameters. The compiler refuses it."""
DOUBLE_BYTES = 8


def _pointer_intrinsic(kind: types.Type, plural: str) -> Callable[[int], Any]:
    def type_pointer(typingctx: object, address: types.Type) -> Intrinsic:
        def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
            (place,) = values
            return builder.inttoptr(place, context.get_value_type(sig.return_type))

        return types.CPointer(kind)(types.int64), emit

    type_pointer.__doc__ = f"Return a pointer to the {plural} at an address; no index is checked."
    return intrinsic(type_pointer)


float_pointer = _pointer_intrinsic(types.float64, "doubles")
integer_pointer = _pointer_intrinsic(types.int64, "integers")


def emit_rows(
    context: BaseContext, builder: ir.IRBuilder, kind: RowsType, address: ir.Value, size: ir.Value
) -> ir.Value:
    """Emit a view of rows of lanes at an address."""
    rows = cgutils.create_struct_proxy(kind)(context, builder)
    rows.data = builder.inttoptr(address, ir.DoubleType().as_pointer())
    rows.size = size
    return rows._getvalue()


def emit_array(
    context: BaseContext, builder: ir.IRBuilder, address: ir.Value, size: ir.Value, kind: types.Type
) -> ir.Value:
    """Emit an array of doubles at an address; it does not own its memory."""
    array = context.make_array(kind)(context, builder)
    item = context.get_constant(types.intp, DOUBLE_BYTES)
    data = builder.inttoptr(address, ir.DoubleType().as_pointer())
    populate_array(array, data=data, shape=[size], strides=[item], itemsize=item, meminfo=None)
    return array._getvalue()


def row_viewer(kind: RowsType) -> Callable[[int, int], Any]:
    """Return a compiled function that returns the rows of lanes at an address, of a size."""

    def view_rows(typingctx: object, address: types.Type, size: types.Type) -> Intrinsic:
        def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
            place, count = values
            return emit_rows(context, builder, kind, place, count)

        return kind(types.int64, types.int64), emit

    return intrinsic(view_rows)


def _array_viewer(kind: types.Type) -> Callable[[int, int], Any]:
    """Return a compiled function that returns the array of doubles at an address, of a size."""

    def view_array(typingctx: object, address: types.Type, size: types.Type) -> Intrinsic:
        def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
            place, count = values
            array = emit_array(context, builder, place, count, kind)
            return impl_ret_borrowed(context, builder, sig.return_type, array)

        return kind(types.int64, types.int64), emit

    return intrinsic(view_array)


array_view = _array_viewer(ONE_DIMENSION)
"""Returns the array of doubles at an address: a law may use it in every way that numba knows."""
read_only_view = _array_viewer(READ_ONLY)
"""Returns the array of doubles at an address, which a law can only read."""


@compiled(forceinline=True)
def scalar_view(address: int, size: int) -> Any:
    """Return the doubles of one machine at an address; `row_viewer` does the same for lanes."""
    return float_pointer(address)


@compiled(forceinline=True)
def gather_scalar(numbers: int, indices: int, offset: int) -> float:
    """Return numbers[indices[0] + offset], for one machine; `lane_gatherer` does the same for lanes."""
    return float_pointer(numbers)[integer_pointer(indices)[0] + offset]


@intrinsic
def call_block(typingctx: object, function: types.Type, frames: types.Type) -> Intrinsic:
    """Call the compiled function at an address with one argument; an error that it raises is raised here."""

    def emit(context: CPUContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        address, argument = values
        kind = context.call_conv.get_function_type(types.none, (frames,))
        callee = builder.inttoptr(address, kind.as_pointer())
        status, _ = context.call_conv.call_function(builder, callee, types.none, (frames,), [argument])
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(types.int64, frames), emit
