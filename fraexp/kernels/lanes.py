"""Numbers side by side in vector registers: in compiled code one law computes one job, or eight at once.

A `Lanes` value is a vector of eight doubles; a row of a float64 array of shape (n, 8) holds one. A law written with
arithmetic, comparisons inside `where`, min, max, abs and functions of `math` compiles for both; one that branches on
its values does not, and runs in the scalar kernel.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AttributeTemplate, ConcreteTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic, lower_getattr, models, overload, register_model

from fraexp.kernels.choice import where

WIDTH = 8
VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
BITS = ir.VectorType(ir.IntType(1), WIDTH)
ALIGNED = 8  # bytes: rows may begin anywhere; those that begin at 64 bytes are as fast as if this said so


class LanesType(types.Type):
    """Eight doubles."""

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Any number fills all lanes."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None

    def unify(self, typingctx: Any, other: types.Type) -> types.Type | None:
        """A variable that is a number at first and lanes later is lanes."""
        return self if isinstance(other, types.Float | types.Integer) else None


class MaskType(types.Type):
    """Eight truths, as a comparison of lanes gives them."""


class RowsType(types.Type):
    """A float64 array of shape (n, 8), seen as n lanes; an index below 0 counts from the end, if it may."""

    def __init__(self, name: str, wraps: bool) -> None:
        super().__init__(name)
        self.wraps = wraps


lanes = LanesType("lanes")
mask = MaskType("mask")
rows, bare = RowsType("rows", wraps=True), RowsType("bare", wraps=False)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, VECTOR)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, BITS)


@register_model(RowsType)
class _RowsModel(models.StructModel):
    def __init__(self, manager: Any, fe_type: types.Type) -> None:
        super().__init__(manager, fe_type, [("data", types.CPointer(types.float64)), ("size", types.intp)])


def _fill(builder: Any, value: Any, vector: ir.VectorType = VECTOR) -> Any:
    """Return a vector whose lanes all have one value."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), everywhere)


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _from_number(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return _fill(builder, context.cast(builder, value, fromty, types.float64))


# arithmetic and comparisons

PAIRS = [(lanes, lanes), (lanes, types.float64), (types.float64, lanes)]


def _define(
    function: Any, result: types.Type, arguments: list[tuple[types.Type, ...]], emit: Callable[..., Any]
) -> None:
    """Give compiled code a function of lanes: `emit` builds it from vectors."""

    class Template(ConcreteTemplate):
        cases = tuple(signature(result, *kinds) for kinds in arguments)

    infer_global(function)(Template)
    for kinds in arguments:

        def lower(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            vectors = [
                _fill(builder, value) if kind == types.float64 else value
                for kind, value in zip(sig.args, values, strict=True)
            ]
            return emit(context, builder, *vectors)

        lower_builtin(function, *kinds)(lower)


def _instruction(name: str) -> Callable[..., Any]:
    return lambda context, builder, *vectors: getattr(builder, name)(*vectors)


def _comparison(sign: str) -> Callable[..., Any]:
    ordered = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
    return lambda context, builder, a, b: getattr(builder, ordered)(sign, a, b)


def _intrinsic(name: str) -> Callable[..., Any]:
    def emit(context: Any, builder: Any, *vectors: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR] * len(vectors))
        made = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
        return builder.call(made, vectors)

    return emit


def _chosen(sign: str) -> Callable[..., Any]:
    """Return what keeps the first of two values where it compares so with the second, as Python's min and max do."""
    return lambda context, builder, a, b: builder.select(builder.fcmp_ordered(sign, b, a), b, a)


def _lane_by_lane(function: Any) -> Callable[..., Any]:
    """Return what calls the scalar function once per lane: the vector has the bits that eight scalars have."""

    def emit(context: Any, builder: Any, *vectors: Any) -> Any:
        scalar = signature(types.float64, *[types.float64] * len(vectors))
        call = context.get_function(function, scalar)
        result = ir.Constant(VECTOR, ir.Undefined)
        for lane in range(WIDTH):
            at = ir.Constant(ir.IntType(32), lane)
            value = call(builder, [builder.extract_element(vector, at) for vector in vectors])
            result = builder.insert_element(result, value, at)
        return result

    return emit


for _name, _functions in {
    "fadd": (operator.add, operator.iadd),
    "fsub": (operator.sub, operator.isub),
    "fmul": (operator.mul, operator.imul),
    "fdiv": (operator.truediv, operator.itruediv),
}.items():
    for _function in _functions:
        _define(_function, lanes, PAIRS, _instruction(_name))
for _function, _name in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
    (operator.eq, "=="), (operator.ne, "!="),
):  # fmt: skip
    _define(_function, mask, PAIRS, _comparison(_name))
for _function, _name in ((operator.and_, "and_"), (operator.or_, "or_"), (operator.xor, "xor")):
    _define(_function, mask, [(mask, mask)], _instruction(_name))
_define(operator.invert, mask, [(mask,)], _instruction("not_"))
_define(operator.neg, lanes, [(lanes,)], _instruction("fneg"))
_define(operator.pos, lanes, [(lanes,)], lambda context, builder, value: value)
_define(min, lanes, PAIRS, _chosen("<"))
_define(max, lanes, PAIRS, _chosen(">"))
_define(abs, lanes, [(lanes,)], _intrinsic("fabs"))
_define(math.fabs, lanes, [(lanes,)], _intrinsic("fabs"))
_define(math.sqrt, lanes, [(lanes,)], _intrinsic("sqrt"))
_define(math.copysign, lanes, PAIRS, _intrinsic("copysign"))
for _function in (
    math.exp, math.expm1, math.log, math.log1p, math.sin, math.cos, math.tan, math.sinh, math.cosh, math.tanh,
    math.asin, math.acos, math.atan,
):  # fmt: skip
    _define(_function, lanes, [(lanes,)], _lane_by_lane(_function))
