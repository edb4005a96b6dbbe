"""The syntax trees of source files, parsed once for all tests of a process: all of them take seconds."""

import ast
from functools import cache
from pathlib import Path


@cache
def syntax_tree(file: Path) -> ast.Module:
    """Return the syntax tree of a source file."""
    return ast.parse(file.read_text("utf-8"))
