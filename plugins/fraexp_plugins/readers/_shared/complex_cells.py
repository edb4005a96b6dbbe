"""Cells of text files that contain a complex number: each becomes two cells of real numbers."""

import re
from collections.abc import Sequence
from typing import NamedTuple

_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


class ComplexNotation(NamedTuple):
    """A way to write complex numbers."""

    pattern: re.Pattern[str]
    """Matches a cell; its groups are the two numbers."""
    parts: tuple[str, str]
    """What the names of the two columns end with."""
    units: tuple[str | None, str | None]


NOTATIONS = (
    ComplexNotation(
        re.compile(rf"\(?\s*([+-]?{_NUMBER})\s*(?=[+-])\+?(-?\s*{_NUMBER})\s*\*?\s*[ij]\s*\)?"),
        ("real", "imaginary"),
        (None, None),
    ),
    ComplexNotation(
        re.compile(rf"\(([+-]?{_NUMBER})dB,([+-]?{_NUMBER})\s*(?:°|deg)?\)"), ("magnitude", "phase"), ("dB", "deg")
    ),
)
"""``(1-2j)`` of Python, ``1 - 2i`` of MATLAB; ``(-12dB,45°)`` of circuit simulators."""


def complex_notation(cells: Sequence[str]) -> ComplexNotation | None:
    """Return the notation of a column of complex numbers; None if a cell is none, or all are empty."""
    filled = [cell for cell in cells if cell]
    return next((one for one in NOTATIONS if filled and all(map(one.pattern.fullmatch, filled))), None)


def split_complex(cell: str, notation: ComplexNotation) -> list[str]:
    """Return the two numbers in a cell; the cell and an empty one if it is no complex number."""
    found = notation.pattern.fullmatch(cell)
    return [part.replace(" ", "") for part in found.groups()] if found else [cell, ""]
