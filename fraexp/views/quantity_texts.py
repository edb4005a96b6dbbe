"""Numbers with their units as people read them: displacements in mm, µm or nm, powers as m/(N s²)."""

from collections.abc import Iterable, Sequence

from fraexp.figures.elements.scales import column_unit


def with_unit(text: str, unit: str) -> str:
    """Return a text with its unit, if it has both."""
    return f"{text} {unit}" if text and unit not in ("", "1") else text


def scale_values(values: Sequence[object], unit: str) -> tuple[list[object], str]:
    """Return values and lists of numbers that are given in `unit`, in the unit in which they are read; and this unit.

    A unit of 1, and that of no numbers, becomes an empty one; what is no number stays as it is.
    """
    numbers = _numbers(values)
    factor, shown = column_unit(numbers, unit) if numbers else (1.0, "")
    return [_scaled(value, factor) for value in values], "" if shown == "1" else shown


def _numbers(values: Iterable[object]) -> list[object]:
    parts = (list(value) if isinstance(value, list | tuple) else [value] for value in values)
    return [number for part in parts for number in part if _is_number(number)]


def _scaled(value: object, factor: float) -> object:
    if isinstance(value, list | tuple):
        return [_scaled(part, factor) for part in value]
    return factor * value if factor != 1 and isinstance(value, int | float) and _is_number(value) else value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
