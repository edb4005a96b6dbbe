"""Functions of the subset of Python in which friction laws are written, translated to a syntax tree.

What is known when a function is translated, such as the parameters of a law, becomes part of it: sizes are numbers,
and a law that calls others, as a composite does, calls the functions that these became.
"""

import ast
import inspect
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.translation.expressions import (
    ArrayView,
    ExpressionTranslator,
    Known,
    UntranslatableError,
    Value,
)
from fraexp.components.translation.identifiers import safe_names
from fraexp.components.translation.syntax_tree import (
    Assignment,
    Branch,
    CountingLoop,
    Expression,
    Function,
    FunctionCall,
    LoopExit,
    Number,
    ReturnValue,
    Statement,
    Type,
    Variable,
)
from fraexp.errors import PluginError


class FunctionSource:
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


REAL_INPUT = object()
"""Stands for an argument that is a real number which changes from call to call."""
MAX_PASSES = 5
"""Passes in which the types of variables are found: a whole number may become a real one."""


def translate(
    name: str, function: Callable[..., Any], arguments: Mapping[str, object], arrays: Mapping[str, int]
) -> Function:
    """Return a function that is translated for these arguments.

    Args:
        name: Name of the translated function.
        function: Pure function of numbers and arrays, which may write elements of the arrays.
        arguments: Value of each parameter that is no array: `REAL_INPUT`, or what it is in all calls: a number, an
            array or tuple of numbers, or a function.
        arrays: Size of each parameter that is an array which the caller provides.

    PluginError names file and line of what cannot be translated.
    """
    values: dict[str, Value] = {array: ArrayView(array, 0, size, size) for array, size in arrays.items()}
    for parameter, value in arguments.items():
        values[parameter] = Variable(parameter, "real") if value is REAL_INPUT else Known(value)
    return _Specialisations().function(name, function, values)


class _Specialisations:
    """The functions translated so far, each for what is known of its arguments."""

    def __init__(self) -> None:
        self._functions: list[tuple[Callable[..., Any], Mapping[str, Value], Function]] = []
        self._open: list[Callable[..., Any]] = []
        """Functions whose translation has begun."""

    def function(self, name: str, function: Callable[..., Any], values: Mapping[str, Value]) -> Function:
        """Return the translation of a function for these values, which may have been made before."""
        if function in self._open:
            source = FunctionSource(function)
            raise source.fault(source.definition, "calls itself", "its time is not bounded: loop over a range")
        for known, given, translated in self._functions:
            if known is function and _are_same(given, values):
                return translated
        names = [translated.name for _, _, translated in self._functions]
        unique = next(each for each in (name, *(f"{name}_{k}" for k in range(2, 999))) if each not in names)
        source = FunctionSource(function)
        found = Function(unique, source.summary, (), {})
        self._functions.append((function, values, found))
        self._open.append(function)
        for _ in range(MAX_PASSES):
            before = dict(found.variables)
            StatementTranslator(source, found, values, self).translate()
            if found.variables == before:
                self._open.pop()
                return found
        raise source.fault(source.definition, "has variables whose type cannot be determined", "give each one type")


def _are_same(first: Mapping[str, Value], second: Mapping[str, Value]) -> bool:
    return all(_is_same(first[name], second[name]) for name in first)


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


