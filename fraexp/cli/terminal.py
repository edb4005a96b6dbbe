"""Printing: talk to stderr, tables and JSON to stdout; names from files cannot command the terminal."""

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fraexp.figures.labels import printable

WIDEST = 48
"""Widest column [characters] of a table on a terminal that is too narrow for it."""
NUMBER = re.compile(r"[+±-]?[\d.]+(e[+-]?\d+)?(/\d+)?( .*)?$")
"""A number, a share such as 3/4, or a number with its unit; not a key, which may start with a digit too."""


def say(text: str) -> None:
    """Print one line on stderr."""
    print(printable(text), file=sys.stderr, flush=True)


def print_json(document: Any) -> None:
    """Print one JSON document on stdout."""
    print(json.dumps(document, indent=2, allow_nan=False))


def print_path(path: Path, what: str = "") -> None:
    """Print the path of a file that was written, from here if it is below this folder."""
    full, here = path.absolute(), Path.cwd()
    print(f"{what}{printable(str(full.relative_to(here) if full.is_relative_to(here) else path))}")


def print_fields(pairs: Sequence[tuple[str, str]], indent: int = 0) -> None:
    """Print names and values, aligned; a pair without a value is left out."""
    width = max((len(name) for name, _ in pairs), default=0)
    for name, value in pairs:
        if value:
            print(f"{' ' * indent}{printable(name):<{width}}  {printable(value)}")


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """Print a table: drawn on a terminal, plain aligned text elsewhere; columns of numbers stand right.

    Columns without any value are left out.
    """
    kept = [index for index in range(len(columns)) if any(row[index] for row in rows)]
    cells = [[printable(row[index]) for index in kept] for row in rows]
    titles = [printable(columns[index]) for index in kept]
    right = [all(_numeric(row[index]) for row in cells) for index in range(len(kept))]
    (_draw if sys.stdout.isatty() else _align)(titles, cells, right, printable(title))


def _numeric(cell: str) -> bool:
    return cell in ("", "-") or NUMBER.match(cell) is not None


def _align(titles: list[str], cells: list[list[str]], right: list[bool], title: str) -> None:
    widths = [max(len(row[index]) for row in [titles, *cells]) for index in range(len(titles))]
    if title:
        print(title)
    for row in [titles, *cells]:
        aligned = zip(row, widths, right, strict=True)
        print("  ".join(f"{cell:{'>' if to_right else '<'}{width}}" for cell, width, to_right in aligned).rstrip())


def _draw(titles: list[str], cells: list[list[str]], right: list[bool], title: str) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        header_style="bold",
        box=None,
        padding=(0, 2, 0, 0),
        pad_edge=False,
    )
    widths = [
        max(len(text) for text in (*name.split(), *(row[index] for row in cells))) for index, name in enumerate(titles)
    ]
    widths = [min(width, WIDEST) for width in widths]  # titles and long messages are folded, keys and numbers never
    for name, width, to_right in zip(titles, widths, right, strict=True):
        table.add_column(Text(name), min_width=width, justify="right" if to_right else "left", overflow="fold")
    for row in cells:
        table.add_row(*(Text(cell) for cell in row))
    console = Console(highlight=False)
    console.width = max(console.width, sum(widths) + 2 * len(widths))
    console.print(table)
