"""Numbers, times and nested data as text; displacements in mm, µm or nm, powers as m/(N s²)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from fraexp.data.texts import frequency_text
from fraexp.figures.elements.scales import column_unit

MAX_LIST_ITEMS = 4
"""Maximum number of list items shown; of longer lists the ends are."""
UNIT_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def number_text(value: float | None, digits: int = 6) -> str:
    """Return a number in short; ``-`` if unknown."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def fixed_text(value: float, decimals: int) -> str:
    """Return a number with fixed decimals; ``-`` if unknown."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else "-"  # + 0.0: never -0.00


def timestamp_text(time: datetime | None) -> str:
    """Return a point in time, in the local time zone."""
    return "" if time is None else time.astimezone().strftime("%Y-%m-%d %H:%M:%S")


def duration_text(seconds: float) -> str:
    """Return a duration [s] in its two leading units."""
    if seconds < 60:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def elapsed_text(elapsed: float, expected: float) -> str:
    """Return how long something has taken [s], of the time that was expected; 0 where that is not known."""
    return (
        f"{duration_text(elapsed)} of about {duration_text(expected)}"
        if expected
        else f"{duration_text(elapsed)} so far"
    )


def plural(count: int, word: str, many: str = "") -> str:
    """Return a count with its word: ``1 sweep``, ``2 sweeps``; `many` where adding s is wrong."""
    return f"{count} {word if count == 1 else many or f'{word}s'}"


def short_key(key: str) -> str:
    """Return the short form of a sweep key, which users type."""
    return key.partition("-")[2][:8]


def summarise_segments(experiment: Mapping[str, Any]) -> dict[str, Any]:
    """Return an experiment in which the segments of a record are one text: their number and frequency range."""
    record = experiment.get("record", {})
    segments = record.get("segments")
    if not isinstance(segments, list) or not segments:
        return dict(experiment)
    return {**experiment, "record": {**record, "segments": _segments_text(segments)}}


def _segments_text(segments: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        line / (segment["samples"] * segment["sample_time"])
        for segment in segments
        if segment.get("samples") and segment.get("sample_time")
        for line in segment.get("lines") or ()
    ]
    span = f", {frequency_text(lines)}" if lines else ""
    return f"{plural(len(segments), 'segment')}{span}"


def flatten(data: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Return nested data by dotted path; a list of plain values is one value."""
    found: dict[str, object] = {}
    for key, value in data.items():
        inner = _index_items(value)
        if isinstance(inner, Mapping) and inner:
            found |= flatten(inner, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = inner
    return found


def _index_items(value: Any) -> Any:
    nested = isinstance(value, list) and any(isinstance(item, Mapping | list) for item in value)
    return {str(index): item for index, item in enumerate(value)} if nested else value


def value_text(value: object) -> str:
    """Return one value of `flat` in short."""
    if isinstance(value, list):
        texts = [value_text(item) for item in value]
        ends = texts if len(texts) <= MAX_LIST_ITEMS else [texts[0], "...", texts[-1]]
        return f"[{', '.join(ends)}]" + (f" ({len(texts)} values)" if len(texts) > MAX_LIST_ITEMS else "")
    if isinstance(value, float):
        return f"{value:.10g}"
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else str(value)


def prefixed_text(value: float, unit: str = "") -> str:
    """Return a number with a prefix before its unit: ``150 kN/m``."""
    if not math.isfinite(value) or abs(value) < UNIT_PREFIXES[-1][0] / 1000:
        value = value if not math.isfinite(value) else 0.0
        return f"{value:g} {unit}".strip()
    factor, prefix = next((pair for pair in UNIT_PREFIXES if abs(value) >= 0.9999995 * pair[0]), UNIT_PREFIXES[-1])
    blank = " " if unit else ""
    return f"{value / factor:.4g}{blank}{prefix}{unit}"


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
