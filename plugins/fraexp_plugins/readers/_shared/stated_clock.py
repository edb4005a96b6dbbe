"""Sample time that lines above a table of text state."""

import re
from collections.abc import Sequence
from itertools import pairwise

NUMBER = r"(?P<number>\d[\d.,]*(?:e[+-]?\d+)?)"
RATE_ENTRY = re.compile(
    r"(?:(?:sampl(?:e|ing)|recording|acquisition)[ _]?(?:rate|freq\w*)|f_?s|abtast(?:rate|frequenz))"
    r"\W*?(?P<prefix>k|M)?(?:Hz)?\W*?[\s:=,;\]]\W*?"
    rf"{NUMBER}\s*(?P<unit>[kM]?Hz|[kM]?S/s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample rate, such as ``Sample rate [kHz]: 2.5`` or ``fs = 2500 Hz``."""
TIME_ENTRY = re.compile(
    r"(?:sampl(?:e|ing)[ _]?(?:time|interval|period)|delta[ _]?[tx]|[dt]_?[ts]|abtastzeit)"
    r"[\W_]*?(?P<before>ms|us|µs|s)?"
    rf"\W*?[\s:=,;\]]\W*?{NUMBER}\s*(?P<unit>ms|us|µs|s)?\W*",
    re.IGNORECASE,
)
"""A line of metadata with the sample time, such as ``Sample interval (s), 4e-4`` or ``dt = 0.4 ms``."""
INCREMENT_NAME = re.compile(r"increment|x_?incr(?:ement)?", re.IGNORECASE)
"""Heading above a single number: an oscilloscope's sample time [s], while its first column counts the samples."""
MAX_ENTRY_CHARACTERS = 200
"""Characters of a line of metadata that are looked at."""
RATE_FACTORS = {"": 1.0, "k": 1e3, "m": 1e6}
TIME_FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


def stated_sample_time(header: Sequence[str], rows: Sequence[Sequence[str]], decimal_comma: bool) -> float | None:
    """Return the sample time [s] that the lines above a table state, or None.

    `rows` are the cells of these lines that are as wide as the table: such a line may state one rate for each column.
    """
    repeated = [f"{row[0]}: {row[-1]}" for row in rows if len({cell for cell in row[1:] if cell}) == 1]
    for line in (*header, *repeated):
        text = line[:MAX_ENTRY_CHARACTERS].strip(" \t\r\n\"'#%;,")
        if rate := RATE_ENTRY.fullmatch(text):
            prefix = (rate["unit"] or rate["prefix"] or "")[:1].lower()
            value = _number(rate["number"], decimal_comma) * RATE_FACTORS.get(prefix, 1.0)
            if value > 0:
                return 1 / value
        time = TIME_ENTRY.fullmatch(text)
        if time and (time["unit"] or time["before"]):
            unit = (time["unit"] or time["before"]).lower()
            # ſ and μ count as s and µ in a pattern
            value = _number(time["number"], decimal_comma) * TIME_FACTORS.get(unit, 0.0)
            if value > 0:
                return value
    return _increment(rows, decimal_comma)


def _increment(rows: Sequence[Sequence[str]], decimal_comma: bool) -> float | None:
    """Return the number below a heading such as Increment, or None."""
    for above, below in pairwise(rows):
        for heading, cell in zip(above, below, strict=False):
            if INCREMENT_NAME.fullmatch(heading):
                return _number(cell, decimal_comma) or None
    return None


def _number(text: str, decimal_comma: bool) -> float:
    """Return a number; 0 if it is none: with a comma that is not the table's decimal sign it may be two."""
    try:
        return float(text.rstrip(",.").replace(",", ".") if decimal_comma else text)
    except ValueError:  # such as 1.2.3
        return 0.0
