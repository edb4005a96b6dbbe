"""A channel of a record: one column of a file, or the sum or difference of two, and how it becomes a quantity."""

import math
import re
from collections.abc import Mapping
from typing import Any

from fraexp.components.parameters import Parameters, param
from fraexp.errors import ParameterError

SHORT = re.compile(r"^(?P<column>.*\S)\s*\[(?P<unit>[^\]]*)\]$")
"""Something with its unit in square brackets, such as ``iq [A]``."""
NUMBER = r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?"
SCALED = re.compile(
    rf"^(?P<inner>\S.*?)\s++(?P<operator>[*/])\s++(?P<gain>{NUMBER})(?:\s++(?P<sign>[+-])\s++(?P<offset>{NUMBER}))?$"
)
"""A column with a gain, such as ``volts * 31.5`` or ``counts / 4096 + 0.5``: blanks tell signs from those in names."""
SUM = re.compile(r"^(?P<column>\S.*?)\s+(?P<sign>[+-])\s+(?P<other>\S.*)$")
LONGEST = 1000
"""Letters of a channel's text: longer ones take long to be understood."""
EXPECTED = "expected such as 'volts * 31.5', '(volts - 2.5) * 31.5 + 4' or '(a - b) / 2', with blanks around the signs"


class Channel(Parameters):
    """A column of the file and how its numbers become a quantity: (column ± another) · scale + offset, in `unit`."""

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
        """Names of the columns that it is made of."""
        return tuple(name for name in (self.column, self.plus, self.minus) if name)

    def model_post_init(self, context: object) -> None:
        """Check that there are one or two columns."""
        if not self.column:
            raise ParameterError("column is empty; expected the name of a column in the file")
        if self.plus and self.minus:
            raise ParameterError(f"column '{self.column}' has plus and minus; expected two columns at most")


def channel_of(value: Any, place: str) -> Channel:
    """Return the channel that a study describes by a table, or in short by a text."""
    if isinstance(value, Channel):
        return value
    if isinstance(value, str):
        if len(value) > LONGEST:
            raise ParameterError(f"{place} has {len(value):,} letters; expected {LONGEST:,} at most")
        short = SHORT.match(value)
        unit = {"unit": short["unit"]} if short else {}
        return Channel.parse({**_formula(short["column"] if short else value, place), **unit}, place)
    if not isinstance(value, Mapping):
        raise ParameterError(f"{place} is {value!r}; expected the name of a column, or a table with column and unit")
    return Channel.parse(value, place)


def _formula(text: str, place: str) -> dict[str, Any]:
    """Return columns, scale and offset of a text such as ``(a - b) * 0.5 + 3``; a bare text is a column's name."""
    scaled = SCALED.match(text)
    if not scaled:
        return _sum(_bare(text), 1.0)
    gain = float(scaled["gain"])
    if scaled["operator"] == "/" and not 0 < abs(gain) < math.inf:
        raise ParameterError(f"{place}: '{text}' divides by {gain:g}; {EXPECTED}")
    scale = gain if scaled["operator"] == "*" else 1 / gain
    inner = scaled["inner"]
    if (_bare(inner) == inner and SUM.match(inner)) or SCALED.match(inner):
        raise ParameterError(f"{place}: '{text}' can be read in two ways; {EXPECTED}")
    found = _sum(_bare(inner), scale)
    offset = float(f"{scaled['sign']}1") * float(scaled["offset"]) if scaled["offset"] else 0.0
    total = found.get("offset", 0.0) + offset
    return {**found, "scale": scale, **({"offset": total} if total else {})}


def _bare(text: str) -> str:
    """Return what stands within the parentheses around all of a text."""
    return text[1:-1].strip() if text.startswith("(") and text.endswith(")") else text


def _sum(text: str, scale: float) -> dict[str, Any]:
    found = SUM.match(text)
    if not found:
        return {"column": text}
    if re.fullmatch(NUMBER, found["other"]):
        return {"column": found["column"], "offset": scale * float(f"{found['sign']}1") * float(found["other"])}
    if SUM.match(found["other"]):
        raise ParameterError(f"'{text}' is made of more than two columns; {EXPECTED}")
    return {"column": found["column"], "plus" if found["sign"] == "+" else "minus": found["other"]}