class StatementTranslator:
    """Translates the statements of one function; expressions are left to an `ExpressionTranslator`."""

    def __init__(
        self, source: FunctionSource, found: Function, values: Mapping[str, Value], others: _Specialisations
    ) -> None:
        self._source, self._found, self._others = source, found, others
        self._values = dict(values)
        self._written = Counter(_written_names(source.definition))
        self._loops: list[str] = []
        self._ended: set[str] = set()
        self._statements: list[Statement] = []
        self._temporaries = 0
        found.calls, found.tables, found.arrays, found.parameters = [], {}, {}, ()
        self._expressions = ExpressionTranslator(self)

    def translate(self) -> None:
        """Fill the function with what its source says."""
        found = self._found
        found.parameters = tuple(v for v in self._values.values() if isinstance(v, Variable))
        for name, value in list(self._values.items()):
            if isinstance(value, ArrayView):
                found.arrays = {**found.arrays, value.array: value.whole_size}
            elif isinstance(value, Known) and isinstance(value.value, float | np.floating):
                self._assign(name, Number(float(value.value), "real"))  # a name says more than a number
            elif self._written[name]:
                self._assign(name, self._number(value))
        for statement in self._source.definition.body:
            self._translate(statement)
        found.body = tuple(self._statements)

    # What expressions ask for.

    def value(self, name: str) -> Value:
        """Return what a name stands for; KeyError if it is unknown."""
        if name in self._values:
            return self._values[name]
        if name in self._ended:
            raise KeyError(name)
        if name in self._found.variables:
            return Variable(name, self._found.variables[name])
        return Known(self._source.outside[name])

    def temporary(self, kind: Type) -> Variable:
        """Return a new variable."""
        self._temporaries += 1
        name = f"part_{self._temporaries}"
        self._found.variables[name] = kind
        return Variable(name, kind)

    def emit(self, statement: Statement) -> None:
        """Add a statement."""
        self._statements.append(statement)

    def block(self, translate: Callable[[], None]) -> tuple[Statement, ...]:
        """Return the statements that `translate` adds."""
        outer, self._statements = self._statements, []
        translate()
        inner, self._statements = self._statements, outer
        return tuple(inner)

    def table(self, name: str, values: object) -> str:
        """Return the name of a table with these values, which is made if there is none."""
        array = np.asarray(values, dtype=float)
        unique = next(each for each in (name, *(f"{name}_{k}" for k in range(2, 999))) if self._is_free(each, array))
        self._found.tables[unique] = array
        return unique

    def _is_free(self, name: str, values: "np.ndarray[Any, Any]") -> bool:
        return name not in self._found.tables or np.array_equal(self._found.tables[name], values)

    def call(self, function: Callable[..., Any], given: Sequence[Value], node: ast.AST) -> FunctionCall:
        """Return the call of another function of Python, which is translated for what is known of its arguments."""
        source = FunctionSource(function)
        if len(given) != len(source.parameters):
            raise self._source.fault(node, f"calls {source.definition.name} with {len(given)} arguments", "give all")
        named = dict(zip(source.parameters, given, strict=True))
        inner = {name: _inner_value(name, value) for name, value in named.items()}
        (label,) = safe_names([f"{self._found.name}_{source.definition.name}"], (), False).values()
        called = self._others.function(label, function, inner)
        if called not in self._found.calls:
            self._found.calls.append(called)
        arrays = tuple(value.array for value in named.values() if isinstance(value, ArrayView))
        numbers = tuple(value for value in given if not isinstance(value, ArrayView | Known))
        reals = tuple(self._expressions.as_real(number) for number in numbers)
        return FunctionCall(called, reals, arrays)

    # Statements.

    def _translate(self, node: ast.stmt) -> None:
        try:
            method = getattr(self, f"_translate_{type(node).__name__.lower()}", None)
            if method is None:
                raise UntranslatableError(
                    node, f"uses '{type(node).__name__.lower()}'", REMEDIES.get(type(node), SUBSET)
                )
            method(node)
        except UntranslatableError as error:
            raise self._source.fault(error.node, error.found, error.expected) from None

    def _translate_expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a documentation is none
            raise UntranslatableError(node, "has an expression without effect", SUBSET)

    def _translate_pass(self, node: ast.Pass) -> None:
        """A statement without effect."""

    def _translate_break(self, node: ast.Break) -> None:
        self.emit(LoopExit("break"))

    def _translate_continue(self, node: ast.Continue) -> None:
        self.emit(LoopExit("continue"))

    def _translate_return(self, node: ast.Return) -> None:
        if node.value is None:
            raise UntranslatableError(node, "returns nothing", "return a number")
        self.emit(ReturnValue(self._expressions.real(node.value)))

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
            element = self._expressions.element(target)
            if element.array in self._found.tables:
                raise UntranslatableError(target, "writes to a constant", "write elements of the state only")
            self.emit(Assignment(element, self._expressions.real(value)))
        elif isinstance(target, ast.Name):
            self._bind(target.id, self._expressions.value(value), node)
        else:
            raise UntranslatableError(node, f"writes {ast.unparse(target)}", SUBSET)

    def _unpack(self, target: ast.Tuple, value: ast.expr) -> None:
        names = [name.id for name in target.elts if isinstance(name, ast.Name)]
        found = [self._expressions.value(part) for part in value.elts] if isinstance(value, ast.Tuple) else None
        if found is None:
            known = self._expressions.value(value)
            found = [Known(part) for part in known.value] if isinstance(known, Known) else []
        if not len(names) == len(target.elts) == len(found):
            raise UntranslatableError(target, f"unpacks {ast.unparse(value)}", "unpack as many values into names")
        held: list[Value] = []
        for each in found:  # all values are computed before a name is written
            if isinstance(each, Known | ArrayView):
                held.append(each)
                continue
            part = self.temporary(each.type)
            self.emit(Assignment(part, each))
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
            self._assign(name, self._number(value))
        elif self._written[name] > 1:
            raise UntranslatableError(node, f"gives '{name}' several arrays", "take a name for each")
        else:
            self._values[name] = value

    def _assign(self, name: str, value: Expression) -> None:
        before = self._found.variables.get(name, value.type)
        if {before, value.type} == {"int", "real"}:
            joined: Type = "real"
        elif before == value.type:
            joined = before
        else:
            raise UntranslatableError(
                self._source.definition, f"uses '{name}' for a number and a truth value", "take two names"
            )
        self._ended.discard(name)
        if not isinstance(self._values.get(name), Variable):
            self._values.pop(name, None)
        is_parameter = name in (parameter.name for parameter in self._found.parameters)
        if not is_parameter:
            self._found.variables[name] = joined
        self.emit(Assignment(Variable(name, joined), self._expressions.converted(value, joined)))

    def _number(self, value: Value) -> Expression:
        return self._expressions.number(value, self._source.definition)

    def _translate_if(self, node: ast.If) -> None:
        test = self._expressions.truth(node.test)
        if isinstance(test, Number):
            return self._translate_all(node.body if test.value else node.orelse)
        body = self.block(lambda: self._translate_all(node.body))
        otherwise = self.block(lambda: self._translate_all(node.orelse))
        self.emit(Branch(test, body, otherwise))

    def _translate_for(self, node: ast.For) -> None:
        call = node.iter
        if node.orelse or not (isinstance(call, ast.Call) and self._expressions.is_range(call.func)):
            raise UntranslatableError(node, f"loops over {ast.unparse(call)}", "loop over a range of whole numbers")
        counter = self._counter(node)
        bounds = [self._expressions.whole(bound) for bound in call.args]
        start, stop, step = self._range(bounds, node)
        if not isinstance(stop, Number):  # Python computes it once
            held = self.temporary("int")
            self.emit(Assignment(held, stop))
            stop = held
        self._values.pop(counter, None)
        self._ended.discard(counter)
        self._found.variables[counter] = "int"
        self._loops.append(counter)
        body = self.block(lambda: self._translate_all(node.body))
        self._ended.add(self._loops.pop())
        self.emit(CountingLoop(Variable(counter, "int"), start, stop, step, body))

    def _counter(self, node: ast.For) -> str:
        """Return the variable of a loop; nothing else may write it, and its value ends with the loop."""
        name = node.target.id if isinstance(node.target, ast.Name) else ""
        if not name or name in self._loops or any(name in _written_names(part) for part in node.body):
            found = f"loops with {ast.unparse(node.target)}, which is written inside or outside of the loop"
            raise UntranslatableError(node, found, "loop with a name of its own")
        return name

    def _translate_all(self, nodes: Sequence[ast.stmt]) -> None:
        for node in nodes:
            self._translate(node)

    def _range(self, bounds: Sequence[Expression], node: ast.For) -> tuple[Expression, Expression, int]:
        start = bounds[0] if len(bounds) > 1 else Number(0, "int")
        stop = bounds[1] if len(bounds) > 1 else bounds[0]
        step = bounds[2] if len(bounds) > 2 else Number(1, "int")
        if not isinstance(step, Number) or step.value == 0:
            raise UntranslatableError(node, "loops with a step that varies", "take a constant one")
        return start, stop, int(step.value)


def _inner_value(name: str, value: Value) -> Value:
    """Return what a value is inside of a function whose parameter it becomes."""
    if isinstance(value, Known):
        return value
    return replace(value, array=name) if isinstance(value, ArrayView) else Variable(name, "real")


def _written_names(node: ast.AST) -> list[str]:
    return [n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]


SUBSET = "expected assignments, if, for over a range, and return, of numbers and elements of arrays"
REMEDIES: dict[type[ast.stmt], str] = {
    ast.While: "its time is not bounded: loop over a range, and leave it by break",
}
