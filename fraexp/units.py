"""Units as people write them, turned into the SI numbers that everything inside uses."""

from functools import cache
from typing import TYPE_CHECKING, Any

from fraexp.errors import ParameterError

if TYPE_CHECKING:
    import pint


@cache
def _registry() -> "pint.UnitRegistry[float]":
    import pint  # slow to import, needed only where somebody writes a unit

    return pint.UnitRegistry(cache_folder=None)


def factor(unit: str, expected: str) -> float:
    """Return what a number in `unit` is multiplied by to be in `expected`; ParameterError if it cannot be."""
    import pint

    try:
        return float(_quantity(unit).to(_quantity(expected).units).magnitude)
    except pint.DimensionalityError:
        raise ParameterError(f"'{unit}' is not a unit of the same kind as '{expected}'") from None


def number(text: str, unit: str) -> float:
    """Return the SI number in a text such as ``"0.1 um"`` for a parameter in `unit`."""
    head, _, tail = text.strip().partition(" ")
    try:
        value = float(head)
    except ValueError:
        raise ParameterError(f"'{text}' is not a number with a unit; expected one like '1.5 {unit}'") from None
    return value * factor(tail.strip(), unit) if tail.strip() else value


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


NAMED = ("N", "V", "N*m", "W", "Pa", "N/m", "V/m")
"""Units that keep the name they have in the field: N, not kg·m/s²."""


SPELLINGS = {"": "dimensionless", "1": "dimensionless", "Nm": "N*m", "mNm": "mN*m"}
"""What people write, and pint reads otherwise (its Nm is a measure of yarn)."""


def _quantity(unit: str) -> Any:
    written = SPELLINGS.get(unit, unit)
    try:
        if _registry().Quantity(0.0, written).to_base_units().magnitude:
            raise ValueError("a unit with an offset is no factor")
        return _registry().Quantity(1.0, written)
    except Exception:  # its parser raises whatever the text leads it into
        raise ParameterError(
            f"'{unit}' is no known unit; expected one such as N, A, V, mm, um, rad, deg, mm/s or 1"
        ) from None
