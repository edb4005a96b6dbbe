"""Translated functions and blocks of a controller as one file of C99, with a test that a compiler option turns on."""

import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.components.translation.blocks import Block, Setting
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
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    main self exp expm1 log sqrt sin cos tan asin acos atan tanh copysign pow fabs real y0 y1 yn j0 j1 jn gamma
    class new delete this template private public operator try catch bool true false and or not xor
"""
RESERVED = frozenset(RESERVED_TEXT.split())
"""Reserved words of C and C++, and names of <tgmath.h>."""
HELPERS = """\
typedef {prefix}REAL {prefix}real; /* double, or float by -D{prefix}REAL=float */

static inline {prefix}real {prefix}min({prefix}real a, {prefix}real b) {{ return b < a ? b : a; }}
static inline {prefix}real {prefix}max({prefix}real a, {prefix}real b) {{ return b > a ? b : a; }}
static inline int {prefix}is_finite({prefix}real a) {{ return a - a == 0; }}
static inline int {prefix}min_int(int a, int b) {{ return b < a ? b : a; }}
static inline int {prefix}max_int(int a, int b) {{ return b > a ? b : a; }}
static inline int {prefix}wrap(int index, int size) {{ return index < 0 ? index + size : index; }}
"""
"""What all files begin with: the type of real numbers, and functions with the meaning that they have in Python."""
VALUES_PER_LINE = 4


class CLanguage(Language):
    """C99."""

    operators: ClassVar[Mapping[str, str]] = {"and": "&&", "or": "||", "not": "!", "negate": "-"}
    math_names: ClassVar[Mapping[str, str]] = {"abs": "fabs"}
    statements: ClassVar[Mapping[str, str]] = {
        "=": "{} = {};", "if": "if ({}) {{", "else": "} else {", "end if": "}", "break": "break;",
        "continue": "continue;",
    }  # fmt: skip

    def declared_names(self, function: Function) -> dict[str, str]:
        """Return the names of arrays, parameters and variables."""
        own = [parameter.name for parameter in function.parameters]
        return safe_names(dict.fromkeys([*function.arrays, *own, *function.variables]), RESERVED, False)

    def type_name(self, kind: Type) -> str:
        """Return the type of a variable."""
        return f"{self.prefix}real" if kind == "real" else "int"

    def number(self, number: Constant) -> str:
        """Return a constant."""
        if number.type != "real":
            return str(int(number.value))
        value = float(number.value)
        text = repr(value)
        return f"({self.prefix}real){text if value >= 0 else f'({text})'}" if np.isfinite(value) else "HUGE_VAL"

    def element(self, function: Function, array: str, index: Expression) -> Text:
        """Return an element of an array of the function, or of a table of the file."""
        name = f"{self.prefix}{function.name}_{array}" if array in function.tables else function.names.get(array, array)
        return Text(f"{name}[{self.text(function, index)}]", "real")

    def library_call(self, function: Function, name: str, given: Sequence[Expression], kind: Type) -> Text:
        """Return the call of a function of <tgmath.h> or of the helpers."""
        texts = [self.text(function, argument) for argument in given]
        if name in ("real", "truncate"):
            return Text(f"({self.type_name(kind)})({texts[0]})", kind)
        if name == "choose":
            return Text(f"{self.operand(function, given[0])} ? {texts[1]} : {texts[2]}", kind, is_compound=True)
        called = self.math_names.get(name, name)
        if name in ("min", "max", "wrap"):
            called = f"{self.prefix}{name}{'_int' if kind == 'int' and name != 'wrap' else ''}"
        return Text(f"{called}({', '.join(texts)})", kind)

    def call(self, function: Function, called: Function, arrays: Sequence[str], given: Sequence[Expression]) -> Text:
        """Return the call of another function."""
        texts = [function.names.get(name, name) for name in arrays]
        texts += [self.text(function, argument) for argument in given]
        return Text(f"{self.prefix}{called.name}({', '.join(texts)})", "real")

    def loop(
        self, function: Function, counter: str, start: Expression, stop: Expression, step: int, body: Sequence[str]
    ) -> list[str]:
        """Return the lines of a `for`."""
        sign, first, last = "<" if step > 0 else ">", self.text(function, start), self.text(function, stop)
        head = f"for ({counter} = {first}; {counter} {sign} {last}; {counter} += {step}) {{"
        return [head, *indented(body), "}"]

    def return_value(self, function: Function, value: str) -> list[str]:
        """Return the line of a `return`."""
        return [f"return {value};"]

    def table(self, name: str, values: NDArray[np.float64]) -> str:
        """Return an array of constants."""
        texts = [self.number(Constant(float(value), "real")) for value in values.ravel()]
        lines = [texts[k : k + VALUES_PER_LINE] for k in range(0, len(texts), VALUES_PER_LINE)]
        rows = ",\n".join(f"    {', '.join(line)}" for line in lines)
        declared = f"static const {self.prefix}real {self.prefix}{name}[{max(values.size, 1)}]"
        return f"{declared} = {{\n{rows or '    0'}\n}};\n"

    def function(self, function: Function) -> str:
        """Return a function, behind the tables that it uses."""
        names, real = function.names, self.type_name("real")
        tables = "".join(self.table(f"{function.name}_{name}", each) for name, each in function.tables.items())
        arrays = [f"{real} *{names[name]}" for name in function.arrays]
        numbers = [f"{self.type_name(one.type)} {names[one.name]}" for one in function.parameters]
        given = ", ".join([*arrays, *numbers]) or "void"
        head = f"/* {comment(function.summary)} */\nstatic inline {real} {self.prefix}{function.name}({given})"
        declared = [f"{self.type_name(kind)} {names[name]} = 0;" for name, kind in function.variables.items()]
        used = set(re.findall(r"\w+", " ".join(function.body)))
        given_names = [names[name] for name in (*function.arrays, *(one.name for one in function.parameters))]
        unused = [f"(void){name};" for name in given_names if name not in used]
        return "\n".join([tables + head + " {", *indented([*declared, *unused, *function.body]), "}", ""])


TEST_TOLERANCE = {"double": 1e-12, "float": 1e-4}
"""Error of the test's outputs, relative to the greatest one, by type: libraries of mathematics differ in rounding."""


