"""What lies at an address, as compiled code sees it: numbers of one machine, rows of eight side by side, a function.

What is compiled for each friction law takes addresses in place of arrays: as arguments, arrays would be taken apart and
put together again at every call, and all that would have to be compiled with each law.
"""

from typing import Any

from llvmlite import ir
from numba import njit
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from fraexp.kernels.lanes import RowsType, bare

ONE_DIMENSION = types.Array(types.float64, 1, "C")


def _pointer_to(kind: types.Type, name: str) -> Any:
    def typed(typingctx: Any, address: Any) -> Any:
        def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], context.get_value_type(sig.return_type))

        return types.CPointer(kind)(types.int64), emit

    typed.__doc__ = f"Return the {name} at an address; nothing looks whether an index is there."
    return intrinsic(typed)


floats_at = _pointer_to(types.float64, "doubles")
integers_at = _pointer_to(types.int64, "whole numbers")


def make_rows(context: Any, builder: Any, kind: RowsType, address: Any, size: Any) -> Any:
    """Emit rows of lanes at an address."""
    made = cgutils.create_struct_proxy(kind)(context, builder)
    made.data = builder.inttoptr(address, ir.DoubleType().as_pointer())
    made.size = size
    return made._getvalue()


def make_array(context: Any, builder: Any, address: Any, size: Any) -> Any:
    """Emit an array of doubles at an address; it does not own its memory."""
    made = context.make_array(ONE_DIMENSION)(context, builder)
    item = context.get_constant(types.intp, 8)
    data = builder.inttoptr(address, ir.DoubleType().as_pointer())
    populate_array(made, data=data, shape=[size], strides=[item], itemsize=item, meminfo=None)
    return made._getvalue()


@intrinsic
def rows_at(typingctx: Any, address: Any, size: Any) -> Any:
    """Return rows of lanes at an address; nothing looks whether an index is there."""

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return make_rows(context, builder, bare, *values)

    return bare(types.int64, types.int64), emit


@intrinsic
def array_at(typingctx: Any, address: Any, size: Any) -> Any:
    """Return an array of doubles at an address, with which a law may do whatever numba knows."""

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return impl_ret_borrowed(context, builder, sig.return_type, make_array(context, builder, *values))

    return ONE_DIMENSION(types.int64, types.int64), emit


@njit(forceinline=True)
def numbers_at(address, size):  # type: ignore[no-untyped-def]
    """Return the doubles at an address, of one machine; `rows_at` does the same for eight."""
    return floats_at(address)


@njit(forceinline=True)
def number_at(numbers, places, offset):  # type: ignore[no-untyped-def]
    """Return numbers[places[0] + offset], of one machine; `taken_at` does the same for eight."""
    return floats_at(numbers)[integers_at(places)[0] + offset]


@intrinsic
def run_at(typingctx: Any, function: Any, frames: Any) -> Any:
    """Call the compiled function of one argument at an address; what is raised there is raised here."""

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        kind = context.call_conv.get_function_type(types.none, (frames,))
        callee = builder.inttoptr(values[0], kind.as_pointer())
        status, _ = context.call_conv.call_function(builder, callee, types.none, (frames,), [values[1]])
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.none(types.int64, frames), emit
