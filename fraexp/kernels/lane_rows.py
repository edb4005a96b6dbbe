"""Rows of lanes: in compiled code, arrays of which each item is a value of lanes."""

import operator
from collections.abc import Sequence

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.base import BaseContext
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    Signature,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import lower_getattr, models, register_model

from fraexp.kernels.lanes import LanesType, broadcast

ROW_ALIGNMENT_BYTES = 8
"""Alignment that loads and stores of rows promise: rows may begin anywhere. Those that do begin at 64 bytes are as fast
as if this said so."""


class RowsType(types.Type):
    """A float64 array of shape (n, width), seen as n lanes; shared rows have one number for all lanes, shape (n,).

    Rows that wrap take an index below 0 from the end, as Python does, and may be sliced: laws see these. The loop's own
    rows do without, which saves a comparison at each access.
    """

    def __init__(self, width: int, wraps: bool, is_shared: bool) -> None:
        super().__init__(f"rows({width}, {wraps}, {is_shared})")
        self.lanes = LanesType(width)
        self.wraps = wraps
        self.is_shared = is_shared


@register_model(RowsType)
class _RowsModel(models.StructModel):
    def __init__(self, manager: object, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, [("data", types.CPointer(types.float64)), ("size", types.intp)])


@infer_getattr
class _RowsAttributes(AttributeTemplate):
    key = RowsType

    def resolve_size(self, value: RowsType) -> types.Type:
        return types.intp


@lower_getattr(RowsType, "size")
def _size(context: BaseContext, builder: ir.IRBuilder, typ: RowsType, value: ir.Value) -> ir.Value:
    return cgutils.create_struct_proxy(typ)(context, builder, value=value).size


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: object) -> Signature | None:
        return signature(types.intp, *args) if isinstance(args[0], RowsType) else None


@lower_builtin(len, RowsType)
def _length(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
    (array,) = values
    (kind,) = sig.args
    return _size(context, builder, kind, array)


def _row_address(
    context: BaseContext, builder: ir.IRBuilder, kind: RowsType, value: ir.Value, index: ir.Value
) -> ir.Value:
    """Return where a row lies."""
    view = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    if kind.wraps:
        negative = builder.icmp_signed("<", index, ir.Constant(index.type, 0))
        index = builder.select(negative, builder.add(index, view.size), index)
    if context.enable_boundscheck:
        cgutils.do_boundscheck(context, builder, index, view.size)
    place = _row_start(builder, kind, view.data, index)
    return place if kind.is_shared else builder.bitcast(place, kind.lanes.vector.as_pointer())


def _row_start(builder: ir.IRBuilder, kind: RowsType, data: ir.Value, index: ir.Value) -> ir.Value:
    """Return the address of a row's first number."""
    if not kind.is_shared:
        index = builder.mul(index, ir.Constant(index.type, kind.lanes.width))
    return builder.gep(data, [index])


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: object) -> Signature | None:
        array, index = args
        if not isinstance(array, RowsType):
            return None
        if isinstance(index, types.Integer):
            return signature(array.lanes, array, types.intp)
        part = RowsType(array.lanes.width, wraps=True, is_shared=array.is_shared)
        return signature(part, array, types.slice2_type) if index == types.slice2_type else None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: object) -> Signature | None:
        array, index, value = args
        if not isinstance(array, RowsType) or array.is_shared or not isinstance(index, types.Integer):
            return None
        return signature(types.none, array, types.intp, array.lanes if value == array.lanes else types.float64)


@lower_builtin(operator.getitem, RowsType, types.intp)
def _get_row(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
    array, index = values
    kind, _ = sig.args
    found = builder.load(_row_address(context, builder, kind, array, index), align=ROW_ALIGNMENT_BYTES)
    return broadcast(builder, found, kind.lanes.vector) if kind.is_shared else found


@lower_builtin(operator.setitem, RowsType, types.intp, LanesType)
@lower_builtin(operator.setitem, RowsType, types.intp, types.float64)
def _set_row(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
    array, index, value = values
    kind, _, value_type = sig.args
    vector = value if value_type == kind.lanes else broadcast(builder, value, kind.lanes.vector)
    builder.store(vector, _row_address(context, builder, kind, array, index), align=ROW_ALIGNMENT_BYTES)
    return context.get_dummy_value()


@lower_builtin(operator.getitem, RowsType, types.slice2_type)
def _slice_rows(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
    array, bounds = values
    kind, _ = sig.args
    part = context.make_helper(builder, types.slice2_type, bounds)
    view = cgutils.create_struct_proxy(kind)(context, builder, value=array)
    zero = ir.Constant(part.start.type, 0)

    def clip(bound: ir.Value) -> ir.Value:
        bound = builder.select(builder.icmp_signed("<", bound, zero), builder.add(bound, view.size), bound)
        return builder.select(builder.icmp_signed(">", bound, view.size), view.size, bound)

    start, stop = clip(part.start), clip(part.stop)
    result = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    result.data = _row_start(builder, kind, view.data, start)
    result.size = builder.sub(stop, start)
    return result._getvalue()
