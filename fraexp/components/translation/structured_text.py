"""Translated functions and blocks of a controller as one file of IEC 61131-3 Structured Text, with a test program.

Arrays are passed by VAR_IN_OUT.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.blocks import Block, BlockInput, Setting
from fraexp.components.translation.c_code import comment
from fraexp.components.translation.identifiers import ST_WORDS, safe_names
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
FUNCTION {prefix}copysign : {real} (* magnitude with the sign of another number *)
VAR_INPUT
    magnitude : {real};
    signed : {real};
END_VAR
IF signed < 0.0 THEN
    {prefix}copysign := -ABS(magnitude);
ELSE
    {prefix}copysign := ABS(magnitude);
END_IF;
END_FUNCTION

FUNCTION {prefix}expm1 : {real} (* EXP(x) - 1 without cancellation, as W. Kahan computes it *)
VAR_INPUT
    x : {real};
END_VAR
VAR
    u : {real};
END_VAR
u := EXP(x);
IF u = 1.0 THEN
    {prefix}expm1 := x;
ELSIF x < -40.0 THEN
    {prefix}expm1 := -1.0;
ELSIF x > 40.0 THEN
    {prefix}expm1 := u;
ELSE
    {prefix}expm1 := (u - 1.0) * x / LN(u);
END_IF;
END_FUNCTION

FUNCTION {prefix}tanh : {real} (* hyperbolic tangent *)
VAR_INPUT
    x : {real};
END_VAR
{prefix}tanh := 1.0 - 2.0 / ({prefix}expm1(x := MIN(2.0 * ABS(x), 80.0)) + 2.0);
{prefix}tanh := {prefix}copysign(magnitude := {prefix}tanh, signed := x);
END_FUNCTION

FUNCTION {prefix}wrap : DINT (* index that counts from the end if it is negative *)
VAR_INPUT
    index : DINT;
    size : DINT;
END_VAR
{prefix}wrap := SEL(index < 0, index, index + size);
END_FUNCTION
"""
"""Functions that the standard lacks, with the meaning that they have in Python."""
HELPER_INPUTS = {"copysign": ("magnitude", "signed"), "expm1": ("x",), "tanh": ("x",), "wrap": ("index", "size")}
OPERATORS = {"and": "AND", "or": "OR", "not": "NOT ", "negate": "-", "==": "=", "!=": "<>"}
STANDARD_NAMES = {"log": "LN", "pow": "EXPT", "truncate": "TRUNC"}
VALUES_PER_LINE = 6


class StPrinter:
    """Prints functions; the names of all begin with a prefix."""

    def __init__(self, prefix: str, is_single: bool = False) -> None:
        self.prefix, self.real = prefix, "REAL" if is_single else "LREAL"

    def helpers(self) -> str:
        """Return the functions that others use."""
        return HELPERS.format(prefix=self.prefix, real=self.real)

    def type_name(self, kind: Type) -> str:
        """Return the type of a variable."""
        return {"real": self.real, "int": "DINT", "bool": "BOOL"}[kind]

    def number(self, value: float | int | bool, kind: Type) -> str:
        """Return a constant."""
        if kind == "bool":
            return "TRUE" if value else "FALSE"
        return real_literal(float(value)) if kind == "real" else str(int(value))

    def array_type(self, size: int) -> str:
        """Return the type of an array of real numbers."""
        return f"ARRAY[0..{max(size, 1) - 1}] OF {self.real}"

    def table(self, name: str, values: NDArray[np.float64]) -> str:
        """Return the declaration of an array with values."""
        texts = [real_literal(float(value)) for value in values.ravel()] or ["0.0"]
        lines = [texts[k : k + VALUES_PER_LINE] for k in range(0, len(texts), VALUES_PER_LINE)]
        rows = ",\n        ".join(", ".join(line) for line in lines)
        return f"    {name} : {self.array_type(values.size)} := [\n        {rows}];"

    def function(self, function: Function) -> str:
        """Return a function."""
        return _FunctionPrinter(self, function).text()


def real_literal(value: float) -> str:
    """Return a real number as the standard writes it, with a point."""
    mantissa, e, exponent = repr(value).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{'E' if e else ''}{exponent}"


def tables_of(function: Function) -> dict[str, NDArray[np.float64]]:
    """Return the tables that a function and those that it calls use, by a name that no other table has."""
    return {f"{each.name}_{name}": table for each in with_calls([function]) for name, table in each.tables.items()}


