"""Units as people write them, turned into the SI numbers that everything inside uses."""

import re
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from fraexp.errors import ParameterError

if TYPE_CHECKING:
    import pint


@cache
def _registry() -> "pint.UnitRegistry[float]":
    import pint  # slow to import, needed only where somebody writes a unit

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(cache_folder=None)
    registry.define("@alias turn = rev")
    return registry


def factor(unit: str, expected: str) -> float:
    """Return what a number in `unit` is multiplied by to be in `expected`; ParameterError if it cannot be."""
    import pint

    given = _quantity(unit)
    try:
        return float(given.to(_quantity(expected).units).magnitude)
    except (pint.DimensionalityError, ParameterError):  # of a level in dB no unit is a factor
        raise ParameterError(f"'{unit}' is not a unit of the same kind as '{expected}'") from None


def number(text: str, unit: str) -> float:
    """Return the SI number in a text such as ``"0.1 um"`` for a parameter in `unit`."""
    if len(text) > LONGEST_NUMBER:
        raise ParameterError(f"{_quote(text)} is not a number with a unit")
    head, tail = _split_number(text.strip())
    try:
        value = float(head)
    except ValueError:
        like = (
            "a number; expected one like 2" if unit == "1" else f"a number with a unit; expected one like '1.5 {unit}'"
        )
        raise ParameterError(f"'{text}' is not {like}") from None
    return value if tail.strip() in ("", unit) else value * factor(tail.strip(), unit)


NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


def _split_number(text: str) -> tuple[str, str]:
    """Return number and unit of a text such as ``10 mm`` or ``10mm``."""
    head, _, tail = text.partition(" ")
    found = NUMBER.match(head)
    if found and found.end() < len(head) and not tail and (head[found.end()].isalpha() or head[found.end()] == "°"):
        return found[0], head[found.end() :]
    return head, tail


def _quote(text: str) -> str:
    return f"'{text}'" if len(text) <= MAX_UNIT_LENGTH else f"'{text[:MAX_UNIT_LENGTH]}...'"


def si(unit: str) -> tuple[float, str]:
    """Return the factor to, and the short name of, the SI unit of `unit` (``mm`` → 0.001, ``m``)."""
    quantity = _quantity(unit)
    for named in NAMED:
        other = _quantity(named)
        if quantity.dimensionality == other.dimensionality and quantity.dimensionality:
            return factor(unit, named), named
    base = quantity.to_base_units()
    name = f"{base.units:~}".replace(" ", "")
    return float(base.magnitude), name or "1"


NAMED = ("N", "V", "N m", "W", "Pa", "N/m", "V/m")
"""Units that keep the name they have in the field: N, not kg·m/s²."""


SPELLINGS = {
    "": "dimensionless", "1": "dimensionless", "U/min": "rpm", "r/min": "rpm", "U/s": "rev/s", "r/s": "rev/s",
    "Sec": "s", "amp": "A", "amps": "A", "Amp": "A", "Amps": "A",
}  # fmt: skip
"""What people write, and pint reads otherwise (its U is that of enzymes, its amps an am/s)."""
COUNTED = re.compile(r"(?<![A-Za-z])([kMmuµμn]?[AV])(?:[ _]?(?:rms|RMS|eff|pk|peak)|p|\([pP]\))(?![A-Za-z])")
"""Amperes and volts with a remark on how they are counted, ``Arms`` or ``A(p)``: the remark changes no number."""
WRITTEN_OUT = re.compile(r"[A-Za-z]{3,}")
"""A unit that instruments write in capitals, or with one: Volt, Deg, RPM."""
TORQUE = re.compile(r"(?<![A-Za-z])((?:da|[kMcdmuµμ])?N)[-.·⋅]?([cm]?m)(?![A-Za-z])")
"""A torque such as Nm, kNm or N-m: to pint, measures of yarn or a difference."""
POUNDS = {"lb": "force_pound", "lbs": "force_pound", "lbf": "force_pound", "oz": "force_ounce", "ozf": "force_ounce"}
LENGTH_BY_POUND = re.compile(r"(?<![A-Za-z])(in|ft)[-.·⋅* ]?(lbs|lbf|lb|ozf|oz)(?![A-Za-z])")
POUND_BY_LENGTH = re.compile(r"(?<![A-Za-z])(lbs|lbf|lb|ozf|oz)[-.·⋅* ]?(in|ft)(?![A-Za-z])")
"""A torque such as in-lb or ft lb, whose pound is a force: to pint, it is a mass."""
PLAIN_POWER = re.compile(r"(?<=[A-Za-z])(-[123]|[23])(?![\d.*^A-Za-z])")
"""A power without its sign, such as those of rad/s2 or min-1."""


def with_powers(unit: str) -> str:
    """Return a unit as people read it: ``m/(N s²)``, however its powers were written."""
    return re.sub(r"(?:\*\*|\^)(\d)", lambda power: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power[1])], unit)


MAX_UNIT_LENGTH, LONGEST_NUMBER = 80, 500
"""Letters of a unit, and of a number with one."""
EXPONENT = re.compile(r"\s*(?:[+-]?\d{1,2}(?:\.\d{1,4})?|\([+-]?\d{1,2}(?:[./]\d{1,2})?\))(?![\d(._])")
SIGNS = re.compile(r"\*\*|\^")
SUPERSCRIPTS = re.compile(r"[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
WORDS_OF_POWERS = re.compile(r"\b(?:sq|square|squared|cubic|cubed)\b")


def _is_short_unit(text: str) -> bool:
    """Return whether a text is no longer than units are, with powers as they have them: 9**9**9**9 takes for ever."""
    if len(text) > MAX_UNIT_LENGTH:
        return False
    written = SUPERSCRIPTS.sub(lambda found: "**" + "9" * len(found[0]), text)  # whichever: their number counts
    signs = list(SIGNS.finditer(written))
    towers = len(re.findall(r"\)\s*(?:\*\*|\^)", written)) + len(WORDS_OF_POWERS.findall(written))
    return towers < 2 and all(_ends_power(written, sign.end()) for sign in signs)


def _ends_power(text: str, start: int) -> bool:
    """Return whether a small exponent begins here, which is not raised to a power itself."""
    found = EXPONENT.match(text, start)
    return found is not None and not SIGNS.match(text[found.end() :].lstrip())


def _spell_torque(unit: str) -> str:
    """Return a unit whose torques are products of a force and a length."""
    unit = TORQUE.sub(r"(\1*\2)", unit)
    unit = LENGTH_BY_POUND.sub(lambda found: f"({POUNDS[found[2]]}*{_length(found[1])})", unit)
    return POUND_BY_LENGTH.sub(lambda found: f"({POUNDS[found[1]]}*{_length(found[2])})", unit)


def _length(name: str) -> str:
    return {"in": "inch", "ft": "foot"}[name]


@lru_cache
def _quantity(unit: str) -> Any:
    written = _spell_torque(COUNTED.sub(r"\1", SPELLINGS.get(unit, unit)))
    written = PLAIN_POWER.sub(r"**\1", written)
    try:
        if not _is_short_unit(written):
            raise ValueError("no unit is written so")
        if WRITTEN_OUT.fullmatch(written) and written not in _registry():
            written = written.lower()
        if _registry().Quantity(0.0, written).to_base_units().magnitude:
            raise ValueError("a unit with an offset is no factor")
        return _registry().Quantity(1.0, written)
    except Exception:  # its parser raises whatever the text leads it into
        raise ParameterError(
            f"{_quote(unit)} is no known unit; expected one such as N, A, V, mm, um, rad, deg, mm/s or 1"
        ) from None
