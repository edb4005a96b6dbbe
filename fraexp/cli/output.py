"""Printing: talk to stderr, tables and JSON to stdout; names from files cannot command the terminal."""

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from fraexp.cli.layout import GAP, blocks
from fraexp.figures.elements.labels import printable

LONGEST = 2000
"""Letters of a line on stderr."""
NUMBER = re.compile(r"[+±-]?[\d.]+(e[+-]?\d+)?(/\d+)?( (?!to )[^,]*)?$")
"""A number, a share such as 3/4, or a number with its unit; not a key, which may start with a digit too."""


def say(text: str) -> None:
    """Print one line on stderr; what it quotes may be of any length."""
    line = printable(text[:LONGEST])
    print(line if len(text) <= LONGEST else f"{line}...", file=sys.stderr, flush=True)


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
    """Print a table: fitted into a terminal, plain aligned text elsewhere; columns of numbers stand right.

    Columns without any value are left out. Columns that do not fit into the terminal follow below, behind the first.
    """
    kept = [index for index in range(len(columns)) if any(row[index] for row in rows)]
    cells = [[printable(row[index]) for index in kept] for row in rows]
    titles = [printable(columns[index]) for index in kept]
    right = [all(_numeric(row[index]) for row in cells) for index in range(len(kept))]
    (_draw if sys.stdout.isatty() else _align)(titles, cells, right, printable(title))


def _numeric(cell: str) -> bool:
    return cell in ("", "-", "∞") or NUMBER.match(cell) is not None


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

    console = Console(highlight=False)
    available = console.width
    for count, widths in enumerate(blocks(titles, cells, right, available)):
        table = Table(header_style="bold", box=None, padding=(0, GAP, 0, 0), pad_edge=False)
        for index, width in widths.items():
            justify: Literal["left", "right"] = "right" if right[index] else "left"
            table.add_column(Text(titles[index]), width=width, justify=justify, overflow="fold")
        for row in cells:
            table.add_row(*(Text(row[index]) for index in widths))
        console.width = max(available, sum(widths.values()) + GAP * (len(widths) - 1))  # a wide number wraps, uncut
        if count or title:
            console.print(Text("" if count else title), soft_wrap=True)
        console.print(table)
