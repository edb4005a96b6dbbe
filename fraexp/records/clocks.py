"""Clocks in a record's file that nobody has named: a column of time, or a number that is called such as fs."""

import re
from contextlib import suppress
from pathlib import Path

import numpy as np

from fraexp.components.kinds import RecordReader, RecordTable
from fraexp.errors import ParameterError, RecordError
from fraexp.records.quantities import PURE, si_of
from fraexp.records.timebase import JITTER, rate_of

TIMES = re.compile(r"time|t|zeit|timestamp", re.IGNORECASE)
"""What a column is called that is the time even if it is not written evenly."""
RATES = re.compile(r"fs|f_s|f_?samp\w*|sampl(e|ing)_?(rate|freq\w*)|abtastrate", re.IGNORECASE)
"""What a number is called that is the sample rate."""
SAMPLE_TIMES = re.compile(r"ts|dt|sampl(e|ing)_?(time|period)|abtastzeit", re.IGNORECASE)
"""What a number is called that is the sample time."""
PREFIXES = (1.0, 1e3, 1e6)
"""Factors by which a number without a unit may state a rate: Hz, kHz or MHz; or a time: s, ms or µs."""


def evident_clock(reader: RecordReader, table: RecordTable, path: Path, even: bool) -> float | None:
    """Return the sample rate [Hz] of a column that nobody asked for and that is evidently the time, or None.

    Its unit must be one of time, and it must be uniform, or unless `even` be called time and increase.
    """
    for column, unit in table.units.items():
        if column in table.columns:
            continue
        with suppress(ParameterError, RecordError):  # whatever else it may be, it is no clock
            factor, short = si_of(unit, "")
            if short == "s" and unit.strip() not in PURE:
                time = reader.read(path, [column]).columns[column] * factor
                return rate_of(time, column) if even or not TIMES.fullmatch(column.strip()) else _mean_rate(time)
    return None


def _mean_rate(time: np.ndarray) -> float:
    steps = np.diff(time)
    if not (np.isfinite(time).all() and (steps >= 0).all() and steps.any()):
        raise RecordError("it does not increase")
    resolution = float(steps[steps > 0].min())  # of time that is written with few digits
    if resolution > JITTER * (time[-1] - time[0]):
        return rate_of(time, "it")
    return float(steps.size / (time[-1] - time[0]))


def check_numbers(stated: float, reader: RecordReader, path: Path) -> None:
    """Raise RecordError if a number in the file is called such as fs and is not the stated sample rate [Hz]."""
    numbers = _numbers(reader, path)
    if numbers and not any(abs(stated / (rate * by) - 1) <= JITTER for rate in numbers.values() for by in PREFIXES):
        name, rate = next(iter(numbers.items()))
        raise RecordError(
            f"{path.name}: sample_rate is {stated:.6g} Hz, but '{name}' in the file says {rate:.6g} Hz; correct one"
        )


def unknown_rate(reader: RecordReader, table: RecordTable, path: Path) -> RecordError:
    """Return the error for a record whose sample rate nobody has told; it names what in the file may tell it."""
    place = f"{path.name}: the sample rate is unknown; give"
    time = next((name for name, size in _sizes(reader, path).items() if size > 1 and TIMES.fullmatch(_last(name))), "")
    if time:
        text = time if table.units.get(time) else f"{time} [s]"
        return RecordError(f"{place} time = \"{text}\" (--time '{text}') if that is the time, or sample_rate [Hz]")
    for name, rate in _numbers(reader, path).items():
        return RecordError(
            f"{place} sample_rate = {rate:.6g} (--sample-rate {rate:.6g}), if '{name}' in the file is in SI units"
        )
    return RecordError(f"{place} sample_rate [Hz] (--sample-rate), or time = the column with the time (--time)")


def _numbers(reader: RecordReader, path: Path) -> dict[str, float]:
    """Return the sample rates [Hz] that single numbers in the file state, by their names."""
    found = {}
    for name, size in _sizes(reader, path).items():
        rate, time = RATES.fullmatch(_last(name)), SAMPLE_TIMES.fullmatch(_last(name))
        if size == 1 and (rate or time):
            value = float(reader.read(path, [name]).columns[name][0])
            if np.isfinite(value) and value > 0:
                found[name] = value if rate else 1 / value
    return found


def _sizes(reader: RecordReader, path: Path) -> dict[str, int]:
    """Return of how many numbers everything in the file is, by name; nothing if the reader cannot tell."""
    listing = getattr(reader, "contents", None)
    with suppress(RecordError):  # something that nobody has asked for may be damaged, or too large
        return {name: int(np.prod(shape)) for name, (shape, _) in listing(path).items()} if listing else {}
    return {}


def _last(name: str) -> str:
    return name.rpartition(".")[2].strip()
