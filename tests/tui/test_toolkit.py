"""The toolkit's private members that the terminal UI builds on: those that are known, and no others."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest
from textual.app import App
from textual_serve.app_service import AppService
from textual_serve.server import Server

import fraexp.tui

PRIVATE = {
    "app.py": (App, {"_exception", "_fatal_error"}),
    "services/browser_server.py": (Server, {"_make_app", "_process_messages"}),
}
"""Modules, the class that they build on, and its members; each stands in a comment there, with the reason."""
FOLDER = Path(fraexp.tui.__file__).parent


def own_names(tree: ast.AST) -> set[str]:
    """Return the private names that a module itself gives to functions and attributes."""
    functions = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
    targets = (
        target
        for node in ast.walk(tree)
        for target in ([node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", ()))
    )
    parts = [part for target in targets for part in ast.walk(target)]
    attributes = {part.attr for part in parts if isinstance(part, ast.Attribute)}
    names = {part.id for part in parts if isinstance(part, ast.Name)}
    return functions | attributes | names


def foreign_names(tree: ast.AST, known: set[str]) -> Iterator[str]:
    """Yield private attributes that a module uses, but none of ours defines; overridden ones by their call."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
            of_super = isinstance(node.value, ast.Call) and ast.unparse(node.value) == "super()"
            if of_super or node.attr not in known:
                yield node.attr


@pytest.mark.thorough
def test_no_other_private_member_of_the_toolkit_is_used() -> None:
    trees = {str(file.relative_to(FOLDER)): ast.parse(file.read_text("utf-8")) for file in FOLDER.rglob("*.py")}
    known = set().union(*(own_names(tree) for tree in trees.values()))
    used = {name: set(foreign_names(tree, known)) for name, tree in trees.items()}
    listed = {name: members for name, (_, members) in PRIVATE.items()}
    listed["services/browser_server.py"] = listed["services/browser_server.py"] | {"_process"}
    listed["services/terminal_watch.py"] = {"_exit"}  # os._exit
    listed["services/measurement_worker.py"] = {"_fields"}  # of a named tuple
    assert {name: found - listed.get(name, set()) for name, found in used.items()} == {name: set() for name in used}


@pytest.mark.parametrize(("owner", "members"), PRIVATE.values(), ids=PRIVATE)
def test_the_toolkit_still_has_what_is_built_upon(owner: type, members: set[str]) -> None:
    functions = [member for member in vars(owner).values() if inspect.isfunction(member)]
    named = {name for function in functions for name in function.__code__.co_names}
    assert [name for name in members if not hasattr(owner, name) and name not in named] == []


def test_a_session_still_has_a_process() -> None:
    assert "self._process" in inspect.getsource(AppService)
