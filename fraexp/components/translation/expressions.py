"""Expressions of the subset of Python in which friction laws are written, translated to a syntax tree."""

import ast
import builtins
import inspect
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from fraexp.components.translation.syntax_tree import (
    Assignment,
    Branch,
    Element,
    Expression,
    FunctionCall,
    LibraryCall,
    Number,
    Operation,
    Statement,
    Type,
    Variable,
)
from fraexp.kernels.choice import where

REAL_FUNCTIONS = ("exp", "expm1", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "tanh", "copysign", "pow")
"""Functions of `math` that take and return real numbers."""
NUMPY_FUNCTIONS = {
    "exp": "exp", "expm1": "expm1", "log": "log", "sqrt": "sqrt", "sin": "sin", "cos": "cos", "tan": "tan",
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "tanh": "tanh", "copysign": "copysign", "power": "pow",
    "minimum": "min", "maximum": "max", "abs": "abs", "where": "choose",
}  # fmt: skip
"""Functions of numpy, of single numbers, and their names in the syntax tree."""
KNOWN_FUNCTIONS: dict[Callable[..., Any], str] = {
    builtins.min: "min",
    builtins.max: "max",
    builtins.abs: "abs",
    math.fabs: "abs",
    builtins.float: "real",
    builtins.int: "truncate",
    builtins.len: "length",
    where: "choose",
    **{getattr(math, name): name for name in REAL_FUNCTIONS},
    **{getattr(np, name): known for name, known in NUMPY_FUNCTIONS.items()},
}


@dataclass(frozen=True)
class ArrayView:
    """A part of an array that the caller provides, or the whole of it."""

    array: str
    offset: int
    size: int
    whole_size: int
    """Size of the array that it is a part of."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known when a function is translated: a number, array, tuple, function or module."""

    value: Any


Value = Expression | ArrayView | Known


class UntranslatableError(Exception):
    """A node that cannot be translated, what was found, and what is expected."""

    def __init__(self, node: ast.AST, found: str, expected: str) -> None:
        super().__init__(found)
        self.node, self.found, self.expected = node, found, expected


class Surroundings(Protocol):
    """What an expression needs of the function that it is part of; see `StatementTranslator`."""

    def value(self, name: str) -> Value:
        """Return what a name stands for; KeyError if it is unknown."""
        ...

    def temporary(self, kind: Type) -> Variable:
        """Return a new variable."""
        ...

    def emit(self, statement: Statement) -> None:
        """Add a statement."""
        ...

    def block(self, translate: Callable[[], None]) -> tuple[Statement, ...]:
        """Return the statements that `translate` adds."""
        ...

    def table(self, name: str, values: object) -> str:
        """Return the name of a table with these values."""
        ...

    def call(self, function: Callable[..., Any], given: Sequence[Value], node: ast.AST) -> FunctionCall:
        """Return the call of another function of Python."""
        ...


ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.Pow: ("**", operator.pow),
    ast.BitAnd: ("and", operator.and_),
    ast.BitOr: ("or", operator.or_),
}
COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip


