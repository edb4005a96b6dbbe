"""Translated functions and blocks of a controller as one file of IEC 61131-3 Structured Text, with a test program.

Arrays are passed by VAR_IN_OUT.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.blocks import Block, BlockInput, Setting
from fraexp.components.translation.language import (
    Constant,
    Expression,
    Function,
    Language,
    Text,
    Type,
    comment,
    indented,
    safe_names,
    with_calls,
)

RESERVED_TEXT = """
    abs acos action add adr and any array asin at atan begin bool by byte case concat configuration constant cos date
    delete dint div do dt dword else elsif end eq exit exp expt false find for from function ge global gt if in
    input insert int interface interval jmp le left len limit lint ln log lower_bound lreal lt lword max method mid
    min mod move mul mux ne not of on or output pointer priority program property r_edge f_edge read_only read_write
    real ref reference repeat replace resource ret retain return right rol ror rs s sel shl shr sin sint single
    sizeof sqrt sr step string struct sub super tan task then this time to tod transition trunc true type udint
    uint ulint until upper_bound usint var wait while with word wstring xor r ld st n p l d c t q e continue
"""
RESERVED = frozenset(RESERVED_TEXT.split())
"""Reserved words, standard functions and edge names of IEC 61131-3 and its dialects."""
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
VALUES_PER_LINE = 6


class StructuredText(Language):
    """IEC 61131-3 Structured Text."""

    operators: ClassVar[Mapping[str, str]] = {
        "and": "AND",
        "or": "OR",
        "not": "NOT ",
        "negate": "-",
        "==": "=",
        "!=": "<>",
    }
    math_names: ClassVar[Mapping[str, str]] = {"log": "LN", "pow": "EXPT", "truncate": "TRUNC"}
    statements: ClassVar[Mapping[str, str]] = {
        "=": "{} := {};", "if": "IF {} THEN", "else": "ELSE", "end if": "END_IF;", "break": "EXIT;",
        "continue": "CONTINUE;",
    }  # fmt: skip

    def __init__(self, prefix: str, is_single: bool = False) -> None:
        super().__init__(prefix)
        self.real = "REAL" if is_single else "LREAL"

    def declared_names(self, function: Function) -> dict[str, str]:
        """Return the names of arrays, parameters, variables, and tables, which callers pass."""
        own = [parameter.name for parameter in function.parameters]
        names = dict.fromkeys([*function.arrays, *own, *function.variables, *function.all_tables])
        return safe_names(names, RESERVED, True)

    def type_name(self, kind: Type) -> str:
        """Return the type of a variable."""
        return {"real": self.real, "int": "DINT", "bool": "BOOL"}[kind]

    def number(self, number: Constant) -> str:
        """Return a constant."""
        if number.type == "bool":
            return "TRUE" if number.value else "FALSE"
        return real_literal(float(number.value)) if number.type == "real" else str(int(number.value))

    def operand(self, function: Function, expression: Expression) -> str:
        """Return an expression as an operand of another one; two signs must not follow each other."""
        text = super().operand(function, expression)
        return f"({text})" if text.startswith("-") else text

    def element(self, function: Function, array: str, index: Expression) -> Text:
        """Return an element of an array that the function is given."""
        name = f"{function.name}_{array}" if array in function.tables else array
        return Text(f"{function.names.get(name, name)}[{self.text(function, index)}]", "real")

    def library_call(self, function: Function, name: str, given: Sequence[Expression], kind: Type) -> Text:
        """Return the call of a function of the standard or of the helpers."""
        texts = [self.text(function, argument) for argument in given]
        called = self.math_names.get(name, name.upper())
        if name == "real":
            called = f"DINT_TO_{self.real}"
            if given[0].type == "bool":
                called, texts = "SEL", [texts[0], "0.0", "1.0"]
        elif name == "choose":
            called, texts = "SEL", [texts[0], texts[2], texts[1]]
        elif name in HELPER_INPUTS:
            named = dict(zip(HELPER_INPUTS[name], texts, strict=True))
            return Text(f"{self.prefix}{name}({named_arguments(named)})", kind)
        return Text(f"{called}({', '.join(texts)})", kind)

    def call(self, function: Function, called: Function, arrays: Sequence[str], given: Sequence[Expression]) -> Text:
        """Return the call of another function, with its arguments by their names and the tables that it uses."""
        names = function.names
        named = {called.names[of]: names.get(name, name) for of, name in zip(called.arrays, arrays, strict=True)}
        named |= {called.names[name]: names.get(name, name) for name in called.all_tables}
        numbers = zip(called.parameters, given, strict=True)
        named |= {called.names[one.name]: self.text(function, value) for one, value in numbers}
        return Text(f"{self.prefix}{called.name}({named_arguments(named)})", "real")

    def loop(
        self, function: Function, counter: str, start: Expression, stop: Expression, step: int, body: Sequence[str]
    ) -> list[str]:
        """Return the lines of a FOR, whose last value is part of it."""
        last = f"{self.operand(function, stop)} {'-' if step > 0 else '+'} 1"
        if isinstance(stop, Constant):
            last = str(int(stop.value) + (-1 if step > 0 else 1))
        by = "" if step == 1 else f" BY {step}"
        head = f"FOR {counter} := {self.text(function, start)} TO {last}{by} DO"
        return [head, *indented(body or [";"]), "END_FOR;"]

    def return_value(self, function: Function, value: str) -> list[str]:
        """Return the lines that set the result and leave the function."""
        return [f"{self.prefix}{function.name} := {value};", "RETURN;"]

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
        names = function.names
        sizes = {**function.arrays, **{name: table.size for name, table in function.all_tables.items()}}
        shared = {names[name]: self.array_type(size) for name, size in sizes.items()}
        given = {names[one.name]: self.type_name(one.type) for one in function.parameters}
        local = {names[name]: self.type_name(kind) for name, kind in function.variables.items()}
        head = f"FUNCTION {self.prefix}{function.name} : {self.real} (* {comment(function.summary)} *)"
        sections = (("VAR_IN_OUT", shared), ("VAR_INPUT", given), ("VAR", local))
        declared = [line for word, variables in sections for line in declaration(word, variables)]
        body = function.body[:-1] if function.body[-1:] == ["RETURN;"] else function.body
        return "\n".join([head, *declared, *body, "END_FUNCTION", ""])


def real_literal(value: float) -> str:
    """Return a real number as the standard writes it, with a point."""
    mantissa, e, exponent = repr(value).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{'E' if e else ''}{exponent}"


def declaration(word: str, variables: Mapping[str, str]) -> list[str]:
    """Return a section of declarations, or nothing if there are no variables."""
    return [word, *(f"    {name} : {kind};" for name, kind in variables.items()), "END_VAR"] if variables else []


def named_arguments(values: Mapping[str, str]) -> str:
    """Return the arguments of a call, each with its name."""
    return ", ".join(f"{name} := {value}" for name, value in values.items())


def st_text(blocks: Sequence[Block], name: str, notes: Sequence[str], is_single: bool = False) -> str:
    """Return the file; all of its names begin with `name`, an identifier, and `notes` are in its first comment."""
    language = StructuredText(f"{name}_", is_single)
    head = "\n".join(["(*", *(f"   {comment(note)}".rstrip() for note in notes), "*)", ""])
    helpers = HELPERS.format(prefix=language.prefix, real=language.real)
    programs = [block.program(language) for block in blocks]
    functions = [language.function(each) for each in with_calls(programs)]
    texts = [_block_text(block, program, language) for block, program in zip(blocks, programs, strict=True)]
    return "\n".join([head, helpers, *functions, *texts, _test_text(blocks, programs, language)])


def _block_names(block: Block, program: Function) -> dict[str, str]:
    names = [*block.states, *program.all_tables, *block.numbers, block.output.name]
    return safe_names(dict.fromkeys(names), RESERVED, True)


def _block_text(block: Block, program: Function, language: StructuredText) -> str:
    names, tables = _block_names(block, program), program.all_tables
    inputs = [_declared(one, names, language) for one in block.inputs]
    settings = [_declared_setting(one, names, language) for one in block.settings]
    output = _declared(block.output, names, language)
    states = {names[one]: language.array_type(size) for one, size in block.states.items()}
    given = {program.names[name]: names[name] for name in (*block.states, *tables, *block.numbers)}
    held = [language.table(names[name], values) for name, values in tables.items()]
    finite = " AND ".join(f"{one} - {one} = 0.0" for one in (names[one.name] for one in block.inputs))
    return "\n".join(
        [
            f"FUNCTION_BLOCK FB_{language.prefix}{block.name} (* {comment(block.summary)} *)",
            *("VAR_INPUT", *inputs, *settings, "END_VAR", "VAR_OUTPUT", output, "END_VAR"),
            *declaration("VAR", states),
            *(("VAR", *held, "END_VAR") if held else ()),
            f"IF {finite} THEN",
            f"    {names[block.output.name]} := {language.prefix}{block.name}({named_arguments(given)});",
            "ELSE (* an input is not a finite number: the states stay as they were *)",
            f"    {names[block.output.name]} := 0.0;",
            *("END_IF;", "END_FUNCTION_BLOCK"),
            "",
        ]
    )


def _declared(one: BlockInput, names: Mapping[str, str], language: StructuredText) -> str:
    return f"    {names[one.name]} : {language.real}; (* {comment(one.meaning)} [{one.unit}] *)"


def _declared_setting(one: Setting, names: Mapping[str, str], language: StructuredText) -> str:
    """Return the declaration of an input with a first value, which is 0 as long as it has to be stated."""
    unknown = "" if one.value is not None else "; it is not known: state it"
    value = real_literal(one.value or 0.0)
    return f"    {names[one.name]} : {language.real} := {value}; (* {comment(one.meaning)} [{one.unit}]{unknown} *)"


def _test_text(blocks: Sequence[Block], programs: Sequence[Function], language: StructuredText) -> str:
    """Return a program that computes the greatest relative error of all blocks along their test vectors."""
    declared = [line for block in blocks for line in _vector_lines(block, language)]
    own = {"k": "DINT", "is_done": "BOOL", "worst_error": language.real, "scale": language.real}
    own |= {f"{block.name}_error": language.real for block in blocks}
    return "\n".join(
        [
            f"PROGRAM {language.prefix}self_test (* one cycle computes worst_error, the greatest relative error *)",
            *declaration("VAR", own),
            *("VAR", *declared, "END_VAR"),
            "IF NOT is_done THEN",
            *(line for each in zip(blocks, programs, strict=True) for line in _test_lines(*each)),
            *("    is_done := TRUE;", "END_IF;", "END_PROGRAM", ""),
        ]
    )


def _vector_lines(block: Block, language: StructuredText) -> list[str]:
    return [
        f"    {block.name}_block : FB_{language.prefix}{block.name};",
        language.table(f"{block.name}_inputs", block.test_inputs),
        language.table(f"{block.name}_outputs", block.test_outputs),
    ]


def _test_lines(block: Block, program: Function) -> list[str]:
    names, count = _block_names(block, program), len(block.inputs)
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