class _FunctionPrinter:
    def __init__(self, printer: StPrinter, function: Function) -> None:
        self._printer, self._function = printer, function
        self._tables = tables_of(function)

    @cached_property
    def _names(self) -> Mapping[str, str]:
        function = self._function
        own = [parameter.name for parameter in function.parameters]
        names = dict.fromkeys([*function.arrays, *own, *function.variables, *self._tables])
        return safe_names(names, ST_WORDS, True)

    def text(self) -> str:
        """Return the function."""
        function, printer = self._function, self._printer
        sizes = {**function.arrays, **{name: table.size for name, table in self._tables.items()}}
        shared = {self._names[name]: printer.array_type(size) for name, size in sizes.items()}
        given = {self._names[one.name]: printer.type_name(one.type) for one in function.parameters}
        local = {self._names[name]: printer.type_name(kind) for name, kind in function.variables.items()}
        head = f"FUNCTION {printer.prefix}{function.name} : {printer.type_name('real')}"
        sections = (("VAR_IN_OUT", shared), ("VAR_INPUT", given), ("VAR", local))
        declared = [line for word, variables in sections for line in declaration(word, variables)]
        body = list(self._block(function.body, 0))
        if body and body[-1] == "RETURN;":
            body.pop()
        return "\n".join([f"{head} (* {comment(function.summary)} *)", *declared, *body, "END_FUNCTION", ""])

    def _block(self, statements: Sequence[Statement], depth: int) -> Iterator[str]:
        for statement in statements:
            for line in self._statement(statement):
                yield "    " * depth + line

    def _statement(self, statement: Statement) -> Iterator[str]:
        if isinstance(statement, Assignment):
            yield f"{self._expression(statement.target)} := {self._expression(statement.value)};"
        elif isinstance(statement, ReturnValue):
            yield f"{self._printer.prefix}{self._function.name} := {self._expression(statement.value)};"
            yield "RETURN;"
        elif isinstance(statement, LoopExit):
            yield {"break": "EXIT;", "continue": "CONTINUE;"}[statement.word]
        elif isinstance(statement, Branch):
            yield f"IF {self._expression(statement.test)} THEN"
            yield from self._block(statement.body, 1) if statement.body else ("    ;",)
            if statement.otherwise:
                yield "ELSE"
                yield from self._block(statement.otherwise, 1)
            yield "END_IF;"
        else:
            yield self._loop_head(statement)
            yield from self._block(statement.body, 1) if statement.body else ("    ;",)
            yield "END_FOR;"

    def _loop_head(self, loop: CountingLoop) -> str:
        last = f"{self._operand(loop.stop)} {'-' if loop.step > 0 else '+'} 1"
        if isinstance(loop.stop, Number):
            last = str(int(loop.stop.value) + (-1 if loop.step > 0 else 1))
        by = "" if loop.step == 1 else f" BY {loop.step}"
        return f"FOR {self._names[loop.variable.name]} := {self._expression(loop.start)} TO {last}{by} DO"

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
                return self._function_call(expression)

    def _array(self, name: str) -> str:
        own = name in self._function.tables
        return self._names[f"{self._function.name}_{name}" if own else name]

    def _operation(self, operation: Operation) -> str:
        operands = [self._operand(operand) for operand in operation.operands]
        sign = OPERATORS.get(operation.operator, operation.operator)
        return f" {sign} ".join(operands) if len(operands) > 1 else f"{sign}{operands[0]}"

    def _operand(self, operand: Expression) -> str:
        text = self._expression(operand)
        return f"({text})" if isinstance(operand, Operation) or text.startswith("-") else text

    def _function_call(self, call: FunctionCall) -> str:
        inner = _FunctionPrinter(self._printer, call.function)
        arrays = dict(zip(call.function.arrays, call.arrays, strict=True))
        given = {inner._names[name]: self._names[ours] for name, ours in arrays.items()}
        given |= {inner._names[name]: self._names[name] for name in inner._tables}
        numbers = zip(call.function.parameters, call.arguments, strict=True)
        given |= {inner._names[one.name]: self._expression(value) for one, value in numbers}
        return f"{self._printer.prefix}{call.function.name}({named_arguments(given)})"

    def _library_call(self, call: LibraryCall) -> str:
        given = [self._expression(argument) for argument in call.arguments]
        if call.function == "real":
            if call.arguments[0].type == "bool":
                return f"SEL({given[0]}, 0.0, 1.0)"
            return f"DINT_TO_{self._printer.real}({given[0]})"
        if call.function == "choose":
            return f"SEL({given[0]}, {given[2]}, {given[1]})"
        if call.function in HELPER_INPUTS:
            named = dict(zip(HELPER_INPUTS[call.function], given, strict=True))
            return f"{self._printer.prefix}{call.function}({named_arguments(named)})"
        return f"{STANDARD_NAMES.get(call.function, call.function.upper())}({', '.join(given)})"


def declaration(word: str, variables: Mapping[str, str]) -> list[str]:
    """Return a section of declarations, or nothing if there are no variables."""
    return [word, *(f"    {name} : {kind};" for name, kind in variables.items()), "END_VAR"] if variables else []


def named_arguments(values: Mapping[str, str]) -> str:
    """Return the arguments of a call, each with its name."""
    return ", ".join(f"{name} := {value}" for name, value in values.items())


