"""The toolkit's private members that the terminal UI builds on: those that are known, and no others."""

import inspect

import pytest
from textual.app import App
from textual_serve.app_service import AppService
from textual_serve.server import Server

PRIVATE = {
    "app.py": (App, {"_exception", "_fatal_error"}),
    "services/browser_server.py": (Server, {"_make_app", "_process_messages"}),
}
"""Modules, the class that they build on, and its members; each stands in a comment there, with the reason."""


@pytest.mark.parametrize(("owner", "members"), PRIVATE.values(), ids=PRIVATE)
def test_the_toolkit_still_has_what_is_built_upon(owner: type, members: set[str]) -> None:
    functions = [member for member in vars(owner).values() if inspect.isfunction(member)]
    named = {name for function in functions for name in function.__code__.co_names}
    assert [name for name in members if not hasattr(owner, name) and name not in named] == []


def test_a_session_still_has_a_process() -> None:
    assert "self._process" in inspect.getsource(AppService)