def c_text(blocks: Sequence[Block], name: str, notes: Sequence[str], is_single: bool = False) -> str:
    """Return the file; all of its names begin with `name`, an identifier, and `notes` are in its first comment."""
    prefix, real = f"{name}_", "float" if is_single else "double"
    language = CLanguage(prefix)
    head = "\n".join(["/*", *(f" * {comment(note)}".rstrip() for note in notes), " */"])
    functions = [language.function(each) for each in with_calls([block.program(language) for block in blocks])]
    return "\n".join(
        [
            head,
            f"#ifndef {prefix}INCLUDED\n#define {prefix}INCLUDED\n",
            "#include <math.h>\n#include <tgmath.h>\n",
            f"#ifndef {prefix}REAL\n#define {prefix}REAL {real}\n#endif\n",
            *(_setting_text(each, prefix) for each in _settings(blocks)),
            HELPERS.format(prefix=prefix),
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
    states = safe_names(block.states, RESERVED, False)
    inputs = safe_names([one.name for one in block.inputs], RESERVED, False)
    members = "".join(f"    {real} {states[one]}[{max(size, 1)}];\n" for one, size in block.states.items())
    meanings = [f" * {inputs[one.name]}: {one.meaning} [{one.unit}]" for one in block.inputs]
    given = "".join(f", {real} {inputs[one.name]}" for one in block.inputs)
    finite = " && ".join(f"{prefix}is_finite({one})" for one in inputs.values())
    settings = [f"({real}){prefix}{one.name.upper()}" for one in block.settings]
    called = ", ".join([*(f"state->{states[one]}" for one in block.states), *inputs.values(), *settings])
    return "\n".join(
        [
            f"typedef struct {{\n{members or '    char empty;'}}} {label}_state;\n",
            f"static inline void {label}_reset({label}_state *state) {{\n    *state = ({label}_state){{0}};\n}}\n",
            f"/* {comment(block.summary)}",
            *(f" {comment(meaning)}" for meaning in meanings),
            f" * Returns: {comment(block.output.meaning)} [{block.output.unit}]; 0, with the states as they were, if",
            " * an input is not a finite number. Call it once per sample. */",
            f"static inline {real} {label}_step({label}_state *state{given}) {{",
            f"    return {finite} ? {label}({called}) : 0;\n}}\n",
        ]
    )


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
