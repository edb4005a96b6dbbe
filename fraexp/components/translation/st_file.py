"""Blocks of a controller as one file of Structured Text: functions, function blocks and a program that tests them."""

from collections.abc import Mapping, Sequence

from fraexp.components.translation.blocks import Block, BlockInput, Setting
from fraexp.components.translation.c_code import comment
from fraexp.components.translation.identifiers import ST_WORDS, safe_names
from fraexp.components.translation.structured_text import (
    StPrinter,
    declaration,
    named_arguments,
    real_literal,
    tables_of,
)
from fraexp.components.translation.syntax_tree import with_calls


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
