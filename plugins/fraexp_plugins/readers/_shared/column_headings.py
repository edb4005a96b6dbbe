"""Headings of columns in text files: name and unit, in whichever way they stand together, and whether it is a time."""

import re
from collections.abc import Sequence

BRACKETS = (("[", "]"), ("(", ")"))
"""Brackets around a unit."""
PLAIN_UNIT = (
    r"%|°C?|[fpnuµμmkMG]?(?:m|s|N|A|V|W|g|Hz|rad|Nm|N\*m|Pa|J|bar|T)(?:[/*·^².\d-]|m|s|min|rad|Hz|N|A|V)*"
    r"|[mkuµμ]?[AV][ _]?(?:rms|pk|eff|p)|d[Bb]|deg(?:/s\S*)?|degrees?|rpm|U/min|1/min|min\^?-1|inc\w*|counts?|cts|bool"
    r"|ticks?|rev|in|lbf?|mdeg|arcsec|raw|[mnuµμ]?sec|seconds?|[Vv]olts?|[Aa]mp(?:ere)?s?|[Nn]ewtons?|[Hh]ertz"
)
UNIT_PATTERN = re.compile(rf"-|–|1|[\[(].*[\])]|{PLAIN_UNIT}|Sec|Sequence")
"""A cell in a line of units."""
JOINED_UNIT = re.compile(
    rf"(?P<name>[^/]*[^/\s,])(?:\s*/\s*|\s+in\s+|,\s+)\(?(?P<unit>(?<=\()[^()]+(?=\))|{PLAIN_UNIT})\)?"
)
"""A heading such as ``F/kN`` or ``v/(mm/s)`` (ISO 80000-1: quantity over unit), ``Phase in °`` or ``Force, N``."""
CLOCK_FACTORS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "sec": 1.0, "Sec": 1.0, "msec": 1e-3,
    "usec": 1e-6, "nsec": 1e-9, "second": 1.0, "seconds": 1.0, "min": 60.0, "h": 3600.0,
}  # fmt: skip
"""Units of a column of time."""
AMBIGUOUS_CLOCK_UNITS = ("min", "h")
"""Units of a column of time that alone do not make it one."""
TIME_NAMES = ("t", "time", "zeit", "timestamp", "x_value", "x-axis")


def name_and_unit(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading such as ``Position [mm]``; in ``iq[0]`` the number is an index."""
    for opening, closing in BRACKETS:
        name, bracket, unit = heading.removesuffix(closing).rpartition(opening)
        if heading.endswith(closing) and bracket and name.strip() and closing not in unit:
            if unit.strip().isdigit() and not name.endswith(" "):
                break
            return name.rstrip(), unit
    return heading, None


def names_and_units(headings: Sequence[str]) -> list[tuple[str, str | None]]:
    """Return name and unit of each heading of a table, with brackets around the units or without.

    ``F/kN`` counts only if the table has another such heading: a name may contain a slash.
    """
    found = [name_and_unit(heading) for heading in headings]
    if any(unit and not name.endswith("/") for name, unit in found):
        return found
    joined = [JOINED_UNIT.fullmatch(heading) for heading in headings]
    pairs = [(match["name"], match["unit"]) for match in joined if match]
    is_alone = len(pairs) < 2 or all(UNIT_PATTERN.fullmatch(name) for name, _ in pairs)  # m/s and mm/s are units
    is_complete = len(pairs) == sum(map(bool, headings))
    if is_alone or not (is_complete or any(unit in (*CLOCK_FACTORS, "Hz") for _, unit in pairs)):
        return found
    return [(match["name"], match["unit"]) if match else plain for match, plain in zip(joined, found, strict=True)]


def is_time(name: str, unit: str | None) -> bool:
    """Say whether a column of this name and unit is evidently the time."""
    stated = (unit or "").strip()
    return (stated in CLOCK_FACTORS and stated not in AMBIGUOUS_CLOCK_UNITS) or name.strip().lower() in TIME_NAMES
