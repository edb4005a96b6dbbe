"""Channels of a record: a column of a file, or the sum or difference of two, with its unit and scale."""

import math
import re
from collections.abc import Mapping
from typing import Any

from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError

COLUMN_WITH_UNIT = re.compile(r"^(?P<column>.*\S)(?!(?<!\s)\[\d+\]$)\s*\[(?P<unit>[^\]]*)\]$")
"""A text with a unit in square brackets, such as ``iq [A]``; a number directly behind the name is an index."""
NUMBER_PATTERN = r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?"
SCALED_COLUMN = re.compile(
    rf"^(?P<inner>\S.*?)\s++(?P<operator>[*/])\s++(?P<gain>{NUMBER_PATTERN})(?:\s++(?P<sign>[+-])\s++(?P<offset>{NUMBER_PATTERN}))?$"
)
"""A column with a gain, such as ``volts * 31.5`` or ``counts / 4096 + 0.5``; blanks separate signs from names."""
COLUMN_SUM = re.compile(r"^(?P<column>\S.*?)\s+(?P<sign>[+-])\s+(?P<other>\S.*)$")
QUOTED = re.compile(r'^"(?P<column>[^"]+)"$')
"""A column whose name contains signs, such as ``"Amplitude - Force"``."""
MAX_TEXT_LENGTH = 1000
"""Maximum length of a channel's text: longer ones take long to parse."""
FORMULA_HINT = (
    "expected such as 'volts * 31.5', '(volts - 2.5) * 31.5 + 4' or '(a - b) / 2', with blanks around the signs"
)


class Channel(Parameters):
    """A column of the file with the conversion of its numbers: (column ± another) · scale + offset, in `unit`."""

    column: str = param("", "name of the column in the file")
    unit: str = param("", "unit of the numbers in the file, such as mm; 1 for a pure number", "")
    scale: float = param("1", "factor on the numbers, such as -1", 1.0)
    offset: float = param("", "what is added to the scaled numbers, in the unit", 0.0)
    plus: str = param("", "another column, which is added before scaling", "")
    minus: str = param("", "another column, which is subtracted before scaling", "")
    integrate: int = param(
        "1", "times the channel is integrated over time, to have displacement; below 0: differentiated", 0,
        at_least=-2, at_most=2,
    )  # fmt: skip

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        return tuple(name for name in (self.column, self.plus, self.minus) if name)

    def model_post_init(self, context: object) -> None:
        """Check that there are one or two columns."""
        if not self.column:
            raise ParameterError("column is empty; expected the name of a column in the file")
        if self.plus and self.minus:
            raise ParameterError(f"column '{self.column}' has plus and minus; expected only one of them")


def parse_channel(value: object, place: str) -> Channel:
    """Return the channel that a study describes by a table or a text; ParameterError if it is invalid."""
    if isinstance(value, Channel):
        return value
    if isinstance(value, str):
        if len(value) > MAX_TEXT_LENGTH:
            raise ParameterError(f"{place} has {len(value):,} letters; expected no more than {MAX_TEXT_LENGTH:,}")
        short = COLUMN_WITH_UNIT.match(value)
        unit = {"unit": short["unit"]} if short else {}
        return Channel.parse({**_parse_formula(short["column"] if short else value, place), **unit}, place)
    if not isinstance(value, Mapping):
        raise ParameterError(f"{place} is {value!r}; expected the name of a column, or a table with column and unit")
    return Channel.parse(value, place)


def _parse_formula(text: str, place: str) -> dict[str, Any]:
    """Return columns, scale and offset of a text such as ``(a - b) * 0.5 + 3``; other texts are names of columns."""
    scaled = None if QUOTED.match(text) else SCALED_COLUMN.match(text)
    if not scaled:
        return _parse_sum(_without_parentheses(text), 1.0)
    gain = float(scaled["gain"])
    if scaled["operator"] == "/" and not 0 < abs(gain) < math.inf:
        raise ParameterError(f"{place}: '{text}' divides by {gain:g}; {FORMULA_HINT}")
    scale = gain if scaled["operator"] == "*" else 1 / gain
    inner = scaled["inner"]
    is_sum = _without_parentheses(inner) == inner and not QUOTED.match(inner) and COLUMN_SUM.match(inner)
    if is_sum or SCALED_COLUMN.match(inner):
        raise ParameterError(f"{place}: '{text}' is ambiguous; {FORMULA_HINT}")
    found = _parse_sum(_without_parentheses(inner), scale)
    offset = float(f"{scaled['sign']}1") * float(scaled["offset"]) if scaled["offset"] else 0.0
    total = found.get("offset", 0.0) + offset
    return {**found, "scale": scale, **({"offset": total} if total else {})}


def _without_parentheses(text: str) -> str:
    """Return a text without the parentheses around all of it."""
    return text[1:-1].strip() if text.startswith("(") and text.endswith(")") else text


def column_text(name: str) -> str:
    """Return how a column is written in a channel's text: in quotes if its name would be taken for a formula."""
    try:
        is_plain = parse_channel(name, "") == Channel(column=name)
    except ParameterError:
        is_plain = False
    return name if is_plain or '"' in name else f'"{name}"'


def _parse_sum(text: str, scale: float) -> dict[str, Any]:
    if quoted := QUOTED.match(text):
        return {"column": quoted["column"]}
    found = COLUMN_SUM.match(text)
    if not found:
        return {"column": text}
    if re.fullmatch(NUMBER_PATTERN, found["other"]):
        return {"column": found["column"], "offset": scale * float(f"{found['sign']}1") * float(found["other"])}
    if COLUMN_SUM.match(found["other"]):
        raise ParameterError(f"'{text}' has more than two columns; {FORMULA_HINT}")
    return {"column": found["column"], "plus" if found["sign"] == "+" else "minus": found["other"]}
