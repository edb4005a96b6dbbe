"""What ``import fraexp`` promises: its names, what they say of themselves, and that importing it costs nothing."""

import inspect
import json
import subprocess
import sys

import pytest

import fraexp
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S

STABLE = [
    "FraexpError",
    "FrictionLaw",
    "Identification",
    "Recording",
    "Results",
    "Run",
    "Study",
    "SweepResult",
    "Workspace",
    "estimate",
    "friction_law",
    "identify",
    "read_record",
    "run",
    "simulate",
]
"""A name that is dropped or renamed breaks the scripts of others: see CHANGELOG.md before this list is changed."""


def test_the_public_names_are_stable_and_exist() -> None:
    assert sorted(fraexp.__all__) == STABLE
    assert all(getattr(fraexp, name) is not None for name in STABLE)
    assert set(STABLE) <= set(dir(fraexp))


def test_another_name_is_refused() -> None:
    with refused(AttributeError, "'Wrkspace'"):
        _ = fraexp.Wrkspace  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", STABLE)
def test_everything_public_is_documented(name: str) -> None:
    found = getattr(fraexp, name)
    assert inspect.getdoc(found)
    if inspect.isclass(found) and name != "FraexpError":
        methods = [of for of in vars(found) if not of.startswith("_") and callable(getattr(found, of, None))]
        assert [of for of in methods if not inspect.getdoc(getattr(found, of))] == []


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, fraexp, json; print(json.dumps([name.partition('.')[0] for name in sys.modules]))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=HANG_TIMEOUT_S
    )
    heavy = {"numpy", "numba", "scipy", "pydantic", "sqlalchemy", "matplotlib", "textual", "xarray", "pandas"}
    assert heavy & set(json.loads(done.stdout)) == set()
