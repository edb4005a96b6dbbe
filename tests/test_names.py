"""Names explain themselves: functions are verbs or nouns, constants say what they limit and in which unit."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.source_trees import syntax_tree

ROOT = Path(__file__).parents[1]
FOLDERS = ("fraexp", "plugins")
NO_FUNCTION_NAMES = frozenset(
    """
    told said taken took kept held given made done found drawn written seen shown stood laid put within around
    outside inside beside instead by at with without under over apart aside sound known wanted named listed
    counted cut sized fitted filled used replaced resolved bound fed wrapped joined merged looked turned moved
    left gone meant begun ended settled measured driven predicted prepared chosen allowed asked answered called
    caught checked compared computed cleaned closed described differing explained followed interpreted
    interrupted loaded lost marked missed mended modest nested opened ordered parsed perturbed placed planned
    pooled quoted reached recorded reduced refined removed renamed rounded sampled shared shortened smoothed
    solved sorted started stated stored supplied swept tagged tried typed varied weighted widened stood_in
    laid_in put_back in_turn
    """.split()  # noqa: SIM905
)
"""Participles and prepositions: alone they say neither what a function does nor what it returns."""
NO_CONSTANT_NAMES = re.compile(
    r"^_?(MOST|LEAST|LONGEST|SHORTEST|LARGEST|SMALLEST|FEW|FEWEST|MANY|DEEPEST|SAME|GOOD|SOFT|LOOK|TELL|BEAT|ALONE"
    r"|PATIENCE|PATIENT|CLOSE|SLOW|FINER|AT_ONCE)$|^_?(MOST|LONGEST|FEWEST)_"
)
UNIT_ENDINGS = {"Seconds": ("_S", "_TIMEOUT", "_TIME_LIMIT"), "Milliseconds": ("_MS",), "Bytes of": ("_BYTES", "_SIZE")}
"""How the docstring of a quantity begins, and how its name ends."""
ALLOWED = {
    "plugins/fraexp_plugins/readers/mat_reader.py: HDF5_USER_BLOCK": "the format's own name of that length",
    "fraexp/testing/friction_law_checks.py: bound": "checks are functions, and plugins name them in expected_failures",
}
"""Exceptions, each with its reason."""


FORBIDDEN_DEFINITION = re.compile(rf"\bdef _*({'|'.join(sorted(NO_FUNCTION_NAMES))})_*\(")
"""What a file contains in which there is such a function: most need not be looked at node by node."""


@cache
def modules(containing: re.Pattern[str] = re.compile("")) -> list[tuple[str, ast.Module]]:
    """Return the place and the syntax tree of each module whose text contains a pattern."""
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).rglob("*.py"))]
    files = [file for file in files if containing.search(file.read_text("utf-8"))]
    return [(file.relative_to(ROOT).as_posix(), syntax_tree(file)) for file in files]


def is_property(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Say whether a function is read like a value: its name may be an adjective."""
    return any("property" in ast.unparse(decorator) for decorator in function.decorator_list)


def functions(module: ast.Module, among: frozenset[str] | None = None) -> Iterator[str]:
    """Yield the names of functions: all of them, or those among some names."""
    for node in ast.walk(module):
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if is_function and (among is None or node.name.strip("_") in among) and not is_property(node):
            yield node.name


def constants(module: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of the constants of a module."""
    for node, following in zip(module.body, [*module.body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        doc = (
            following.value.value
            if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            else ""
        )
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            if isinstance(target, ast.Name) and target.id.isupper():
                yield target.id, str(doc)


def unclear(found: Iterator[str]) -> list[str]:
    return sorted(set(found) - ALLOWED.keys())


@pytest.mark.thorough
def test_every_exception_is_needed() -> None:
    found = {f"{place}: {name}" for place, module in modules() for name in functions(module)}
    found |= {f"{place}: {name}" for place, module in modules() for name, _ in constants(module)}
    assert not ALLOWED.keys() - found


def test_no_function_is_called_by_a_participle_or_a_preposition_alone() -> None:
    assert not unclear(
        f"{place}: {name}"
        for place, module in modules(FORBIDDEN_DEFINITION)
        for name in functions(module, NO_FUNCTION_NAMES)
    )


def test_no_constant_is_called_by_a_degree_alone() -> None:
    assert not unclear(
        f"{place}: {name}"
        for place, module in modules()
        for name, _ in constants(module)
        if NO_CONSTANT_NAMES.match(name)
    )


def test_quantities_name_their_unit() -> None:
    wrong = [
        f"{place}: {name}"
        for place, module in modules()
        for name, doc in constants(module)
        for words, endings in UNIT_ENDINGS.items()
        if doc.startswith(f"{words} ") and not name.endswith(endings)
    ]
    assert not unclear(iter(wrong))
    in_brackets = [
        f"{place}: {name} [{unit}]"
        for place, module in modules()
        for name, doc in constants(module)
        for unit in re.findall(r"\[(s|ms|Hz|kHz|m/s|kg|N|rad)\]\.$", doc)
        if not name.upper().endswith(f"_{unit.upper().replace('/', '_')}")
    ]
    assert in_brackets == []
