"""What identifies a friction law: all code and constants that decide what it computes, and nothing else."""

import types
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from fraexp.kernels.law import INSTEAD, Law, called_functions, explain_compiler_errors, fingerprint
from fraexp.kernels.law_error import LawError
from tests.examples import some

HELPER = """
def halved(x, times):
    return x if times == 0 else halved(0.5 * x, times - 1)
"""
LAW = """
FACTOR = {factor}


def law(z, dy, dt, z_next, stiffness):
    z_next[0] = z[0] + dy
    return FACTOR * halved(stiffness * z_next[0], 3)
"""


def load(path: Path, text: str, **names: object) -> dict[str, object]:
    """Return the names of a module, compiled from its text: Python takes the bytecode of a quick edit for current."""
    path.write_text(text, encoding="utf-8")
    module = types.ModuleType(path.stem)
    exec(compile(text, path, "exec"), vars(module))
    vars(module).update(names)
    return vars(module)


def read_law(folder: Path, *, factor: str = "1.0", helper: str = HELPER, is_compiled: bool = False) -> Law:
    """Return a law whose helper, which calls itself, lives in another file."""
    halved = load(folder / "helper.py", helper)["halved"]
    law = load(folder / "law.py", LAW.format(factor=factor), halved=numba.njit(halved) if is_compiled else halved)
    return law["law"]  # type: ignore[return-value]


def test_a_helper_that_calls_itself_is_counted_once(tmp_path: Path) -> None:
    assert [helper.__name__ for helper in called_functions(read_law(tmp_path))] == ["halved"]


@pytest.mark.parametrize("is_compiled", [False, True], ids=["plain", "compiled by its author"])
def test_an_edit_of_a_helper_in_another_file_is_seen(tmp_path: Path, is_compiled: bool) -> None:
    before = fingerprint(read_law(tmp_path, is_compiled=is_compiled))
    assert fingerprint(read_law(tmp_path, is_compiled=is_compiled)) == before
    edited = HELPER.replace("0.5", "0.25")
    assert fingerprint(read_law(tmp_path, helper=edited, is_compiled=is_compiled)) != before


CELL = """
import math
import numpy as np

def law(z, dy, dt, z_next, stiffness):
    z_next[0] = min(max(z[0] + stiffness * dy, -15.0), 15.0)
    return math.sin(z_next[0]) + {more}
"""
EDITS = {
    "a literal": ("15.0", "5.0"),
    "a function of a module": ("math.sin", "math.cos"),
    "a constant of a module": ("{more}", "math.pi"),
    "a comparison": ("min(max", "max(min"),
}


def define_law(text: str) -> Law:
    """Return a law of a notebook's cell, which has no file."""
    names: dict[str, object] = {"__name__": "__main__"}
    exec(compile(text.format(more="math.e"), "<cell>", "exec"), names)
    return names["law"]  # type: ignore[return-value]


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_is_seen_in_a_cell_that_has_no_file(edit: str) -> None:
    assert fingerprint(define_law(CELL)) == fingerprint(define_law(CELL.replace("\n    z_next", "\n\n    z_next")))
    assert fingerprint(define_law(CELL)) != fingerprint(define_law(CELL.replace(*EDITS[edit])))


def test_constants_of_other_modules_and_defaults_are_seen(tmp_path: Path) -> None:
    def law(limit: float, default: float) -> Law:
        limits = load(tmp_path / "limits.py", f"LIMIT = {limit}")
        module = types.ModuleType("limits")
        vars(module).update(limits)
        text = (
            f"def law(z, dy, dt, z_next, k={default}):\n    z_next[0] = min(k * dy, limits.LIMIT)\n    return z_next[0]"
        )
        return load(tmp_path / "law.py", text, limits=module)["law"]  # type: ignore[return-value]

    assert len({fingerprint(law(*of)) for of in ((1.0, 2.0), (3.0, 2.0), (1.0, 4.0), (1.0, 2.0))}) == 3


def test_it_is_that_of_the_law_that_was_loaded(tmp_path: Path) -> None:
    law = read_law(tmp_path)
    before = fingerprint(law)
    (tmp_path / "law.py").write_text(LAW.format(factor="7.0"))
    assert fingerprint(law) == before


UNSUPPORTED = {
    "clip": "np.clip(dy, -1.0, 1.0)",
    "heaviside": "np.heaviside(dy, 0.5)",
    "piecewise": "np.piecewise(dy, [dy > 0], [1.0, 0.0])",
    "select": "np.select([dy > 0], [dy], dt)",
    "norm": "np.linalg.norm(dy)",
    "dot": "np.dot(dy, dt)",
    "polyval": "np.polyval(np.array([1.0, 2.0]), dy)",
    "cbrt": "math.cbrt(dy)",
    "dist": "math.dist((dy,), (dt,))",
    "fmod": "math.fmod(dy, dt)",
    "fsum": "math.fsum((dy, dt))",
    "prod": "math.prod((dy, dt))",
}


@pytest.mark.parametrize("name", some(INSTEAD, "clip"))
def test_a_function_that_the_compiler_lacks_is_named_with_what_to_write(tmp_path: Path, name: str) -> None:
    text = f"import math\nimport numpy as np\n\ndef law(z, dy, dt, z_next):\n    return {UNSUPPORTED[name]}"
    law: Any = load(tmp_path / "law.py", text)["law"]
    compiled: Any = numba.njit()(law)
    with pytest.raises(LawError) as raised, explain_compiler_errors(law):
        compiled(np.zeros(1), 0.5, 2.0, np.zeros(1))
    assert str(raised.value).endswith(f"{name} does not take single numbers there: write {INSTEAD[name]}")
