"""Numbers side by side in vector registers: in compiled code a law computes one machine, or 8 or 16 at once.

A value of lanes is a vector of doubles; a row of a float64 array of shape (n, width) holds one. A law written with
arithmetic, comparisons inside `where`, min, max, abs and functions of `math` compiles for both; one that branches on
its values does not compile for lanes, because these could disagree, and runs in the scalar kernel.
"""

import math
import operator
from collections.abc import Callable, MutableSequence, Sequence
from typing import TypeAlias

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.base import BaseContext
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import ConcreteTemplate, Signature, infer_global, signature
from numba.extending import models, overload, register_model

from fraexp.kernels.choice import where
from fraexp.kernels.decorators import Emitter, Intrinsic, intrinsic

NARROW, WIDE = 8, 16
"""Lanes of a vector. One of 16 fills two registers of the widest kind: while a sum waits for its last term in one, the
other is computed."""
LaneValue: TypeAlias = float
"""A number of one machine, or lanes of it: the same source is compiled for both."""
LaneRows: TypeAlias = MutableSequence[float]
"""Numbers of one machine, or rows of lanes."""


class LanesType(types.Type):
    """Doubles side by side."""

    def __init__(self, width: int) -> None:
        super().__init__(f"lanes({width})")
        self.width = width
        self.vector = ir.VectorType(ir.DoubleType(), width)

    def can_convert_from(self, typingctx: object, other: types.Type) -> Conversion | None:
        """Any number can fill all lanes."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None

    def unify(self, typingctx: object, other: types.Type) -> types.Type | None:
        """A variable that is a number at first and lanes later is lanes."""
        return self if isinstance(other, types.Float | types.Integer) else None


class MaskType(types.Type):
    """Truth values side by side: the result of comparing lanes."""

    def __init__(self, width: int) -> None:
        super().__init__(f"mask({width})")
        self.vector = ir.VectorType(ir.IntType(1), width)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: LanesType) -> None:
        super().__init__(manager, fe_type, fe_type.vector)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: object, fe_type: MaskType) -> None:
        super().__init__(manager, fe_type, fe_type.vector)


def broadcast(builder: ir.IRBuilder, value: ir.Value, vector: ir.VectorType) -> ir.Value:
    """Return a vector whose lanes all have one value: it is put into the first lane, and shuffled into all."""
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    from_first = ir.Constant(ir.VectorType(ir.IntType(32), vector.count), [0] * vector.count)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), from_first)


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _cast_number(
    context: BaseContext, builder: ir.IRBuilder, fromty: types.Type, toty: LanesType, value: ir.Value
) -> ir.Value:
    return broadcast(builder, context.cast(builder, value, fromty, types.float64), toty.vector)


# arithmetic and comparisons


def _define_operation(
    function: Callable[..., object], result: types.Type, operands: Sequence[tuple[types.Type, ...]], emit: Emitter
) -> None:
    """Teach the compiler a Python function of lanes: `emit` builds it from vectors, for each set of operand types."""

    class Template(ConcreteTemplate):
        cases = tuple(signature(result, *kinds) for kinds in operands)

    infer_global(function)(Template)
    for kinds in operands:

        def lower(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
            vectors = [
                broadcast(builder, value, _operand_vector(sig)) if kind == types.float64 else value
                for kind, value in zip(sig.args, values, strict=True)
            ]
            return emit(context, builder, *vectors)

        lower_builtin(function, *kinds)(lower)


def _operand_vector(sig: Signature) -> ir.VectorType:
    """Return the vector type of an operation's lanes."""
    return next(kind.vector for kind in sig.args if isinstance(kind, LanesType))


def _instruction(name: str) -> Emitter:
    """Return the emitter of one LLVM instruction."""
    return lambda context, builder, *vectors: getattr(builder, name)(*vectors)


def _comparison(sign: str) -> Emitter:
    """Return the emitter of a comparison; as in Python, any with a NaN is false, but != is true."""
    ordered = "fcmp_unordered" if sign == "!=" else "fcmp_ordered"
    return lambda context, builder, a, b: getattr(builder, ordered)(sign, a, b)


def _llvm_function(name: str) -> Emitter:
    """Return the emitter of a function that LLVM itself has for vectors."""

    def emit(context: BaseContext, builder: ir.IRBuilder, *vectors: ir.Value) -> ir.Value:
        vector = vectors[0].type
        kind = ir.FunctionType(vector, [vector] * len(vectors))
        function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{vector.count}f64")
        return builder.call(function, vectors)

    return emit


def _smaller_or_larger(sign: str) -> Emitter:
    """Return the emitter of min ("<") or max (">"): of equal values, or a NaN, the first is kept, as Python does."""
    return lambda context, builder, a, b: builder.select(builder.fcmp_ordered(sign, b, a), b, a)


def _lane_by_lane(function: Callable[..., float]) -> Emitter:
    """Return the emitter of a scalar function called once per lane: the result has the bits that scalars have."""

    def emit(context: BaseContext, builder: ir.IRBuilder, *vectors: ir.Value) -> ir.Value:
        scalar = signature(types.float64, *[types.float64] * len(vectors))
        call = context.get_function(function, scalar)
        result = ir.Constant(vectors[0].type, ir.Undefined)
        for lane in range(vectors[0].type.count):
            at = ir.Constant(ir.IntType(32), lane)
            value = call(builder, [builder.extract_element(vector, at) for vector in vectors])
            result = builder.insert_element(result, value, at)
        return result

    return emit


