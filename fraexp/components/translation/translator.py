"""Functions of the subset of Python in which friction laws are written, translated to another language.

What is known when a function is translated, such as the parameters of a law, becomes part of it: sizes are numbers,
and a law that calls others, as a composite does, calls the functions that these became.
"""

import ast
import builtins
import inspect
import math
import operator
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.translation.language import (
    Constant,
    Expression,
    Function,
    Language,
    Text,
    Type,
    Variable,
    safe_names,
)
from fraexp.errors import PluginError
from fraexp.kernels.choice import where

REAL_FUNCTIONS = ("exp", "expm1", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "tanh", "copysign", "pow")
"""Functions of `math` that take and return real numbers."""
NUMPY_FUNCTIONS = {
    "exp": "exp", "expm1": "expm1", "log": "log", "sqrt": "sqrt", "sin": "sin", "cos": "cos", "tan": "tan",
    "arcsin": "asin", "arccos": "acos", "arctan": "atan", "tanh": "tanh", "copysign": "copysign", "power": "pow",
    "minimum": "min", "maximum": "max", "abs": "abs", "where": "choose",
}  # fmt: skip
"""Functions of numpy, of single numbers, and what languages are asked for (see `Language.library_call`)."""
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
ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.Pow: ("**", operator.pow),
    ast.BitAnd: ("and", operator.and_),
    ast.BitOr: ("or", operator.or_),
}
COMPARISONS: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], bool]]] = {
    ast.Lt: ("<", operator.lt), ast.LtE: ("<=", operator.le), ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge), ast.Eq: ("==", operator.eq), ast.NotEq: ("!=", operator.ne),
}  # fmt: skip
SUBSET = "expected assignments, if, for over a range, and return, of numbers and elements of arrays"
REMEDIES: dict[type[ast.stmt], str] = {ast.While: "its time is not bounded: loop over a range, and leave it by break"}
REAL_INPUT = object()
"""Stands for an argument that is a real number which changes from call to call."""
MAX_PASSES = 6
"""Passes in which the types of variables are found, as a whole number may become a real one, and their names."""


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


class _UntranslatableError(Exception):
    """A node that cannot be translated, what was found, and what is expected."""

    def __init__(self, node: ast.AST, found: str, expected: str) -> None:
        super().__init__(found)
        self.node, self.found, self.expected = node, found, expected


class _FunctionSource:
    """The source of a function, with the values of the names that it uses from outside."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = getattr(function, "py_func", function)
        try:
            lines, first = inspect.getsourcelines(self.function)
            definition = ast.parse(textwrap.dedent("".join(lines))).body[0]
        except (OSError, TypeError, SyntaxError):
            raise PluginError(f"{function!r:.60}: the source is not available; expected a function in a file") from None
        self.file, self._before = Path(inspect.getfile(self.function)).name, first - 1
        if not isinstance(definition, ast.FunctionDef):
            raise self.fault(definition, "is no plain function", "define it by def")
        self.definition = definition
        self.parameters = [argument.arg for argument in definition.args.args]
        closure = inspect.getclosurevars(self.function)
        self.outside: dict[str, object] = {**closure.builtins, **closure.globals, **closure.nonlocals}

    @property
    def summary(self) -> str:
        """First line of the documentation, or else the function's name."""
        return (inspect.getdoc(self.function) or self.definition.name.strip("_")).splitlines()[0]

    def fault(self, node: ast.AST, found: str, expected: str) -> PluginError:
        """Return the error about a node that cannot be translated."""
        line = self._before + getattr(node, "lineno", 1)
        return PluginError(f"{self.definition.name} ({self.file}, line {line}) {found}; {expected}")


def translate(
    name: str,
    function: Callable[..., Any],
    arguments: Mapping[str, object],
    arrays: Mapping[str, int],
    language: Language,
) -> Function:
    """Return a function that is translated to a language for these arguments.

    Args:
        name: Name of the translated function.
        function: Pure function of numbers and arrays, which may write elements of the arrays.
        arguments: Value of each parameter that is no array: `REAL_INPUT`, or what it is in all calls: a number, an
            array or tuple of numbers, or a function.
        arrays: Size of each parameter that is an array which the caller provides.
        language: What prints its expressions and statements.

    PluginError names file and line of what cannot be translated.
    """
    values: dict[str, Value] = {array: ArrayView(array, 0, size, size) for array, size in arrays.items()}
    for parameter, value in arguments.items():
        values[parameter] = Variable(parameter, "real") if value is REAL_INPUT else Known(value)
    return _Specialisations(language).function(name, function, values)


