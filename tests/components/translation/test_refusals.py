"""What cannot be translated is refused by its line, with what is expected."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.components.local_file import load_file
from fraexp.components.translation.c_code import CLanguage
from fraexp.components.translation.translator import REAL_INPUT, translate
from fraexp.errors import PluginError
from tests.refusals import refused

REFUSED = {
    "while x > 0: x -= 1.0": "'while'",
    "y = [x, x]": "[x, x]",
    "y = 'text'": "'text'",
    "for a in z: x += a": "over z",
    "x = z + 1.0": "whole array",
    "z[:] = z": "part",
    "y = x % 2.0": "x % 2.0",
    "y = x // 2.0": "x // 2.0",
    "y = math.gamma(x)": "math.gamma",
    "y = unknown": "'unknown'",
    "y = x.real": "x.real",
    "z[3] = 1.0": "z[3]",
    "z[x] = 1.0": "for x",
    "table[0] = 1.0": "constant",
    "y = max(x, key=abs)": "named arguments",
    "try: pass\n    except ValueError: pass": "'try'",
    "with x: pass": "'with'",
    "global other": "'global'",
    "y = lambda: x": "lambda",
    "y = x if x > 0 else 'no'": "'no'",
    "y = (x > 0) + 1.0": "truth values",
    "return": "nothing",
    "y = again(z, x, table)": "itself",
    "for i in range(3): i = 2": "with i",
    "for i in range(3):\n        for i in range(2): x += 1.0": "with i",
    "for i in range(3): x += 1.0\n    x = x + i": "'i'",
    "y = z if x > 0 else table": "whole array",
    "y = x is None": "None",
    "y = f'{x}'": "f",
    "a = 1.0\n    a = x > 0": "'a'",
}


@pytest.mark.parametrize(("line", "name"), REFUSED.items())
def test_a_line_that_cannot_be_translated_is_named(tmp_path: Path, line: str, name: str) -> None:
    file = tmp_path / "refused_law.py"
    file.write_text(f"import math\n\ndef again(z, x, table):\n    {line}\n    return x\n", encoding="utf-8")
    function, numbers = load_file(file).again, np.ones(2)
    with refused(PluginError, "again", "refused_law.py", name):
        translate("again", function, {"x": REAL_INPUT, "table": numbers}, {"z": 3}, CLanguage("axis_"))


def test_a_function_without_source_is_refused() -> None:
    with refused(PluginError, "lambda", "source"):
        translate("made", eval("lambda x: x"), {"x": REAL_INPUT}, {}, CLanguage("axis_"))