def _define_operations(lanes: LanesType, mask: MaskType) -> None:
    """Teach the compiler all that laws may do with lanes of one width."""
    pairs = [(lanes, lanes), (lanes, types.float64), (types.float64, lanes)]
    for name, functions in {
        "fadd": (operator.add, operator.iadd),
        "fsub": (operator.sub, operator.isub),
        "fmul": (operator.mul, operator.imul),
        "fdiv": (operator.truediv, operator.itruediv),
    }.items():
        for function in functions:
            _define_operation(function, lanes, pairs, _instruction(name))
    for function, name in (
        (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
        (operator.eq, "=="), (operator.ne, "!="),
    ):  # fmt: skip
        _define_operation(function, mask, pairs, _comparison(name))
    for function, name in ((operator.and_, "and_"), (operator.or_, "or_"), (operator.xor, "xor")):
        _define_operation(function, mask, [(mask, mask)], _instruction(name))
    _define_operation(operator.invert, mask, [(mask,)], _instruction("not_"))
    _define_operation(operator.neg, lanes, [(lanes,)], _instruction("fneg"))
    _define_operation(operator.pos, lanes, [(lanes,)], lambda context, builder, value: value)
    _define_operation(min, lanes, pairs, _smaller_or_larger("<"))
    _define_operation(max, lanes, pairs, _smaller_or_larger(">"))
    _define_operation(abs, lanes, [(lanes,)], _llvm_function("fabs"))
    _define_operation(math.fabs, lanes, [(lanes,)], _llvm_function("fabs"))
    _define_operation(math.sqrt, lanes, [(lanes,)], _llvm_function("sqrt"))
    _define_operation(math.copysign, lanes, pairs, _llvm_function("copysign"))
    for scalar_function in (
        math.exp, math.expm1, math.log, math.log1p, math.sin, math.cos, math.tan, math.sinh, math.cosh, math.tanh,
        math.asin, math.acos, math.atan,
    ):  # fmt: skip
        _define_operation(scalar_function, lanes, [(lanes,)], _lane_by_lane(scalar_function))
    for pair_function in (operator.pow, math.pow, math.atan2, math.hypot):
        _define_operation(pair_function, lanes, pairs, _lane_by_lane(pair_function))


for _width in (NARROW, WIDE):
    _define_operations(LanesType(_width), MaskType(_width))


@intrinsic
def _select(typingctx: object, condition: types.Type, yes: types.Type, no: types.Type) -> Intrinsic:
    """Return one of two values in each lane."""
    if not isinstance(condition, MaskType):
        return None
    lanes = LanesType(condition.vector.count)

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        chosen, if_true, if_false = values
        return builder.select(chosen, if_true, if_false)

    return lanes(condition, lanes, lanes), emit


# numba wants the parameters of both functions to be equal, annotations included, and a lambda can have none
@overload(where)
def _where(condition, yes, no):  # type: ignore[no-untyped-def]
    if isinstance(condition, MaskType):
        return lambda condition, yes, no: _select(condition, yes, no)
    return lambda condition, yes, no: yes if condition else no


@intrinsic
def round_half_even(typingctx: object, value: types.Type) -> Intrinsic:
    """Return the nearest whole numbers, halves to even."""

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        kind, suffix = ir.DoubleType(), "f64"
        if isinstance(value, LanesType):
            kind, suffix = value.vector, f"v{value.width}f64"
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind]), f"llvm.rint.{suffix}")
        return builder.call(function, values)

    return value(value), emit


@intrinsic
def all_within(typingctx: object, value: types.Type, limit: types.Type) -> Intrinsic:
    """Return whether the magnitude of every lane is below a limit; that of a NaN is not."""

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        vector, bound = values
        magnitude = _llvm_function("fabs")(context, builder, vector)
        inside = builder.fcmp_ordered("<", magnitude, broadcast(builder, bound, vector.type))
        number = ir.IntType(vector.type.count)  # truth values as one whole number: one comparison for all
        return builder.icmp_unsigned("==", builder.bitcast(inside, number), ir.Constant(number, 2**number.width - 1))

    return types.boolean(value, types.float64), emit


def lane_gatherer(width: int) -> Callable[[int, int, int], LaneValue]:
    """Return a compiled function of three integers: addresses of numbers and of indices, and an offset.

    It returns numbers[indices[lane] + offset] for each lane. The vector is put together in registers. Written to memory
    number by number and loaded as a vector, it would stall: the processor cannot forward several narrow stores to one
    wide load, and waits until they are in the cache.
    """
    kind = LanesType(width)

    def emit(context: BaseContext, builder: ir.IRBuilder, sig: Signature, values: Sequence[ir.Value]) -> ir.Value:
        numbers_address, indices_address, shift = values
        source = builder.inttoptr(numbers_address, ir.DoubleType().as_pointer())
        index = builder.inttoptr(indices_address, ir.IntType(64).as_pointer())
        result = ir.Constant(kind.vector, ir.Undefined)
        for lane in range(width):
            at = ir.Constant(ir.IntType(32), lane)
            place = builder.add(builder.load(builder.gep(index, [at])), shift)
            result = builder.insert_element(result, builder.load(builder.gep(source, [place])), at)
        return result

    def gather_lanes(typingctx: object, numbers: types.Type, indices: types.Type, offset: types.Type) -> Intrinsic:
        return kind(types.int64, types.int64, types.int64), emit

    return intrinsic(gather_lanes)
