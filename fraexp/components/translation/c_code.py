"""Translated functions and blocks of a controller as one file of C99, with a test that a compiler option turns on."""

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.blocks import Block, Setting
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
    with_calls,
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


TEST_TOLERANCE = {"double": 1e-12, "float": 1e-4}
"""Error of the test's outputs, relative to the greatest one, by type: libraries of mathematics differ in rounding."""


def c_text(blocks: Sequence[Block], name: str, notes: Sequence[str], is_single: bool = False) -> str:
    """Return the file; all of its names begin with `name`, an identifier, and `notes` are in its first comment."""
    prefix, real = f"{name}_", "float" if is_single else "double"
    printer = CPrinter(prefix)
    head = "\n".join(["/*", *(f" * {comment(note)}".rstrip() for note in notes), " */"])
    functions = [printer.function(each) for each in with_calls([block.program for block in blocks])]
    return "\n".join(
        [
            head,
            f"#ifndef {prefix}INCLUDED\n#define {prefix}INCLUDED\n",
            "#include <math.h>\n#include <tgmath.h>\n",
            f"#ifndef {prefix}REAL\n#define {prefix}REAL {real}\n#endif\n",
            *(_setting_text(each, prefix) for each in _settings(blocks)),
            printer.helpers(),
            *functions,
            *(_block_text(block, prefix) for block in blocks),
            _test_text(blocks, prefix),
            "#endif\n",
        ]
    )


def _settings(blocks: Sequence[Block]) -> list[Setting]:
    """Return the settings of all blocks, each once."""
    return list(dict.fromkeys(setting for block in blocks for setting in block.settings))


def _setting_text(setting: Setting, prefix: str) -> str:
    """Return a setting as a macro, which the compiler's command line may define."""
    name, unknown = f"{prefix}{setting.name.upper()}", setting.value is None
    remedy = f"the {setting.meaning} [{setting.unit}] is not known: state it, for instance by -D{name}=100"
    given = f'#error "{comment(remedy)}"' if unknown else f"#define {name} {setting.value!r}"
    return "\n".join(
        [
            f"/* {comment(setting.meaning)} [{setting.unit}] */",
            f"#ifdef {prefix}SELF_TEST\n#undef {name}\n#define {name} {setting.test_value!r}",
            f"#elif !defined {name}\n{given}\n#endif\n",
        ]
    )


def _block_text(block: Block, prefix: str) -> str:
    """Return the states of a block, its reset and its step."""
    real, label = f"{prefix}real", f"{prefix}{block.name}"
    states = safe_names(block.states, C_WORDS, False)
    inputs = safe_names([one.name for one in block.inputs], C_WORDS, False)
    members = "".join(f"    {real} {states[one]}[{max(size, 1)}];\n" for one, size in block.states.items())
    meanings = [f" * {inputs[one.name]}: {one.meaning} [{one.unit}]" for one in block.inputs]
    given = "".join(f", {real} {inputs[one.name]}" for one in block.inputs)
    settings = [f"({real}){prefix}{one.name.upper()}" for one in block.settings]
    called = ", ".join([*(f"state->{states[one]}" for one in block.states), *inputs.values(), *settings])
    return "\n".join(
        [
            f"typedef struct {{\n{members or '    char empty;'}}} {label}_state;\n",
            f"static inline void {label}_reset({label}_state *state) {{\n    *state = ({label}_state){{0}};\n}}\n",
            f"/* {comment(block.summary)}",
            *map(comment_line, meanings),
            f" * Returns: {comment(block.output.meaning)} [{block.output.unit}]. Call it once per sample. */",
            f"static inline {real} {label}_step({label}_state *state{given}) {{",
            f"    return {label}({called});\n}}\n",
        ]
    )


def comment_line(text: str) -> str:
    """Return a line of a comment."""
    return f" {comment(text)}"


def _test_text(blocks: Sequence[Block], prefix: str) -> str:
    """Return a program that compares all blocks with their test vectors."""
    return "\n".join(
        [
            f"#ifdef {prefix}SELF_TEST\n#include <stdio.h>\n",
            *(_vector_text(block, prefix) for block in blocks),
            "int main(void) {\n    int failures = 0;",
            f"    const double tolerance = sizeof({prefix}real) == sizeof(double) ? "
            f"{TEST_TOLERANCE['double']!r} : {TEST_TOLERANCE['float']!r};",
            *(_test_call(block, prefix) for block in blocks),
            "    return failures;\n}\n#endif\n",
        ]
    )


def _vector_text(block: Block, prefix: str) -> str:
    label, outputs = f"{prefix}{block.name}", block.test_outputs
    rows = ",\n".join(f"    {{{', '.join(map(repr, row))}}}" for row in block.test_inputs.tolist())
    given = ", ".join(f"({prefix}real){label}_inputs[k][{i}]" for i in range(len(block.inputs)))
    expected = ",\n".join(f"    {value!r}" for value in outputs.tolist())
    return f"""\
static const double {label}_inputs[{len(outputs)}][{len(block.inputs)}] = {{
{rows}
}};
static const double {label}_outputs[{len(outputs)}] = {{
{expected}
}};
static double {label}_error(void) {{
    double worst = 0.0, scale = 0.0;
    {label}_state state;
    {label}_reset(&state);
    for (int k = 0; k < {len(outputs)}; ++k) {{
        const double found = (double){label}_step(&state, {given});
        worst = fmax(worst, fabs(found - {label}_outputs[k]));
        scale = fmax(scale, fabs({label}_outputs[k]));
    }}
    return scale > 0.0 ? worst / scale : worst;
}}
"""


def _test_call(block: Block, prefix: str) -> str:
    label = f"{prefix}{block.name}"
    return (
        f'    printf("{block.name}: relative error %.2g\\n", {label}_error());\n'
        f"    failures += !({label}_error() <= tolerance);"
    )
