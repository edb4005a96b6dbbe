"""Dates with times of day in text files, as seconds."""

import re
from collections.abc import Sequence
from datetime import date, datetime, time

DATE_PATTERN = re.compile(
    r"(?:(?:(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)|(?P<day_first>\d\d)\.(?P<month_next>\d\d)\.(?P<year_last>\d{4})"
    r"|(?P<month_first>\d\d?)/(?P<day_next>\d\d?)/(?P<year_end>\d{4}))"
    r"(?:T|\s+))?(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d)(?P<fraction>[.,;]\d+)?(?P<zone>Z|[+-]\d\d:?\d\d)?"
    r"(?:\s*(?P<half>[AP])M)?"
)
"""ISO 8601 with a time of day, such as ``2026-03-05T14:02:59.500``, ``05.03.2026 14:02:59,500``, or
``3/5/2026 2:02:59.500 PM``; a time of day alone is one of some day."""

NAMES = (("year", "year_last", "year_end"), ("month", "month_next", "month_first"), ("day", "day_first", "day_next"))
"""Groups of the pattern, in the order of ISO 8601."""


def first_day(cells: Sequence[str]) -> date | None:
    """Return the day of the first cell if all cells are dates with a time of day; otherwise None."""
    try:
        moments = [_moment(cell)[0] for cell in cells]
    except ValueError:
        return None
    return moments[0].date() if moments else None


def seconds_since(cell: str, day: date) -> float:
    """Return the seconds [s] of a cell since the beginning of a day; ValueError if it is no date.

    They are counted from that day, because a number since 1970 has no digits left for microseconds.
    """
    moment, fraction = _moment(cell)
    start = datetime.combine(day, time(), moment.tzinfo)
    return (moment - start).total_seconds() + fraction


def _moment(cell: str) -> tuple[datetime, float]:
    """Return whole seconds and their fraction [s]; ValueError if a cell is no date."""
    found = DATE_PATTERN.fullmatch(cell.strip())
    if found is None:
        raise ValueError(f"'{cell}' is no date with a time of day")
    year, month, day = (next((int(found[name]) for name in names if found[name]), 1) for names in NAMES)
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + 12 * (found["half"] == "P")
    fraction = "." + (found["fraction"] or ".0")[1:]
    text = f"{year:04d}-{month:02d}-{day:02d}T{hour:02d}:{found['minute']}:{found['second']}{found['zone'] or ''}"
    return datetime.fromisoformat(text), float(f"0{fraction}")
