"""What identifies a friction law: all code and constants that decide what it computes, and nothing else."""

import importlib.util
from pathlib import Path

import numba
import pytest

from fraexp.kernels.law import Law, called_functions, fingerprint

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
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
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


def test_a_constant_that_is_changed_is_seen(tmp_path: Path) -> None:
    before = read_law(tmp_path)
    assert fingerprint(before) != fingerprint(read_law(tmp_path, factor="2.0"))
