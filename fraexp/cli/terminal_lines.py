"""Lines for a terminal: none is wider than it; elsewhere, where programs read them, they stay whole."""

import shutil
from collections.abc import Iterator
from typing import TextIO

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

    if cell_len(line) <= width:
        yield line
        return
    indent = indent if len(indent) + MIN_TEXT_CELLS <= width else ""
    begin = line[: len(line) - len(line.lstrip())][: max(width - MIN_TEXT_CELLS, 0)]
    so_far, is_empty = begin, True
    for piece in _pieces(line.split(), width - max(len(indent), len(begin))):
        candidate = f"{so_far}{piece}" if is_empty else f"{so_far} {piece}"
        if not is_empty and cell_len(candidate) > width:
            yield so_far
            candidate = f"{indent}{piece}"
        so_far, is_empty = candidate, False
    yield so_far


def _pieces(words: list[str], width: int) -> Iterator[str]:
    """Yield words, those that are wider than a line in pieces."""
    from rich.cells import cell_len, chop_cells

    for word in words:
        yield from chop_cells(word, width) if cell_len(word) > width else [word]