class _Specialisations:
    """The functions translated so far, each for what is known of its arguments."""

    def __init__(self, language: Language) -> None:
        self.language = language
        self._functions: list[tuple[Callable[..., Any], Mapping[str, Value], Function]] = []
        self._open: list[Callable[..., Any]] = []
        """Functions whose translation has begun."""

    def function(self, name: str, function: Callable[..., Any], values: Mapping[str, Value]) -> Function:
        """Return the translation of a function for these values, which may have been made before."""
        source = _FunctionSource(function)
        if function in self._open:
            raise source.fault(source.definition, "calls itself", "its time is not bounded: loop over a range")
        for known, given, translated in self._functions:
            if known is function and all(_is_same(given[name], values[name]) for name in given):
                return translated
        names = [translated.name for _, _, translated in self._functions]
        unique = next(each for each in (name, *(f"{name}_{k}" for k in range(2, 999))) if each not in names)
        found = Function(unique, source.summary)
        self._functions.append((function, values, found))
        self._open.append(function)
        for _ in range(MAX_PASSES):
            before = (dict(found.variables), found.names)
            found.names = self.language.declared_names(found)
            _FunctionTranslator(source, found, values, self).translate()
            if (found.variables, self.language.declared_names(found)) == before:
                self._open.pop()
                return found
        raise source.fault(source.definition, "has variables whose type cannot be determined", "give each one type")


def _is_same(first: Value, second: Value) -> bool:
    if isinstance(first, Known) and isinstance(second, Known):
        return _is_same_constant(first.value, second.value)
    return not isinstance(first, Known) and not isinstance(second, Known) and first == second


def _is_same_constant(first: object, second: object) -> bool:
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(_is_same_constant, first, second))
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    return first is second or (type(first) is type(second) and isinstance(first, int | float) and first == second)


