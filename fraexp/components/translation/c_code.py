"""Translated functions as C99."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.identifiers import C_WORDS, safe_names
from fraexp.components.translation.syntax_tree import (
    Assignment,
    Branch,
    CountingLoop,
    Element,
    Expression,
    Function,
    FunctionCall,
    LibraryCall,
    LoopExit,
    Number,
    Operation,
    ReturnValue,
    Statement,
    Type,
    Variable,
)

HELPERS = """\
typedef {prefix}REAL {prefix}real; /* double, or float by -D{prefix}REAL=float */

static inline {prefix}real {prefix}min({prefix}real a, {prefix}real b) {{ return b < a ? b : a; }}
static inline {prefix}real {prefix}max({prefix}real a, {prefix}real b) {{ return b > a ? b : a; }}
static inline int {prefix}min_int(int a, int b) {{ return b < a ? b : a; }}
static inline int {prefix}max_int(int a, int b) {{ return b > a ? b : a; }}
static inline int {prefix}wrap(int index, int size) {{ return index < 0 ? index + size : index; }}
"""
"""What all files begin with: the type of real numbers, and functions with the meaning that they have in Python."""
OPERATORS = {"and": "&&", "or": "||", "not": "!", "negate": "-"}
MATH_NAMES = {"abs": "fabs"}
VALUES_PER_LINE = 4


class CPrinter:
    """Prints functions; the names of all begin with a prefix."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix

    def helpers(self) -> str:
        """Return the type of real numbers, and the functions that others use."""
        return HELPERS.format(prefix=self.prefix)

    def type_name(self, kind: Type) -> str:
        """Return the type of a variable."""
        return f"{self.prefix}real" if kind == "real" else "int"

    def number(self, value: float | int | bool, kind: Type) -> str:
        """Return a constant."""
        if kind != "real":
            return str(int(value))
        text = repr(float(value))
        return f"({self.prefix}real){text if float(value) >= 0 else f'({text})'}" if np.isfinite(value) else "HUGE_VAL"

    def table(self, name: str, values: NDArray[np.float64]) -> str:
        """Return an array of constants."""
        rows = _rows([self.number(float(value), "real") for value in values.ravel()])
        declared = f"static const {self.prefix}real {self.prefix}{name}[{max(values.size, 1)}]"
        return f"{declared} = {{\n{rows or '    0'}\n}};\n"

    def function(self, function: Function) -> str:
        """Return a function with its tables."""
        return _FunctionPrinter(self, function).text()


def comment(text: str) -> str:
    """Return a text that does not end a comment of either language."""
    return " ".join(text.replace("*/", "* /").replace("*)", "* )").replace("(*", "( *").split())


def _rows(values: Sequence[str]) -> str:
    lines = [values[k : k + VALUES_PER_LINE] for k in range(0, len(values), VALUES_PER_LINE)]
    return ",\n".join(f"    {', '.join(line)}" for line in lines)


class _FunctionPrinter:
    def __init__(self, printer: CPrinter, function: Function) -> None:
        self._printer, self._function = printer, function

    @cached_property
    def _names(self) -> Mapping[str, str]:
        function = self._function
        own = [parameter.name for parameter in function.parameters]
        return safe_names(dict.fromkeys([*function.arrays, *own, *function.variables]), C_WORDS, False)

    def text(self) -> str:
        """Return the function, behind the tables that it uses."""
        function, printer = self._function, self._printer
        tables = "".join(printer.table(f"{function.name}_{name}", each) for name, each in function.tables.items())
        arrays = [f"{printer.type_name('real')} *{self._names[name]}" for name in function.arrays]
        numbers = [f"{printer.type_name(one.type)} {self._names[one.name]}" for one in function.parameters]
        given = ", ".join([*arrays, *numbers]) or "void"
        signature = f"static inline {printer.type_name('real')} {printer.prefix}{function.name}({given})"
        head = f"/* {comment(function.summary)} */\n{signature}"
        declared = [
            f"    {printer.type_name(kind)} {self._names[name]} = 0;" for name, kind in function.variables.items()
        ]
        body = list(self._block(function.body, 1))
        used = set(re.findall(r"\w+", " ".join(body)))
        given_names = map(self._names.__getitem__, (*function.arrays, *(one.name for one in function.parameters)))
        unused = [f"    (void){name};" for name in given_names if name not in used]
        return "\n".join([tables + head + " {", *declared, *unused, *body, "}", ""])

    def _block(self, statements: Sequence[Statement], depth: int) -> Iterator[str]:
        indent = "    " * depth
        for statement in statements:
            for line in self._statement(statement, depth):
                yield indent + line if not line.startswith("    ") else line

    def _statement(self, statement: Statement, depth: int) -> Iterator[str]:
        if isinstance(statement, Assignment):
            yield f"{self._expression(statement.target)} = {self._expression(statement.value)};"
        elif isinstance(statement, ReturnValue):
            yield f"return {self._expression(statement.value)};"
        elif isinstance(statement, LoopExit):
            yield f"{statement.word};"
        elif isinstance(statement, Branch):
            yield f"if ({self._expression(statement.test)}) {{"
            yield from self._block(statement.body, depth + 1)
            if statement.otherwise:
                yield "} else {"
                yield from self._block(statement.otherwise, depth + 1)
            yield "}"
        else:
            yield self._loop_head(statement)
            yield from self._block(statement.body, depth + 1)
            yield "}"

    def _loop_head(self, loop: CountingLoop) -> str:
        name, sign = self._names[loop.variable.name], "<" if loop.step > 0 else ">"
        start, stop = self._expression(loop.start), self._expression(loop.stop)
        return f"for ({name} = {start}; {name} {sign} {stop}; {name} += {loop.step}) {{"

    def _expression(self, expression: Expression) -> str:
        match expression:
            case Number():
                return self._printer.number(expression.value, expression.type)
            case Variable():
                return self._names[expression.name]
            case Element():
                return f"{self._array(expression.array)}[{self._expression(expression.index)}]"
            case Operation():
                return self._operation(expression)
            case LibraryCall():
                return self._library_call(expression)
            case FunctionCall():
                arrays = [self._names[name] for name in expression.arrays]
                given = [*arrays, *map(self._expression, expression.arguments)]
                return f"{self._printer.prefix}{expression.function.name}({', '.join(given)})"

    def _array(self, name: str) -> str:
        if name in self._function.tables:
            return f"{self._printer.prefix}{self._function.name}_{name}"
        return self._names[name]

    def _operation(self, operation: Operation) -> str:
        operands = [self._operand(operand) for operand in operation.operands]
        sign = OPERATORS.get(operation.operator, operation.operator)
        return f" {sign} ".join(operands) if len(operands) > 1 else f"{sign}{operands[0]}"

    def _operand(self, operand: Expression) -> str:
        text = self._expression(operand)
        is_choice = isinstance(operand, LibraryCall) and operand.function == "choose"
        return f"({text})" if isinstance(operand, Operation) or is_choice else text

    def _library_call(self, call: LibraryCall) -> str:
        prefix, given = self._printer.prefix, [self._expression(argument) for argument in call.arguments]
        match call.function:
            case "real" | "truncate":
                return f"({self._printer.type_name(call.type)})({given[0]})"
            case "choose":
                return " ".join((self._operand(call.arguments[0]), "?", given[1], ":", given[2]))
            case "min" | "max" if call.type == "int":
                return f"{prefix}{call.function}_int({', '.join(given)})"
            case "min" | "max" | "wrap":
                return f"{prefix}{call.function}({', '.join(given)})"
        return f"{MATH_NAMES.get(call.function, call.function)}({', '.join(given)})"
