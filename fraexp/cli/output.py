"""Printing: messages to stderr, tables and JSON to stdout, fitted into a terminal; texts cannot command it."""

import json
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, TextIO

from fraexp.cli.standard_streams import discard_unwritable
from fraexp.data.texts import printable

MIN_TEXT_CELLS = 20
"""Width below which a text is not indented any more [cells]."""


def terminal_width(stream: TextIO) -> int | None:
    """Return the width of the terminal behind a stream [cells]; None if there is none."""
    return max(shutil.get_terminal_size().columns, 1) if stream.isatty() else None


def fit_lines(text: str, stream: TextIO, indent: str = "") -> str:
    """Return a text in lines that fit the terminal behind a stream; all but the first begin with `indent`."""
    width = terminal_width(stream)
    if width is None:
        return text
    return "\n".join("\n".join(_fit_line(line, width, indent)) for line in text.split("\n"))


def _fit_line(line: str, width: int, indent: str) -> Iterator[str]:
    from rich.cells import cell_len
    from rich.console import Console
    from rich.text import Text

    if cell_len(line) <= width:
        yield line
        return
    indent = indent if len(indent) + MIN_TEXT_CELLS <= width else ""
    begin = line[: len(line) - len(line.lstrip())][: max(width - MIN_TEXT_CELLS, 0)]
    for part in Text(line.strip()).wrap(Console(), width - max(len(indent), len(begin))):
        yield f"{begin}{part.plain.rstrip()}"
        begin = indent


COLUMN_GAP = 2
"""Characters between two columns."""
MAX_TEXT_WIDTH = 48
"""Maximum width of a text column [characters] while others need the room."""
MIN_TEXT_WIDTH = 20
"""Minimum width to which a text column is folded [characters]."""


def column_blocks(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool], available: int
) -> list[dict[int, int]]:
    """Return the columns of each block with their widths [characters]; the first column leads every block.

    `solid` columns hold numbers: their cells are folded only if one and the first column are wider than `available`.
    """
    floors = [_min_width(*column, available) for column in _columns(titles, cells, solid)]
    wishes = [
        max(floor, _wanted_width(*column)) for floor, column in zip(floors, _columns(titles, cells, solid), strict=True)
    ]
    found: list[list[int]] = [[0]]
    for index in range(1, len(titles)):
        if len(found[-1]) > 1 and _total_width([floors[i] for i in [*found[-1], index]]) > available:
            found.append([0])
        found[-1].append(index)
    return [_fit_widths({i: floors[i] for i in of}, {i: wishes[i] for i in of}, available) for of in found]


def _columns(
    titles: Sequence[str], cells: Sequence[Sequence[str]], solid: Sequence[bool]
) -> list[tuple[str, list[str], bool]]:
    return [(title, [row[index] for row in cells], solid[index]) for index, title in enumerate(titles)]


def _min_width(title: str, column: list[str], solid: bool, available: int) -> int:
    words = max(map(len, title.split()), default=1)
    longest = max(map(len, column), default=0)
    if solid:
        return max(words, longest)
    pieces = max((len(word) for cell in column for word in cell.split()), default=0)
    return min(max(words, pieces, min(longest, MIN_TEXT_WIDTH)), max(available, 1))


def _wanted_width(title: str, column: list[str], solid: bool) -> int:
    longest = max(map(len, column), default=0)
    return max(len(title), longest if solid else min(longest, MAX_TEXT_WIDTH))


def _fit_widths(floors: dict[int, int], wishes: dict[int, int], available: int) -> dict[int, int]:
    """Return the wanted widths, reduced where there is most room until all columns fit."""
    widths = dict(wishes)
    while _total_width(list(widths.values())) > available:
        loosest = max(widths, key=lambda index: widths[index] - floors[index])
        if widths[loosest] == floors[loosest]:
            break
        widths[loosest] -= 1
    while _total_width(list(widths.values())) > available and max(widths.values()) > 1:
        widths[max(widths, key=lambda index: widths[index])] -= 1
    return widths


def _total_width(widths: Sequence[int]) -> int:
    return sum(widths) + COLUMN_GAP * (len(widths) - 1)


MAX_LINE_LENGTH = 1000
"""Maximum length of a line on stderr [characters]."""
MAX_WORD_LENGTH = 240
"""Maximum length of a word in such a line [characters]: a path or a name that a file system takes fits."""
MAX_SCANNED_LENGTH = 40_000
"""Characters of a text in which long words are looked for."""
LONG_WORD_PATTERN = re.compile(rf"\S{{{MAX_WORD_LENGTH + 1},}}")
ELLIPSIS = "..."
NUMBER_PATTERN = re.compile(r"[+±-]?[\d.]+(e[+-]?\d+)?(/\d+)?( (?!to )[^,]*)?$")
"""A number, a share such as 3/4, or a number with its unit; not a key, which may start with a digit too."""


def say(text: str) -> None:
    """Print a message on stderr: one line, wrapped on a terminal, cut in the middle if it is far too long.

    A line that cannot be written is dropped, and those after it: a run is worth more than its messages. What stays in
    the buffer would fail the flush before processes are started.
    """
    try:
        print(fit_lines(shorten(printable(shorten(text))), sys.stderr), file=sys.stderr, flush=True)
    except OSError:
        discard_unwritable(sys.stderr)


def ask(question: str) -> bool:
    """Ask on stderr, and return whether the answer is yes."""
    print(f"{question} [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().casefold() in ("y", "yes")


def print_line(text: str, indent: str = "") -> None:
    """Print one line on stdout; on a terminal it is wrapped, and goes on after `indent`."""
    print(fit_lines(printable(text), sys.stdout, indent), flush=True)


def shorten(text: str) -> str:
    """Return a text with long words, and then the whole of it, cut in the middle: both ends say most."""
    scanned = _cut_middle(text, MAX_SCANNED_LENGTH)
    words_cut = LONG_WORD_PATTERN.sub(lambda word: _cut_middle(word.group(), MAX_WORD_LENGTH), scanned)
    return _cut_middle(words_cut, MAX_LINE_LENGTH)


def _cut_middle(text: str, longest: int) -> str:
    if len(text) <= longest:
        return text
    head = (longest - len(ELLIPSIS)) * 2 // 3
    return f"{text[:head]}{ELLIPSIS}{text[len(ELLIPSIS) + head - longest :]}"


_documents: list[object] = []
"""What the command has printed as JSON: an error adds no second document."""


def forget_documents() -> None:
    """Begin with another command."""
    _documents.clear()


def report_error(text: str, code: int, as_json: bool) -> int:
    """Print the error of a command on stderr, `as_json` also as a document on stdout, and return its exit code."""
    say(text)
    if as_json and not _documents:
        print_json({"error": {"message": shorten(printable(text.removeprefix("fraexp: "))), "exit_code": int(code)}})
    return code


def print_json(document: object) -> None:
    """Print one JSON document on stdout."""
    _documents.append(document)
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
