"""Blocks of a controller as one file of C99: functions, states, and a test that a compiler's option turns on."""

from collections.abc import Sequence

from fraexp.components.translation.blocks import Block, Setting
from fraexp.components.translation.c_code import CPrinter, comment
from fraexp.components.translation.identifiers import C_WORDS, safe_names
from fraexp.components.translation.syntax_tree import with_calls

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