def st_text(blocks: Sequence[Block], name: str, notes: Sequence[str], is_single: bool = False) -> str:
    """Return the file; all of its names begin with `name`, an identifier, and `notes` are in its first comment."""
    printer = StPrinter(f"{name}_", is_single)
    head = "\n".join(["(*", *(f"   {comment(note)}".rstrip() for note in notes), "*)", ""])
    functions = [printer.function(each) for each in with_calls([block.program for block in blocks])]
    parts = [*(_block_text(block, printer) for block in blocks), _test_text(blocks, printer)]
    return "\n".join([head, printer.helpers(), *functions, *parts])


def _block_names(block: Block) -> dict[str, str]:
    names = [*block.states, *tables_of(block.program), *block.numbers, block.output.name]
    return safe_names(dict.fromkeys(names), ST_WORDS, True)


def _function_names(block: Block) -> dict[str, str]:
    """Return the names of the function's parameters, which are made as its printer makes them."""
    program = block.program
    own = [parameter.name for parameter in program.parameters]
    names = [*program.arrays, *own, *program.variables, *tables_of(program)]
    return safe_names(dict.fromkeys(names), ST_WORDS, True)


def _block_text(block: Block, printer: StPrinter) -> str:
    names, inner, tables = _block_names(block), _function_names(block), tables_of(block.program)
    inputs = [_declared(one, names, printer) for one in block.inputs]
    settings = [_declared_setting(one, names, printer) for one in block.settings]
    output = _declared(block.output, names, printer)
    states = {names[one]: printer.array_type(size) for one, size in block.states.items()}
    given = {inner[name]: names[name] for name in (*block.states, *tables, *block.numbers)}
    held = [printer.table(names[name], values) for name, values in tables.items()]
    return "\n".join(
        [
            f"FUNCTION_BLOCK FB_{printer.prefix}{block.name} (* {comment(block.summary)} *)",
            *("VAR_INPUT", *inputs, *settings, "END_VAR", "VAR_OUTPUT", output, "END_VAR"),
            *declaration("VAR", states),
            *(("VAR", *held, "END_VAR") if held else ()),
            f"{names[block.output.name]} := {printer.prefix}{block.name}({named_arguments(given)});",
            "END_FUNCTION_BLOCK",
            "",
        ]
    )


def _declared(one: BlockInput, names: Mapping[str, str], printer: StPrinter) -> str:
    return f"    {names[one.name]} : {printer.real}; (* {comment(one.meaning)} [{one.unit}] *)"


def _declared_setting(one: Setting, names: Mapping[str, str], printer: StPrinter) -> str:
    """Return the declaration of an input with a first value, which is 0 as long as it has to be stated."""
    unknown = "" if one.value is not None else "; it is not known: state it"
    value = real_literal(one.value or 0.0)
    return f"    {names[one.name]} : {printer.real} := {value}; (* {comment(one.meaning)} [{one.unit}]{unknown} *)"


def _test_text(blocks: Sequence[Block], printer: StPrinter) -> str:
    """Return a program that computes the greatest relative error of all blocks along their test vectors."""
    declared = [line for block in blocks for line in _vector_lines(block, printer)]
    own = {"k": "DINT", "is_done": "BOOL", "worst_error": printer.real, "scale": printer.real}
    own |= {f"{block.name}_error": printer.real for block in blocks}
    return "\n".join(
        [
            f"PROGRAM {printer.prefix}self_test (* one cycle computes worst_error, the greatest relative error *)",
            *declaration("VAR", own),
            *("VAR", *declared, "END_VAR"),
            "IF NOT is_done THEN",
            *(line for block in blocks for line in _test_lines(block)),
            *("    is_done := TRUE;", "END_IF;", "END_PROGRAM", ""),
        ]
    )


def _vector_lines(block: Block, printer: StPrinter) -> list[str]:
    return [
        f"    {block.name}_block : FB_{printer.prefix}{block.name};",
        printer.table(f"{block.name}_inputs", block.test_inputs),
        printer.table(f"{block.name}_outputs", block.test_outputs),
    ]


def _test_lines(block: Block) -> list[str]:
    names, count = _block_names(block), len(block.inputs)
    places = {names[one.name]: f"{block.name}_inputs[{count} * k + {i}]" for i, one in enumerate(block.inputs)}
    places |= {names[one.name]: real_literal(one.test_value) for one in block.settings}
    found = f"{block.name}_block.{names[block.output.name]}"
    return [
        f"    scale := {real_literal(1e-30)};",
        f"    FOR k := 0 TO {len(block.test_outputs) - 1} DO",
        f"        {block.name}_block({named_arguments(places)});",
        f"        {block.name}_error := MAX({block.name}_error, ABS({found} - {block.name}_outputs[k]));",
        f"        scale := MAX(scale, ABS({block.name}_outputs[k]));",
        "    END_FOR;",
        f"    {block.name}_error := {block.name}_error / scale;",
        f"    worst_error := MAX(worst_error, {block.name}_error);",
    ]