for _function in (operator.pow, math.pow, math.atan2, math.hypot):
    _define(_function, lanes, PAIRS, _lane_by_lane(_function))


@intrinsic
def _select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    """Return one of two values in each lane."""
    if condition != mask:
        return None

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        return builder.select(*values)

    return lanes(mask, lanes, lanes), emit


@overload(where)
def _where(condition, yes, no):  # type: ignore[no-untyped-def]
    if condition == mask:
        return lambda condition, yes, no: _select(condition, yes, no)
    return lambda condition, yes, no: yes if condition else no


@intrinsic
def rounded(typingctx: Any, value: Any) -> Any:
    """Return the nearest whole numbers, halves to even."""

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        kind = VECTOR if value == lanes else ir.DoubleType()
        suffix = f"v{WIDTH}f64" if value == lanes else "f64"
        made = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), f"llvm.rint.{suffix}")
        return builder.call(made, values)

    return value(value), emit


@intrinsic
def all_within(typingctx: Any, value: Any, limit: Any) -> Any:
    """Return whether the magnitude of every lane is below a limit; that of a NaN is not."""

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        size = _intrinsic("fabs")(context, builder, values[0])
        inside = builder.fcmp_ordered("<", size, _fill(builder, values[1]))
        number = builder.bitcast(inside, ir.IntType(WIDTH))
        return builder.icmp_unsigned("==", number, ir.Constant(ir.IntType(WIDTH), 2**WIDTH - 1))

    return types.boolean(lanes, types.float64), emit


@intrinsic
def taken_at(typingctx: Any, numbers: Any, places: Any, offset: Any) -> Any:
    """Return numbers[places[lane] + offset] for each lane, in registers: numbers written one by one are waited for.

    The numbers and the places are given by their addresses.
    """

    def emit(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        source = builder.inttoptr(values[0], ir.DoubleType().as_pointer())
        index = builder.inttoptr(values[1], ir.IntType(64).as_pointer())
        result = ir.Constant(VECTOR, ir.Undefined)
        for lane in range(WIDTH):
            at = ir.Constant(ir.IntType(32), lane)
            place = builder.add(builder.load(builder.gep(index, [at])), values[2])
            result = builder.insert_element(result, builder.load(builder.gep(source, [place])), at)
        return result

    return lanes(types.int64, types.int64, types.int64), emit


# rows of arrays


@infer_getattr
class _RowsAttributes(AttributeTemplate):
    key = RowsType

    def resolve_size(self, value: Any) -> types.Type:
        return types.intp


@lower_getattr(RowsType, "size")
def _size(context: Any, builder: Any, typ: Any, value: Any) -> Any:
    return cgutils.create_struct_proxy(typ)(context, builder, value=value).size


@infer_global(len)
class _Length(ConcreteTemplate):
    cases = tuple(signature(types.intp, kind) for kind in (rows, bare))


@lower_builtin(len, RowsType)
def _length(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    return _size(context, builder, sig.args[0], values[0])


def _address(context: Any, builder: Any, kind: RowsType, value: Any, index: Any) -> Any:
    """Return where a row lies."""
    view = cgutils.create_struct_proxy(kind)(context, builder, value=value)
    if kind.wraps:
        negative = builder.icmp_signed("<", index, ir.Constant(index.type, 0))
        index = builder.select(negative, builder.add(index, view.size), index)
    place = builder.gep(view.data, [builder.mul(index, ir.Constant(index.type, WIDTH))])
    return builder.bitcast(place, VECTOR.as_pointer())


@infer_global(operator.getitem)
class _GetItem(ConcreteTemplate):
    cases = (
        signature(lanes, rows, types.intp),
        signature(lanes, bare, types.intp),
        signature(rows, rows, types.slice2_type),
        signature(rows, bare, types.slice2_type),
    )


@infer_global(operator.setitem)
class _SetItem(ConcreteTemplate):
    cases = tuple(
        signature(types.none, kind, types.intp, value)
        for kind, value in (
            (rows, lanes),
            (rows, types.float64),
            (bare, lanes),
            (bare, types.float64),
        )
    )


@lower_builtin(operator.getitem, RowsType, types.intp)
def _get(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    return builder.load(_address(context, builder, sig.args[0], *values), align=ALIGNED)


@lower_builtin(operator.setitem, RowsType, types.intp, LanesType)
@lower_builtin(operator.setitem, RowsType, types.intp, types.float64)
def _set(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    array, index, value = values
    vector = value if sig.args[2] == lanes else _fill(builder, value)
    builder.store(vector, _address(context, builder, sig.args[0], array, index), align=ALIGNED)
    return context.get_dummy_value()


@lower_builtin(operator.getitem, RowsType, types.slice2_type)
def _slice(context: Any, builder: Any, sig: Any, values: Any) -> Any:
    part = context.make_helper(builder, types.slice2_type, values[1])
    view = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=values[0])
    zero = ir.Constant(part.start.type, 0)

    def clipped(bound: Any) -> Any:
        bound = builder.select(builder.icmp_signed("<", bound, zero), builder.add(bound, view.size), bound)
        return builder.select(builder.icmp_signed(">", bound, view.size), view.size, bound)

    start, stop = clipped(part.start), clipped(part.stop)
    made = cgutils.create_struct_proxy(rows)(context, builder)
    made.data = builder.gep(view.data, [builder.mul(start, ir.Constant(start.type, WIDTH))])
    made.size = builder.sub(stop, start)
    return made._getvalue()