class _FunctionTranslator:
    """Translates one function; what is known is computed at once."""

    def __init__(
        self, source: _FunctionSource, found: Function, values: Mapping[str, Value], others: _Specialisations
    ) -> None:
        self._source, self._found, self._others, self._language = source, found, others, others.language
        self._values = dict(values)
        self._written = Counter(_written_names(source.definition))
        self._loops: list[str] = []
        self._ended: set[str] = set()
        self._lines: list[str] = []
        self._temporaries = 0
        found.calls, found.tables, found.arrays, found.parameters = [], {}, {}, ()

    def translate(self) -> None:
        """Fill the function with what its source says."""
        found = self._found
        found.parameters = tuple(v for v in self._values.values() if isinstance(v, Variable))
        for name, value in list(self._values.items()):
            if isinstance(value, ArrayView):
                found.arrays = {**found.arrays, value.array: value.whole_size}
            elif isinstance(value, Known) and isinstance(value.value, float | np.floating):
                self._assign(name, Constant(float(value.value), "real"))  # a name says more than a number
            elif self._written[name]:
                self._assign(name, self._number(value, self._source.definition))
        self._translate_all(self._source.definition.body)
        found.body = self._lines

    def _print(self, expression: Expression) -> str:
        return self._language.text(self._found, expression)

    def _operation(self, sign: str, operands: Sequence[Expression], kind: Type) -> Text:
        return self._language.operation(self._found, sign, operands, kind)

    def _library(self, name: str, given: Sequence[Expression], kind: Type = "real") -> Text:
        return self._language.library_call(self._found, name, given, kind)

    def _temporary(self, kind: Type) -> Variable:
        """Return a new variable."""
        self._temporaries += 1
        name = f"part_{self._temporaries}"
        self._found.variables[name] = kind
        return Variable(name, kind)

    def _emit(self, target: Expression, value: Expression) -> None:
        """Add an assignment."""
        self._lines += self._language.assignment(self._print(target), self._print(value))

    def _block(self, translate: Callable[[], None]) -> list[str]:
        """Return the lines that `translate` adds."""
        outer, self._lines = self._lines, []
        translate()
        inner, self._lines = self._lines, outer
        return inner

    # Statements.

    def _translate_all(self, nodes: Sequence[ast.stmt]) -> None:
        for node in nodes:
            try:
                method = getattr(self, f"_translate_{type(node).__name__.lower()}", None)
                if method is None:
                    remedy = REMEDIES.get(type(node), SUBSET)
                    raise _UntranslatableError(node, f"uses '{type(node).__name__.lower()}'", remedy)
                method(node)
            except _UntranslatableError as error:
                raise self._source.fault(error.node, error.found, error.expected) from None

    def _translate_expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a documentation is none
            raise _UntranslatableError(node, "has an expression without effect", SUBSET)

    def _translate_pass(self, node: ast.Pass) -> None:
        """A statement without effect."""

    def _translate_break(self, node: ast.Break) -> None:
        self._lines += self._language.loop_exit("break")

    def _translate_continue(self, node: ast.Continue) -> None:
        self._lines += self._language.loop_exit("continue")

    def _translate_return(self, node: ast.Return) -> None:
        if node.value is None:
            raise _UntranslatableError(node, "returns nothing", "return a number")
        self._lines += self._language.return_value(self._found, self._print(self._real(node.value)))

    def _translate_assign(self, node: ast.Assign) -> None:
        for target in node.targets:
            self._assign_target(target, node.value, node)

    def _translate_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._assign_target(node.target, node.value, node)

    def _translate_augassign(self, node: ast.AugAssign) -> None:
        left = ast.copy_location(ast.parse(ast.unparse(node.target), mode="eval").body, node)
        for part in ast.walk(left):
            ast.copy_location(part, node)
        self._assign_target(node.target, ast.copy_location(ast.BinOp(left, node.op, node.value), node), node)

    def _assign_target(self, target: ast.expr, value: ast.expr, node: ast.stmt) -> None:
        if isinstance(target, ast.Tuple):
            self._unpack(target, value)
        elif isinstance(target, ast.Subscript):
            owner = self._value(target.value)
            element = self._element(target)
            if isinstance(owner, Known):
                raise _UntranslatableError(target, "writes to a constant", "write elements of the state only")
            self._emit(element, self._real(value))
        elif isinstance(target, ast.Name):
            self._bind(target.id, self._value(value), node)
        else:
            raise _UntranslatableError(node, f"writes {ast.unparse(target)}", SUBSET)

    def _unpack(self, target: ast.Tuple, value: ast.expr) -> None:
        names = [name.id for name in target.elts if isinstance(name, ast.Name)]
        found = [self._value(part) for part in value.elts] if isinstance(value, ast.Tuple) else None
        if found is None:
            known = self._value(value)
            found = [Known(part) for part in known.value] if isinstance(known, Known) else []
        if not len(names) == len(target.elts) == len(found):
            raise _UntranslatableError(target, f"unpacks {ast.unparse(value)}", "unpack as many values into names")
        held: list[Value] = []
        for each in found:  # all values are computed before a name is written
            if isinstance(each, Known | ArrayView):
                held.append(each)
                continue
            part = self._temporary(each.type)
            self._emit(part, each)
            held.append(part)
        for name, each in zip(names, held, strict=True):
            self._bind(name, each, target)

    def _bind(self, name: str, value: Value, node: ast.AST) -> None:
        """Let a name stand for a value: what is known and written once stays known, a number becomes a variable."""
        is_number = not isinstance(value, Known | ArrayView) or (
            isinstance(value, Known) and isinstance(value.value, int | float | np.floating)
        )
        is_size = isinstance(value, Known) and type(value.value) is int and self._written[name] == 1
        if is_number and not is_size:
            self._assign(name, self._number(value, self._source.definition))
        elif self._written[name] > 1:
            raise _UntranslatableError(node, f"gives '{name}' several arrays", "take a name for each")
        else:
            self._values[name] = value

    def _assign(self, name: str, value: Expression) -> None:
        before = self._found.variables.get(name, value.type)
        if before != value.type and {before, value.type} != {"int", "real"}:
            raise _UntranslatableError(
                self._source.definition, f"uses '{name}' for a number and a truth value", "take two names"
            )
        joined: Type = before if before == value.type else "real"
        self._ended.discard(name)
        if not isinstance(self._values.get(name), Variable):
            self._values.pop(name, None)
        if name not in (parameter.name for parameter in self._found.parameters):
            self._found.variables[name] = joined
        self._emit(Variable(name, joined), self._converted(value, joined))

    def _translate_if(self, node: ast.If) -> None:
        test = self._truth(node.test)
        if isinstance(test, Constant):
            return self._translate_all(node.body if test.value else node.orelse)
        body = self._block(lambda: self._translate_all(node.body))
        otherwise = self._block(lambda: self._translate_all(node.orelse))
        self._lines += self._language.branch(self._print(test), body, otherwise)

    def _translate_for(self, node: ast.For) -> None:
        call = node.iter
        looped = self._value(call.func) if isinstance(call, ast.Call) else None
        if node.orelse or not (isinstance(call, ast.Call) and isinstance(looped, Known) and looped.value is range):
            raise _UntranslatableError(node, f"loops over {ast.unparse(call)}", "loop over a range of whole numbers")
        counter = self._counter(node)
        start, stop, step = self._range([self._whole(bound) for bound in call.args], node)
        if not isinstance(stop, Constant):  # Python computes it once
            held = self._temporary("int")
            self._emit(held, stop)
            stop = held
        self._values.pop(counter, None)
        self._ended.discard(counter)
        self._found.variables[counter] = "int"
        self._loops.append(counter)
        body = self._block(lambda: self._translate_all(node.body))
        self._ended.add(self._loops.pop())
        name = self._print(Variable(counter, "int"))
        self._lines += self._language.loop(self._found, name, start, stop, step, body)

    def _counter(self, node: ast.For) -> str:
        """Return the variable of a loop; nothing else may write it, and its value ends with the loop."""
        name = node.target.id if isinstance(node.target, ast.Name) else ""
        if not name or name in self._loops or any(name in _written_names(part) for part in node.body):
            found = f"loops with {ast.unparse(node.target)}, which is written inside or outside of the loop"
            raise _UntranslatableError(node, found, "loop with a name of its own")
        return name

    def _range(self, bounds: Sequence[Expression], node: ast.For) -> tuple[Expression, Expression, int]:
        start = bounds[0] if len(bounds) > 1 else Constant(0, "int")
        stop = bounds[1] if len(bounds) > 1 else bounds[0]
        step = bounds[2] if len(bounds) > 2 else Constant(1, "int")
        if not isinstance(step, Constant) or step.value == 0:
            raise _UntranslatableError(node, "loops with a step that varies", "take a constant one")
        return start, stop, int(step.value)

    # An expression as a number of a type.

    def _real(self, node: ast.expr) -> Expression:
        return self._converted(self._number(self._value(node), node), "real")

    def _truth(self, node: ast.expr) -> Expression:
        found = self._number(self._value(node), node)
        if found.type == "bool":
            return found
        return self._operation("!=", (found, Constant(0 if found.type == "int" else 0.0, found.type)), "bool")

    def _whole(self, node: ast.expr) -> Expression:
        found = self._number(self._value(node), node)
        if found.type != "int":
            raise _UntranslatableError(node, f"needs a whole number for {ast.unparse(node)}", "take int(...)")
        return found

    def _number(self, value: Value, node: ast.AST) -> Expression:
        """Return a value that must be a number or a truth value."""
        if isinstance(value, ArrayView):
            raise _UntranslatableError(node, "computes with a whole array", "loop over its elements")
        if not isinstance(value, Known):
            return value
        if isinstance(value.value, bool | np.bool_):
            return Constant(bool(value.value), "bool")
        if isinstance(value.value, int | np.integer):
            return Constant(int(value.value), "int")
        if isinstance(value.value, float | np.floating):
            return Constant(float(value.value), "real")
        raise _UntranslatableError(node, f"uses {type(value.value).__name__} as a number", "use numbers")

    def _converted(self, value: Expression, kind: Type) -> Expression:
        """Return a number in a type that can hold it."""
        if value.type == kind:
            return value
        if isinstance(value, Constant):
            return Constant(float(value.value), "real")
        return self._library("real", (value,))

    def _value(self, node: ast.expr) -> Value:
        """Return what an expression is, known or not."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "expected numbers, operators and calls")
        found: Value = method(node)
        return found

    def _constant(self, node: ast.Constant) -> Value:
        if not isinstance(node.value, int | float):
            raise _UntranslatableError(node, f"uses {node.value!r}", "use numbers")
        return Known(node.value)

    def _name(self, node: ast.Name) -> Value:
        name, outside = node.id, self._source.outside
        if name in self._values:
            return self._values[name]
        if name not in self._ended and name in self._found.variables:
            return Variable(name, self._found.variables[name])
        if name in self._ended or name not in outside:
            raise _UntranslatableError(node, f"uses '{name}', which is not defined", "define it before")
        return Known(outside[name])

    def _tuple(self, node: ast.Tuple) -> Value:
        parts = [self._value(part) for part in node.elts]
        if not all(isinstance(part, Known) for part in parts):
            raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "group what is known in advance only")
        return Known(tuple(part.value for part in parts if isinstance(part, Known)))

    def _attribute(self, node: ast.Attribute) -> Value:
        owner = self._value(node.value)
        size = owner.size if isinstance(owner, ArrayView) else None
        if isinstance(owner, Known) and isinstance(owner.value, np.ndarray):
            size = owner.value.size
        if size is not None and node.attr == "size":
            return Known(size)
        if isinstance(owner, Known) and inspect.ismodule(owner.value) and hasattr(owner.value, node.attr):
            return Known(getattr(owner.value, node.attr))
        raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "of arrays only .size is known")

    def _subscript(self, node: ast.Subscript) -> Value:
        if isinstance(node.slice, ast.Slice):
            return self._part(node, node.slice)
        owner = self._value(node.value)
        if isinstance(owner, Known) and isinstance(owner.value, tuple):
            index = self._value(node.slice)
            if isinstance(index, Known):
                return Known(owner.value[index.value])
        return self._element(node)

    def _part(self, node: ast.Subscript, part: ast.Slice) -> Value:
        owner = self._value(node.value)
        bounds = [self._value(bound) if bound else Known(None) for bound in (part.lower, part.upper, part.step)]
        if not isinstance(owner, ArrayView | Known) or not all(isinstance(bound, Known) for bound in bounds):
            raise _UntranslatableError(node, f"takes the part {ast.unparse(node)}", "take constant bounds")
        cut = slice(*(bound.value for bound in bounds if isinstance(bound, Known)))
        if isinstance(owner, Known):
            return Known(owner.value[cut])
        start, stop, step = cut.indices(owner.size)
        if step != 1:
            raise _UntranslatableError(node, f"takes the part {ast.unparse(node)}", "take neighbouring elements")
        return replace(owner, offset=owner.offset + start, size=max(stop - start, 0))

    def _element(self, node: ast.Subscript) -> Text:
        """Return an element of an array."""
        if isinstance(node.slice, ast.Slice):
            raise _UntranslatableError(node, "writes to a part of an array", "write its elements in a loop")
        owner = self._value(node.value)
        if isinstance(owner, ArrayView):
            index = self._index(node, owner.offset, owner.size)
            return self._language.element(self._found, owner.array, index)
        if isinstance(owner, Known) and isinstance(owner.value, np.ndarray) and owner.value.ndim == 1:
            name = node.value.id if isinstance(node.value, ast.Name) else "table"
            index = self._index(node, 0, owner.value.size)
            return self._language.element(self._found, self._table(name, owner.value), index)
        raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "take elements of arrays with one axis")

    def _table(self, name: str, values: "np.ndarray[Any, Any]") -> str:
        """Return the name of a table with these values, which is made if there is none."""
        array, tables = np.asarray(values, dtype=float), self._found.tables
        options = (name, *(f"{name}_{k}" for k in range(2, 999)))
        unique = next(each for each in options if each not in tables or np.array_equal(tables[each], array))
        tables[unique] = array
        return unique

    def _index(self, node: ast.Subscript, offset: int, size: int) -> Expression:
        if isinstance(node.slice, ast.Tuple):
            raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "take arrays with one axis")
        index = self._whole(node.slice)
        if isinstance(index, Constant):
            place = int(index.value) + (size if index.value < 0 else 0)
            if not 0 <= place < size:
                raise _UntranslatableError(node, f"uses {ast.unparse(node)} of {size} elements", "stay within it")
            return Constant(place + offset, "int")
        if any(isinstance(part, ast.Sub | ast.USub) for part in ast.walk(node.slice)):
            index = self._library("wrap", (index, Constant(size, "int")), "int")  # Python counts from the end
        return self._operation("+", (Constant(offset, "int"), index), "int") if offset else index

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        operand = self._value(node.operand)
        if isinstance(node.op, ast.Not | ast.Invert):
            test = self._truth(node.operand)
            return Known(not test.value) if isinstance(test, Constant) else self._operation("not", (test,), "bool")
        if isinstance(operand, Known) and isinstance(operand.value, int | float):
            return Known(-operand.value if isinstance(node.op, ast.USub) else operand.value)
        number = self._number(operand, node)
        return self._operation("negate", (number,), number.type) if isinstance(node.op, ast.USub) else number

    def _binop(self, node: ast.BinOp) -> Value:
        if type(node.op) not in ARITHMETIC:
            raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "expected + - * / ** & |")
        sign, compute = ARITHMETIC[type(node.op)]
        first, second = self._value(node.left), self._value(node.right)
        if isinstance(first, Known) and isinstance(second, Known):
            return Known(compute(first.value, second.value))
        numbers = self._number(first, node), self._number(second, node)
        types = {number.type for number in numbers}
        if (sign in ("and", "or")) != ("bool" in types) or ("bool" in types and len(types) > 1):
            raise _UntranslatableError(node, "mixes numbers and truth values", "choose numbers by where(...)")
        if "bool" in types:
            return self._operation(sign, numbers, "bool")
        reals = [self._converted(number, "real") for number in numbers]
        if sign == "**":
            return self._library("pow", reals)
        if sign == "/" or "real" in types:
            return self._operation(sign, reals, "real")
        return self._operation(sign, numbers, "int")

    def _compare(self, node: ast.Compare) -> Value:
        parts = [self._value(part) for part in (node.left, *node.comparators)]
        found: list[Expression] = []
        truths: list[bool] = []
        for sign, left, right in zip(node.ops, parts[:-1], parts[1:], strict=True):
            if type(sign) not in COMPARISONS:
                raise _UntranslatableError(node, f"uses {ast.unparse(node)}", "compare numbers")
            text, compute = COMPARISONS[type(sign)]
            pair = [self._number(left, node), self._number(right, node)]
            if pair[0].type != pair[1].type:
                pair = [self._converted(number, "real") for number in pair]
            if isinstance(left, Known) and isinstance(right, Known):
                truths.append(bool(compute(left.value, right.value)))
            found.append(self._operation(text, pair, "bool"))
        if all(isinstance(part, Known) for part in parts):
            return Known(all(truths))
        joined = found[0]
        for one in found[1:]:
            joined = self._operation("and", (joined, one), "bool")
        return joined

    def _boolop(self, node: ast.BoolOp) -> Value:
        """The later operands are computed only if they matter, as in Python: ST may compute both sides of an AND."""
        result = self._temporary("bool")
        self._emit(result, self._truth(node.values[0]))
        for operand in node.values[1:]:
            test: Expression = result if isinstance(node.op, ast.And) else self._operation("not", (result,), "bool")
            body = self._block(lambda operand=operand: self._emit(result, self._truth(operand)))  # type: ignore[misc]
            self._lines += self._language.branch(self._print(test), body, ())
        return result

    def _ifexp(self, node: ast.IfExp) -> Value:
        """Only the value that is chosen is computed."""
        test = self._truth(node.test)
        if isinstance(test, Constant):
            return self._value(node.body if test.value else node.orelse)
        result = self._temporary("real")
        body = self._block(lambda: self._emit(result, self._real(node.body)))
        otherwise = self._block(lambda: self._emit(result, self._real(node.orelse)))
        self._lines += self._language.branch(self._print(test), body, otherwise)
        return result

    def _call(self, node: ast.Call) -> Value:
        called = self._value(node.func)
        if not isinstance(called, Known) or not callable(called.value):
            raise _UntranslatableError(node, f"calls {ast.unparse(node.func)}", "call functions of Python")
        if node.keywords:
            raise _UntranslatableError(node, "calls with named arguments", "give them by their order")
        arguments = self._arguments(node)
        try:
            known = KNOWN_FUNCTIONS.get(called.value)
        except TypeError:
            known = None
        if known is not None:
            return self._library_call(known, called.value, arguments, node)
        if inspect.isfunction(getattr(called.value, "py_func", called.value)):
            return self._call_translated(called.value, arguments, node)
        raise _UntranslatableError(node, f"calls {ast.unparse(node.func)}", "see the list of functions in the docs")

    def _arguments(self, node: ast.Call) -> list[Value]:
        found: list[Value] = []
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                given = self._value(argument.value)
                if not isinstance(given, Known) or not isinstance(given.value, tuple):
                    raise _UntranslatableError(node, f"calls with {ast.unparse(argument)}", "give each argument")
                found += [Known(part) for part in given.value]
            else:
                found.append(self._value(argument))
        return found

    def _call_translated(self, function: Callable[..., Any], given: Sequence[Value], node: ast.AST) -> Text:
        """Return the call of another function of Python, which is translated for what is known of its arguments."""
        source = _FunctionSource(function)
        if len(given) != len(source.parameters):
            raise self._source.fault(node, f"calls {source.definition.name} with {len(given)} arguments", "give all")
        named = dict(zip(source.parameters, given, strict=True))
        inner = {name: _inner_value(name, value) for name, value in named.items()}
        (label,) = safe_names([f"{self._found.name}_{source.definition.name}"], (), False).values()
        called = self._others.function(label, function, inner)
        if called not in self._found.calls:
            self._found.calls.append(called)
        arrays = [value.array for value in given if isinstance(value, ArrayView)]
        numbers = [self._converted(value, "real") for value in given if not isinstance(value, ArrayView | Known)]
        return self._language.call(self._found, called, arrays, numbers)

    def _library_call(self, known: str, function: Callable[..., Any], given: Sequence[Value], node: ast.Call) -> Value:
        if all(isinstance(argument, Known) for argument in given):
            return Known(function(*(argument.value for argument in given if isinstance(argument, Known))))
        if known == "length":
            if isinstance(given[0], ArrayView):
                return Known(given[0].size)
            raise _UntranslatableError(node, f"takes {ast.unparse(node)}", "take the length of an array")
        numbers = [self._number(argument, node) for argument in given]
        match known:
            case "min" | "max":
                return self._extreme(known, numbers)
            case "choose":
                if numbers[0].type != "bool":
                    raise _UntranslatableError(node, "chooses by a number", "compare it first")
                return self._library("choose", (numbers[0], *(self._converted(each, "real") for each in numbers[1:])))
            case "truncate":
                return numbers[0] if numbers[0].type == "int" else self._library("truncate", numbers, "int")
        reals = [self._converted(number, "real") for number in numbers]
        return reals[0] if known == "real" else self._library(known, reals)

    def _extreme(self, known: str, given: Sequence[Expression]) -> Expression:
        is_whole = all(number.type == "int" for number in given)
        found, *others = given if is_whole else [self._converted(number, "real") for number in given]
        for number in others:
            found = self._library(known, (found, number), number.type)
        return found


def _inner_value(name: str, value: Value) -> Value:
    """Return what a value is inside of a function whose parameter it becomes."""
    if isinstance(value, Known):
        return value
    return replace(value, array=name) if isinstance(value, ArrayView) else Variable(name, "real")


def _written_names(node: ast.AST) -> list[str]:
    return [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
