"""The shape of the code, checked as code: import directions, what is loaded when, documentation, units, sources."""

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

import pytest
from importlinter.api import read_configuration
from pydantic.fields import FieldInfo

from fraexp.components.kinds import Component, MachineDriver, RecordReader, nested_kind
from fraexp.components.parameters import Parameters, unit_of
from fraexp.components.registry import Provider, Registry
from fraexp.data import units
from fraexp.store import Store
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[1]
SOURCES = sorted([*(ROOT / "fraexp").rglob("*.py"), *(ROOT / "plugins").rglob("*.py")])
LONGEST_FILE = 700
MOST_MODULES, MOST_PACKAGES, MOST_LAYERS = 4, 18, 12
FACES = ("interface", "cli", "tui", "views")
SOURCE = re.compile(
    r"10\.\d{4,9}/\S"  # a DOI
    r"|\beqs?\.? ?\(?\d"  # an equation
    r"|\bpaper(,|'s) (eqs?|Fig|Table|section)\b"
    r"|\b(1[89]|20)\d\d\b"  # a name in the literature with its year
)


def test_import_contracts_hold() -> None:
    command = [Path(sys.executable).with_name("lint-imports"), "--no-logo", "--no-cache"]
    paths = {"PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}"}
    done = subprocess.run(
        command, cwd=ROOT, env=paths, capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    assert done.returncode == 0, done.stdout


def loaded_by(code: str) -> set[str]:
    """Return the top-level packages that a fresh interpreter has imported after running `code`."""
    report = f"{code}\nimport sys, json; print(json.dumps(sorted({{name.partition('.')[0] for name in sys.modules}})))"
    done = subprocess.run(
        [sys.executable, "-c", report], capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


@cache
def syntax_tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text("utf-8"))


def relative(paths: list[Path]) -> list[str]:
    return [str(path.relative_to(ROOT)) for path in paths]


def test_finding_components_loads_no_heavy_package() -> None:
    loaded = loaded_by("import fraexp.components.registry; assert fraexp.components.registry.discover().providers")
    assert "fraexp_plugins" in loaded
    assert loaded & {"numba", "llvmlite", "scipy", "pint", "matplotlib", "sqlalchemy", "textual"} == set()


def test_a_list_of_runs_loads_neither_parameters_nor_plugins(tmp_path: Path) -> None:
    Store.open(str(tmp_path / "r.db"), create=True).close()
    code = f"import fraexp.cli.list; from fraexp.store import Store; Store.open({str(tmp_path / 'r.db')!r}).runs()"
    loaded = loaded_by(code)
    assert loaded & {"numba", "scipy", "pydantic", "pluggy", "matplotlib", "textual", "fraexp_plugins"} == set()


def test_the_trial_of_a_law_loads_neither_the_compiler_nor_figures() -> None:
    law = {"name": "dahl", "stiffness": 1e5, "coulomb_force": 10.0}
    code = "from fraexp.components.registry import discover; from fraexp.views.law_trial import SineTrial, SineMotion"
    loaded = loaded_by(f"{code}; SineTrial({law}, SineMotion(), discover()).describing_function()")
    assert loaded & {"numba", "matplotlib"} == set()


def test_the_command_line_loads_nothing_heavy_before_it_is_needed() -> None:
    loaded = loaded_by("import fraexp.cli.main, fraexp.workspace.workspace_folder")
    assert loaded & {"numba", "numpy", "scipy", "pydantic", "sqlalchemy", "matplotlib", "textual"} == set()


def test_faces_reach_database_and_plugins_through_the_workspace_alone() -> None:
    files = [file for face in FACES for file in (ROOT / "fraexp" / face).rglob("*.py")]
    assert len(files) > 50
    for file in (each for each in files if re.search("Store|discover", each.read_text("utf-8"))):
        called = [ast.unparse(node.func) for node in ast.walk(syntax_tree(file)) if isinstance(node, ast.Call)]
        assert [name for name in called if "Store" in name.split(".") or name.endswith("discover")] == [], file


def test_no_file_is_too_long() -> None:
    files = [*SOURCES, *(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py")]
    assert relative([file for file in files if len(file.read_text("utf-8").splitlines()) > LONGEST_FILE]) == []


def test_every_module_says_what_it_is() -> None:
    assert relative([file for file in SOURCES if not ast.get_docstring(syntax_tree(file))]) == []


def test_the_top_can_be_held_in_mind() -> None:
    top = [path for path in (ROOT / "fraexp").iterdir() if not path.name.startswith("__pycache__")]
    assert len([path for path in top if path.suffix == ".py"]) <= MOST_MODULES
    assert len([path for path in top if (path / "__init__.py").exists()]) <= MOST_PACKAGES
    contracts = read_configuration(str(ROOT / "pyproject.toml"))["contracts_options"]
    assert len(contracts[0]["layers"]) <= MOST_LAYERS


def test_no_name_has_two_meanings() -> None:
    named = [file.stem for file in SOURCES if not file.stem.startswith("_") and "versions" not in file.parts]
    classes = [
        node.name
        for file in SOURCES
        for node in syntax_tree(file).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    assert sorted(name for name, count in Counter(named + classes).items() if count > 1) == []


def modules() -> Iterator[ModuleType]:
    for file in SOURCES:
        parts = file.relative_to(ROOT).with_suffix("").parts
        dotted = parts[parts[0] == "plugins" :]
        if dotted[-1] != "__main__":  # that acts when imported
            yield importlib.import_module(".".join(part for part in dotted if part != "__init__"))


def test_every_public_method_is_documented_by_its_class_or_by_the_contract() -> None:
    missing = []
    for module in modules():
        for owner in vars(module).values():
            if inspect.isclass(owner) and owner.__module__ == module.__name__ and not owner.__name__.startswith("_"):
                for name, member in vars(owner).items():
                    method = isinstance(member, staticmethod | classmethod | property) or inspect.isfunction(member)
                    if method and not name.startswith("_") and not inspect.getdoc(getattr(owner, name)):
                        missing.append(f"{module.__name__}.{owner.__name__}.{name}")
    assert missing == []


@pytest.fixture(scope="module")
def built_in(registry: Registry) -> list[Provider]:
    providers = [
        provider for provider in registry.providers.values() if provider.component.__module__.startswith("fraexp_p")
    ]
    assert providers
    return providers


def test_every_built_in_component_is_found(registry: Registry, built_in: list[Provider]) -> None:
    written = {
        (str(file), node.name)
        for file in SOURCES
        if file.is_relative_to(ROOT / "plugins")
        for node in ast.walk(syntax_tree(file))
        if isinstance(node, ast.ClassDef) and any(keyword.arg == "name" for keyword in node.keywords)
    }
    assert registry.failures == []
    assert {(str(provider.file), provider.component.__name__) for provider in built_in} == written


def fields(owner: type[Parameters], path: str) -> Iterator[tuple[str, FieldInfo]]:
    """Yield all parameters with their place, those of nested groups included."""
    for name, info in owner.model_fields.items():
        yield f"{path}.{name}", info
        for part in flat(info.annotation):
            if inspect.isclass(part) and issubclass(part, Parameters) and not issubclass(part, Component):
                yield from fields(part, f"{path}.{name}")


def flat(annotation: Any) -> list[Any]:
    return [annotation, *(inner for part in get_args(annotation) for inner in flat(part))]


def test_every_parameter_has_a_meaning_and_every_number_a_known_unit(built_in: list[Provider]) -> None:
    parameters = [pair for provider in built_in for pair in fields(provider.component, provider.component.name)]
    assert parameters
    assert [place for place, info in parameters if not info.description] == []
    numbers = [(place, info) for place, info in parameters if {float, int} & set(flat(info.annotation))]
    assert [place for place, info in numbers if nested_kind(info) is None and not unit_of(info)] == []
    for _, info in numbers:
        units.si(unit_of(info))  # raises for a unit that nobody knows


def test_every_component_names_its_source(built_in: list[Provider]) -> None:
    silent = []
    for component in (provider.component for provider in built_in):
        texts = (component.__doc__, inspect.getmodule(component).__doc__)
        has_source = any(SOURCE.search(text or "") for text in texts)
        # a reader follows a file format, a machine the protocol of its maker, not the literature
        if not issubclass(component, RecordReader | MachineDriver) and not has_source:
            silent.append(f"{component.kind} {component.name}")
        assert component.__doc__, component
    assert silent == [], "a DOI, an equation number, a place in the paper, or a name and year"
