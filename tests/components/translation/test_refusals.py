"""What cannot be translated is refused by its line, with what is expected."""

import re
from pathlib import Path

import numpy as np
import pytest

from fraexp.components.local_file import load_file
from fraexp.components.translation.c_code import CLanguage
from fraexp.components.translation.translator import REAL_INPUT, translate
from fraexp.errors import PluginError

REFUSED = {
    "while x > 0: x -= 1.0": "uses 'while'; its time is not bounded",
    "y = [x, x]": r"uses \[x, x\]",
    "y = 'text'": "uses 'text'",
    "for a in z: x += a": "loops over z; loop over a range",
    "x = z + 1.0": "computes with a whole array; loop over its elements",
    "z[:] = z": r"writes to a part of an array; write its elements in a loop",
    "y = x % 2.0": r"uses x % 2.0; expected \+ - \* / \*\* & |",
    "y = x // 2.0": "uses x // 2.0",
    "y = math.gamma(x)": "calls math.gamma",
    "y = unknown": "uses 'unknown', which is not defined",
    "y = x.real": "uses x.real",
    "z[3] = 1.0": r"uses z\[3\] of 3 elements",
    "z[x] = 1.0": "needs a whole number for x",
    "table[0] = 1.0": "writes to a constant",
    "y = max(x, key=abs)": "named arguments",
    "try: pass\n    except ValueError: pass": "uses 'try'",
    "with x: pass": "uses 'with'",
    "global other": "uses 'global'",
    "y = lambda: x": "uses lambda",
    "y = x if x > 0 else 'no'": "uses 'no'",
    "y = (x > 0) + 1.0": "mixes numbers and truth values",
    "return": "returns nothing; return a number",
    "y = again(z, x, table)": "calls itself",
    "for i in range(3): i = 2": "loops with i, which is written inside",
    "for i in range(3):\n        for i in range(2): x += 1.0": "loops with i, which is written",
    "for i in range(3): x += 1.0\n    x = x + i": "uses 'i', which is not defined",
    "y = z if x > 0 else table": "computes with a whole array",
    "y = x is None": "uses None; use numbers",
    "y = f'{x}'": "uses f",
    "a = 1.0\n    a = x > 0": "uses 'a' for a number and a truth value",
}


@pytest.mark.parametrize(("line", "message"), REFUSED.items())
def test_a_line_that_cannot_be_translated_is_named(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / "refused_law.py"
    file.write_text(f"import math\n\ndef again(z, x, table):\n    {line}\n    return x\n", encoding="utf-8")
    function, numbers = load_file(file).again, np.ones(2)
    with pytest.raises(PluginError, match=message) as caught:
        translate("again", function, {"x": REAL_INPUT, "table": numbers}, {"z": 3}, CLanguage("axis_"))
    assert re.match(r"again \(refused_law.py, line [3-6]\) \w+", str(caught.value))
    assert "\n" not in str(caught.value)


def test_a_function_without_source_is_refused() -> None:
    with pytest.raises(PluginError, match="the source is not available"):
        translate("made", eval("lambda x: x"), {"x": REAL_INPUT}, {}, CLanguage("axis_"))
