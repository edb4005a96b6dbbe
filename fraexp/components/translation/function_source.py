"""The source of a function that is translated."""

import ast
import inspect
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fraexp.errors import PluginError


class FunctionSource:
    """The source of a function, with the values of the names that it uses from outside."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = getattr(function, "py_func", function)
        try:
            lines, first = inspect.getsourcelines(self.function)
            definition = ast.parse(textwrap.dedent("".join(lines))).body[0]
        except (OSError, TypeError, SyntaxError):
            raise PluginError(f"{function!r:.60}: the source is not available; expected a function in a file") from None
        self.file, self._before = Path(inspect.getfile(self.function)).name, first - 1
        if not isinstance(definition, ast.FunctionDef):
            raise self.fault(definition, "is no plain function", "define it by def")
        self.definition = definition
        self.parameters = [argument.arg for argument in definition.args.args]
        closure = inspect.getclosurevars(self.function)
        self.outside: dict[str, object] = {**closure.builtins, **closure.globals, **closure.nonlocals}

    @property
    def summary(self) -> str:
        """First line of the documentation, or else the function's name."""
        return (inspect.getdoc(self.function) or self.definition.name.strip("_")).splitlines()[0]

    def fault(self, node: ast.AST, found: str, expected: str) -> PluginError:
        """Return the error about a node that cannot be translated."""
        line = self._before + getattr(node, "lineno", 1)
        return PluginError(f"{self.definition.name} ({self.file}, line {line}) {found}; {expected}")