class ExpressionTranslator:
    """Translates the expressions of one function; what is known is computed at once."""

    def __init__(self, function: Surroundings) -> None:
        self._function = function

    # An expression as a number of a type.

    def real(self, node: ast.expr) -> Expression:
        """Return an expression as a real number."""
        return self.as_real(self.number(self.value(node), node))

    def truth(self, node: ast.expr) -> Expression:
        """Return an expression that must be a truth value."""
        found = self.number(self.value(node), node)
        if found.type == "bool":
            return found
        return Operation("!=", (found, Number(0 if found.type == "int" else 0.0, found.type)), "bool")

    def whole(self, node: ast.expr) -> Expression:
        """Return an expression that must be a whole number."""
        found = self.number(self.value(node), node)
        if found.type != "int":
            raise UntranslatableError(node, f"needs a whole number for {ast.unparse(node)}", "take int(...)")
        return found

    def number(self, value: Value, node: ast.AST) -> Expression:
        """Return a value that must be a number or a truth value."""
        if isinstance(value, ArrayView):
            raise UntranslatableError(node, "computes with a whole array", "loop over its elements")
        if not isinstance(value, Known):
            return value
        if isinstance(value.value, bool | np.bool_):
            return Number(bool(value.value), "bool")
        if isinstance(value.value, int | np.integer):
            return Number(int(value.value), "int")
        if isinstance(value.value, float | np.floating):
            return Number(float(value.value), "real")
        raise UntranslatableError(node, f"uses {type(value.value).__name__} as a number", "use numbers")

    def as_real(self, value: Expression) -> Expression:
        """Return a number as a real one."""
        return self.converted(value, "real")

    def converted(self, value: Expression, kind: Type) -> Expression:
        """Return a number in a type that can hold it."""
        if value.type == kind:
            return value
        if isinstance(value, Number):
            return Number(float(value.value), "real")
        return LibraryCall("real", (value,))

    # Kinds of expression.

    def value(self, node: ast.expr) -> Value:
        """Return what an expression is, known or not."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise UntranslatableError(node, f"uses {ast.unparse(node)}", "expected numbers, operators and calls")
        found: Value = method(node)
        return found

    def is_range(self, node: ast.expr) -> bool:
        """Return whether an expression is Python's `range`."""
        found = self.value(node)
        return isinstance(found, Known) and found.value is range

    def _constant(self, node: ast.Constant) -> Value:
        if not isinstance(node.value, int | float):
            raise UntranslatableError(node, f"uses {node.value!r}", "use numbers")
        return Known(node.value)

    def _name(self, node: ast.Name) -> Value:
        try:
            return self._function.value(node.id)
        except KeyError:
            raise UntranslatableError(node, f"uses '{node.id}', which is not defined", "define it before") from None

    def _tuple(self, node: ast.Tuple) -> Value:
        parts = [self.value(part) for part in node.elts]
        if not all(isinstance(part, Known) for part in parts):
            raise UntranslatableError(node, f"uses {ast.unparse(node)}", "group what is known in advance only")
        return Known(tuple(part.value for part in parts if isinstance(part, Known)))

    def _attribute(self, node: ast.Attribute) -> Value:
        owner = self.value(node.value)
        size = owner.size if isinstance(owner, ArrayView) else None
        if isinstance(owner, Known) and isinstance(owner.value, np.ndarray):
            size = owner.value.size
        if size is not None and node.attr == "size":
            return Known(size)
        if isinstance(owner, Known) and inspect.ismodule(owner.value) and hasattr(owner.value, node.attr):
            return Known(getattr(owner.value, node.attr))
        raise UntranslatableError(node, f"uses {ast.unparse(node)}", "of arrays only .size is known")

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.slice, ast.Slice):
            return self._slice(node, node.slice)
        owner = self.value(node.value)
        if isinstance(owner, Known) and isinstance(owner.value, tuple):
            index = self.value(node.slice)
            if isinstance(index, Known):
                return Known(owner.value[index.value])
        return self.element(node)

    def _slice(self, node: ast.Subscript, part: ast.Slice) -> Value:
        owner = self.value(node.value)
        bounds = [self.value(bound) if bound else Known(None) for bound in (part.lower, part.upper, part.step)]
        if not isinstance(owner, ArrayView | Known) or not all(isinstance(bound, Known) for bound in bounds):
            raise UntranslatableError(node, f"takes the part {ast.unparse(node)}", "take constant bounds")
        cut = slice(*(bound.value for bound in bounds if isinstance(bound, Known)))
        if isinstance(owner, Known):
            return Known(owner.value[cut])
        start, stop, step = cut.indices(owner.size)
        if step != 1:
            raise UntranslatableError(node, f"takes the part {ast.unparse(node)}", "take neighbouring elements")
        return replace(owner, offset=owner.offset + start, size=max(stop - start, 0))

    def element(self, node: ast.Subscript) -> Element:
        """Return an element of an array."""
        if isinstance(node.slice, ast.Slice):
            raise UntranslatableError(node, "writes to a part of an array", "write its elements in a loop")
        owner = self.value(node.value)
        if isinstance(owner, ArrayView):
            return Element(owner.array, self._index(node, owner.offset, owner.size))
        if isinstance(owner, Known) and isinstance(owner.value, np.ndarray) and owner.value.ndim == 1:
            name = node.value.id if isinstance(node.value, ast.Name) else "table"
            index = self._index(node, 0, owner.value.size)
            return Element(self._function.table(name, owner.value), index)
        raise UntranslatableError(node, f"uses {ast.unparse(node)}", "take elements of arrays with one axis")

    def _index(self, node: ast.Subscript, offset: int, size: int) -> Expression:
        if isinstance(node.slice, ast.Tuple):
            raise UntranslatableError(node, f"uses {ast.unparse(node)}", "take arrays with one axis")
        index = self.whole(node.slice)
        if isinstance(index, Number):
            place = int(index.value) + (size if index.value < 0 else 0)
            if not 0 <= place < size:
                raise UntranslatableError(node, f"uses {ast.unparse(node)} of {size} elements", "stay within it")
            return Number(place + offset, "int")
        if any(isinstance(part, ast.Sub | ast.USub) for part in ast.walk(node.slice)):
            index = LibraryCall("wrap", (index, Number(size, "int")), "int")  # Python counts from the end
        return Operation("+", (Number(offset, "int"), index), "int") if offset else index

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        operand = self.value(node.operand)
        if isinstance(node.op, ast.Not | ast.Invert):
            test = self.truth(node.operand)
            return Known(not test.value) if isinstance(test, Number) else Operation("not", (test,), "bool")
        if isinstance(operand, Known) and isinstance(operand.value, int | float):
            return Known(-operand.value if isinstance(node.op, ast.USub) else operand.value)
        number = self.number(operand, node)
        return Operation("negate", (number,), number.type) if isinstance(node.op, ast.USub) else number

    def _binop(self, node: ast.BinOp) -> Value:
        if type(node.op) not in ARITHMETIC:
            raise UntranslatableError(node, f"uses {ast.unparse(node)}", "expected + - * / ** & |")
        sign, compute = ARITHMETIC[type(node.op)]
        first, second = self.value(node.left), self.value(node.right)
        if isinstance(first, Known) and isinstance(second, Known):
            return Known(compute(first.value, second.value))
        return self._combined(sign, self.number(first, node), self.number(second, node), node)

    def _combined(self, sign: str, first: Expression, second: Expression, node: ast.AST) -> Expression:
        types = {first.type, second.type}
        if (sign in ("and", "or")) != ("bool" in types) or ("bool" in types and len(types) > 1):
            raise UntranslatableError(node, "mixes numbers and truth values", "choose numbers by where(...)")
        if "bool" in types:
            return Operation(sign, (first, second), "bool")
        if sign == "**":
            return LibraryCall("pow", (self.as_real(first), self.as_real(second)))
        if sign == "/" or "real" in types:
            return Operation(sign, (self.as_real(first), self.as_real(second)), "real")
        return Operation(sign, (first, second), "int")

    def _compare(self, node: ast.Compare) -> Value:
        parts = [self.value(part) for part in (node.left, *node.comparators)]
        found: Expression | None = None
        for sign, left, right in zip(node.ops, parts[:-1], parts[1:], strict=True):
            if type(sign) not in COMPARISONS:
                raise UntranslatableError(node, f"uses {ast.unparse(node)}", "compare numbers")
            pair = self._pair(self.number(left, node), self.number(right, node))
            one = Operation(COMPARISONS[type(sign)], pair, "bool")
            found = one if found is None else Operation("and", (found, one), "bool")
        if all(isinstance(part, Known) for part in parts):
            values = {f"v{k}": part.value for k, part in enumerate(parts) if isinstance(part, Known)}
            names = [ast.Name(name, ast.Load()) for name in values]
            tree = ast.fix_missing_locations(ast.Expression(ast.Compare(names[0], node.ops, list(names[1:]))))
            return Known(bool(eval(compile(tree, "<known>", "eval"), {}, values)))
        assert found is not None
        return found

    def _pair(self, first: Expression, second: Expression) -> tuple[Expression, Expression]:
        if first.type == second.type:
            return first, second
        return self.as_real(first), self.as_real(second)

    def _boolop(self, node: ast.BoolOp) -> Value:
        """The later operands are computed only if they matter, as in Python: ST may compute both sides of an AND."""
        result = self._function.temporary("bool")
        self._function.emit(Assignment(result, self.truth(node.values[0])))
        is_and = isinstance(node.op, ast.And)
        for operand in node.values[1:]:

            def translate(operand: ast.expr = operand) -> None:
                self._function.emit(Assignment(result, self.truth(operand)))

            test: Expression = result if is_and else Operation("not", (result,), "bool")
            self._function.emit(Branch(test, self._function.block(translate), ()))
        return result

    def _ifexp(self, node: ast.IfExp) -> Value:
        """Only the value that is chosen is computed."""
        test = self.truth(node.test)
        if isinstance(test, Number):
            return self.value(node.body if test.value else node.orelse)
        result = self._function.temporary("real")

        def branch(value: ast.expr) -> Callable[[], None]:
            return lambda: self._function.emit(Assignment(result, self.real(value)))

        blocks = self._function.block(branch(node.body)), self._function.block(branch(node.orelse))
        self._function.emit(Branch(test, *blocks))
        return result

    def _call(self, node: ast.Call) -> Value:
        called = self.value(node.func)
        if not isinstance(called, Known) or not callable(called.value):
            raise UntranslatableError(node, f"calls {ast.unparse(node.func)}", "call functions of Python")
        if node.keywords:
            raise UntranslatableError(node, "calls with named arguments", "give them by their order")
        arguments = self._arguments(node)
        try:
            known = KNOWN_FUNCTIONS.get(called.value)
        except TypeError:
            known = None
        if known is not None:
            return self._library_call(known, called.value, arguments, node)
        if inspect.isfunction(getattr(called.value, "py_func", called.value)):
            return self._function.call(called.value, arguments, node)
        raise UntranslatableError(node, f"calls {ast.unparse(node.func)}", "see the list of functions in the docs")

    def _arguments(self, node: ast.Call) -> list[Value]:
        found: list[Value] = []
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                given = self.value(argument.value)
                if not isinstance(given, Known) or not isinstance(given.value, tuple):
                    raise UntranslatableError(node, f"calls with {ast.unparse(argument)}", "give each argument")
                found += [Known(part) for part in given.value]
            else:
                found.append(self.value(argument))
        return found

    def _library_call(self, known: str, function: Callable[..., Any], given: Sequence[Value], node: ast.Call) -> Value:
        if all(isinstance(argument, Known) for argument in given):
            return Known(function(*(argument.value for argument in given if isinstance(argument, Known))))
        if known == "length":
            return Known(given[0].size) if isinstance(given[0], ArrayView) else self._no_length(node)
        numbers = [self.number(argument, node) for argument in given]
        match known:
            case "min" | "max":
                found = self._extreme(known, numbers)
            case "choose":
                found = LibraryCall("choose", (self._test(numbers[0], node), *map(self.as_real, numbers[1:])))
            case "real":
                found = self.as_real(numbers[0])
            case "truncate":
                is_whole = numbers[0].type == "int"
                found = numbers[0] if is_whole else LibraryCall("truncate", tuple(numbers), "int")
            case _:
                found = LibraryCall(known, tuple(self.as_real(number) for number in numbers))
        return found

    def _test(self, condition: Expression, node: ast.Call) -> Expression:
        if condition.type != "bool":
            raise UntranslatableError(node, "chooses by a number", "compare it first")
        return condition

    def _extreme(self, known: str, given: Sequence[Expression]) -> Expression:
        is_whole = all(number.type == "int" for number in given)
        numbers = given if is_whole else [self.as_real(number) for number in given]
        found = numbers[0]
        for number in numbers[1:]:
            found = LibraryCall(known, (found, number), number.type)
        return found

    def _no_length(self, node: ast.Call) -> Value:
        raise UntranslatableError(node, f"takes {ast.unparse(node)}", "take the length of an array")
