"""Printing: messages to stderr, tables and JSON to stdout; texts from files cannot command the terminal."""

import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

from fraexp.cli.layout import COLUMN_GAP, column_blocks
from fraexp.cli.terminal_lines import fit_lines, terminal_width
from fraexp.data.terminal_text import printable

MAX_LINE_LENGTH = 1000
"""Maximum length of a line on stderr [characters]."""
MAX_WORD_LENGTH = 240
"""Maximum length of a word in such a line [characters]: a path or a name that a file system takes fits."""
MAX_SCANNED_LENGTH = 20_000
"""Characters at either end of a text in which long words are looked for."""
LONG_WORD_PATTERN = re.compile(rf"\S{{{MAX_WORD_LENGTH + 1},}}")
ELLIPSIS = "..."
NUMBER_PATTERN = re.compile(r"[+±-]?[\d.]+(e[+-]?\d+)?(/\d+)?( (?!to )[^,]*)?$")
"""A number, a share such as 3/4, or a number with its unit; not a key, which may start with a digit too."""


def say(text: str) -> None:
    """Print a message on stderr: one line, wrapped on a terminal, cut in the middle if it is far too long.

    A line that cannot be written is dropped: a run is worth more than its messages.
    """
    with suppress(OSError):
        print(fit_lines(shorten(printable(shorten(text))), sys.stderr), file=sys.stderr, flush=True)


def print_line(text: str, indent: str = "") -> None:
    """Print one line on stdout; on a terminal it is wrapped, and goes on after `indent`."""
    print(fit_lines(printable(text), sys.stdout, indent), flush=True)


def shorten(text: str, longest: int = MAX_LINE_LENGTH) -> str:
    """Return a text with long words, and then the whole of it, cut in the middle: both ends say most."""
    short = LONG_WORD_PATTERN.sub(
        lambda word: _cut_middle(word.group(), MAX_WORD_LENGTH), text[: 2 * MAX_SCANNED_LENGTH]
    )
    if len(text) > 2 * MAX_SCANNED_LENGTH:
        ends = text[:MAX_SCANNED_LENGTH], text[-MAX_SCANNED_LENGTH:]
        short = "".join(
            LONG_WORD_PATTERN.sub(lambda word: _cut_middle(word.group(), MAX_WORD_LENGTH), end) for end in ends
        )
    return _cut_middle(short, longest)


def _cut_middle(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    head = (longest - len(ELLIPSIS)) * 2 // 3
    return f"{text[:head]}{ELLIPSIS}{text[len(ELLIPSIS) + head - longest :]}"


class ErrorDocument:
    """Reports the error of a command: a line on stderr, and under ``--json`` a document on stdout."""

    def __init__(self) -> None:
        self.is_printed = False
        """Whether the command has printed a document already: there is never a second one."""

    def report(self, text: str, code: int, as_json: bool) -> int:
        """Print an error, and return its exit code."""
        say(text)
        if as_json and not self.is_printed:
            message = shorten(printable(text.removeprefix("fraexp: ")))
            print_json({"error": {"message": message, "exit_code": int(code)}})
        return code


_documents: list[ErrorDocument] = []
"""Of the commands in progress: one, except in tests."""


@contextmanager
def error_document() -> Iterator[ErrorDocument]:
    """Return the document of errors of a command."""
    _documents.append(document := ErrorDocument())
    try:
        yield document
    finally:
        _documents.remove(document)


def print_json(document: object) -> None:
    """Print one JSON document on stdout."""
    for errors in _documents:
        errors.is_printed = True
    print(json.dumps(document, indent=2, allow_nan=False))


def print_path(path: Path, what: str = "") -> None:
    """Print the path of a file that was written, from here if it is below this folder."""
    full, here = path.absolute(), Path.cwd()
    print(f"{what}{printable(str(full.relative_to(here) if full.is_relative_to(here) else path))}")


def print_fields(pairs: Sequence[tuple[str, str]], indent: int = 0) -> None:
    """Print names and values, aligned; a pair without a value is left out."""
    names = [printable(name) for name, _ in pairs]
    available = terminal_width(sys.stdout)
    limit = max(available // 2 - indent, 1) if available else None  # a longer name has its value below it
    width = max((len(name) for name in names if limit is None or len(name) <= limit), default=0)
    for name, (_, value) in zip(names, pairs, strict=True):
        if value:
            print_line(f"{' ' * indent}{name:<{width}}  {printable(value)}", " " * (indent + width + 2))


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """Print a table: fitted into a terminal, plain aligned text elsewhere; numbers are right-aligned.

    Empty columns are left out. Columns that do not fit into the terminal follow below, after the first column.
    """
    kept = [index for index in range(len(columns)) if any(row[index] for row in rows)]
    cells = [[printable(row[index]) for index in kept] for row in rows]
    titles = [printable(columns[index]) for index in kept]
    right = [all(_is_numeric(row[index]) for row in cells) for index in range(len(kept))]
    (_draw if sys.stdout.isatty() else _align)(titles, cells, right, printable(title))


def _is_numeric(cell: str) -> bool:
    return cell in ("", "-", "∞") or NUMBER_PATTERN.match(cell) is not None


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
    for count, widths in enumerate(column_blocks(titles, cells, right, available)):
        table = Table(header_style="bold", box=None, padding=(0, COLUMN_GAP, 0, 0), pad_edge=False)
        for index, width in widths.items():
            justify: Literal["left", "right"] = "right" if right[index] else "left"
            table.add_column(Text(titles[index]), width=width, justify=justify, overflow="fold")
        for row in cells:
            table.add_row(*(Text(row[index]) for index in widths))
        if count:
            console.print()
        elif title:
            console.print(Text(title))
        console.print(table)
