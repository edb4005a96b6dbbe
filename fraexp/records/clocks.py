"""Clocks in a record's file that the study does not name: a column of time, or a number with a name such as fs."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fraexp.data.record_table import RecordTable
from fraexp.errors import ParameterError, RecordError
from fraexp.records.channels import Channel
from fraexp.records.quantities import UNITLESS_MARKS, si_unit
from fraexp.records.timebase import MAX_JITTER, sample_rate_of

MAX_ODD_STEP = 0.5
"""Deviation of a step of the time, in steps, from which a sample is lost or written twice."""
MAX_ODD_SHARE = 0.02
"""Share of such steps above which the stamps are no clock."""
NEAR = 20
"""Stamps on either side of such a step that tell whether it lasts."""
TIME_NAMES = re.compile(r"time|t|zeit|timestamp", re.IGNORECASE)
"""Names of a column that is the time even if it is uneven."""
RATE_NAMES = re.compile(r"fs|f_s|f_?samp\w*|sampl(e|ing)_?(rate|freq\w*)|abtastrate", re.IGNORECASE)
"""Names of a number that is the sample rate."""
SAMPLE_TIME_NAMES = re.compile(r"ts|dt|sampl(e|ing)_?(time|period)|abtastzeit", re.IGNORECASE)
"""Names of a number that is the sample time."""
UNIT_FACTORS = (1.0, 1e3, 1e6)
"""Possible units of a number without a unit: Hz, kHz or MHz of a rate; s, ms or µs of a time."""


class ColumnReader(Protocol):
    """What reads columns: the reader of a file, or of several files that are joined."""

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        """Return the named columns."""


def find_clock(reader: ColumnReader, table: RecordTable, path: Path, stated: float | None) -> float | None:
    """Return the sample rate [Hz] of an unused column that is evidently the time, or None.

    Its unit must be one of time. It must be uniform, or if a rate [Hz] is `stated` have the name of a time and
    increase; RecordError if it keeps that rate but for a few steps.
    """
    for column, factor in _time_columns(table):
        rate = None
        with suppress(ParameterError, RecordError):  # such a column is not a clock
            time = reader.read(path, [column]).columns[column] * factor
            must_be_even = stated is None or not TIME_NAMES.fullmatch(column.strip())
            rate = sample_rate_of(time, column) if must_be_even else _mean_rate(time)
        if rate is not None:
            if stated is not None:
                _check_single_steps(time, stated, column, path)
            return rate
    return None


def _check_single_steps(time: NDArray[np.float64], stated: float, column: str, path: Path) -> None:
    """Raise RecordError if stamps [s] keep the stated rate [Hz] but for a few steps, which no rounding explains."""
    steps, slip = np.diff(time) * stated, time * stated - np.arange(time.size)
    usual = float(np.median(steps))
    odd = np.flatnonzero(np.abs(steps - usual) > MAX_ODD_STEP)
    if abs(usual - 1) * steps.size > MAX_ODD_STEP or odd.size > MAX_ODD_SHARE * steps.size:
        return
    # Jitter is made up for by the next stamps, a lost sample never.
    lasting = [at for at in odd.tolist() if abs(_median_change(slip, at)) > MAX_ODD_STEP]
    if lasting:
        where, more = lasting[0], f" ({len(lasting)} such steps)" if len(lasting) > 1 else ""
        raise RecordError(
            f"{path.name}: the time in column '{column}' goes on by {steps[where] / stated:.4g} s after sample "
            f"{where + 1}, and by {usual / stated:.4g} s elsewhere{more}: samples are lost or written twice; mend the "
            f"file, or read its time in place of sample_rate (time_column = \"{column}\", --time '{column}')"
        )


def _median_change(values: NDArray[np.float64], at: int) -> float:
    """Return by how much values change from those up to an index to those after it."""
    return float(np.median(values[at + 1 :][:NEAR]) - np.median(values[: at + 1][-NEAR:]))


def find_time_column(reader: ColumnReader, table: RecordTable, path: Path) -> Channel | None:
    """Return an unused column that is evidently the time, though its steps may be uneven, or None."""
    for column, factor in _time_columns(table):
        with suppress(ParameterError, RecordError):
            _mean_rate(reader.read(path, [column]).columns[column] * factor)
            return Channel(column=column)
    return None


def _time_columns(table: RecordTable) -> Iterator[tuple[str, float]]:
    """Yield the unused columns with a unit of time, and their factors to seconds."""
    for column, unit in table.units.items():
        with suppress(ParameterError):
            factor, short = si_unit(unit, "")
            if column not in table.columns and short == "s" and unit.strip() not in UNITLESS_MARKS:
                yield column, factor


def _mean_rate(time: NDArray[np.float64]) -> float:
    steps = np.diff(time)
    if not (np.isfinite(time).all() and (steps >= 0).all() and steps.any()):
        raise RecordError("it does not increase")
    resolution = float(steps[steps > 0].min())  # resolution of a time with few digits
    if resolution > MAX_JITTER * (time[-1] - time[0]):
        return sample_rate_of(time, "it")
    return float(steps.size / (time[-1] - time[0]))


def check_stated_rate(stated: float, reader: ColumnReader, path: Path) -> None:
    """Raise RecordError if a number in the file is a sample rate by its name and differs from the stated one [Hz]."""
    numbers = _rates_in_file(reader, path)
    if numbers and not any(
        abs(stated / (rate * by) - 1) <= MAX_JITTER for rate in numbers.values() for by in UNIT_FACTORS
    ):
        name, rate = next(iter(numbers.items()))
        raise RecordError(
            f"{path.name}: sample_rate is {stated:.6g} Hz, but '{name}' in the file says {rate:.6g} Hz; correct one"
        )


def unknown_rate_error(reader: ColumnReader, table: RecordTable, path: Path) -> RecordError:
    """Return the error for a record without a sample rate; it names what in the file may be one."""
    place = f"{path.name}: the sample rate is unknown; give"
    time = next(
        (
            name
            for name, size in _content_sizes(reader, path).items()
            if size > 1 and TIME_NAMES.fullmatch(_short_name(name))
        ),
        "",
    )
    if time:
        text = time if table.units.get(time) else f"{time} [s]"
        return RecordError(
            f"{place} time_column = \"{text}\" (--time '{text}') if that is the time, or sample_rate [Hz]"
        )
    for name, rate in _rates_in_file(reader, path).items():
        return RecordError(
            f"{place} sample_rate = {rate:.6g} (--sample-rate {rate:.6g}), if '{name}' in the file is in SI units"
        )
    return RecordError(f"{place} sample_rate [Hz] (--sample-rate), or time_column = the column with the time (--time)")


def _rates_in_file(reader: ColumnReader, path: Path) -> dict[str, float]:
    """Return the sample rates [Hz] that single numbers in the file give, by their names."""
    found = {}
    for name, size in _content_sizes(reader, path).items():
        rate, time = RATE_NAMES.fullmatch(_short_name(name)), SAMPLE_TIME_NAMES.fullmatch(_short_name(name))
        if size == 1 and (rate or time):
            value = float(reader.read(path, [name]).columns[name][0])
            if np.isfinite(value) and value > 0:
                found[name] = value if rate else 1 / value
    return found


def _content_sizes(reader: ColumnReader, path: Path) -> dict[str, int]:
    """Return the number of values of each variable in the file, by name; empty if the reader cannot list them."""
    listing = getattr(reader, "contents", None)
    with suppress(RecordError):  # variables that are not used may be damaged or too large
        return {name: int(np.prod(shape)) for name, (shape, _) in listing(path).items()} if listing else {}
    return {}


def _short_name(name: str) -> str:
    return name.rpartition(".")[2].strip()
