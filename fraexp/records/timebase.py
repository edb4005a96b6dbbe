"""The clock of a record: what its time stamps show, and the sample rate that they, or a number of the file, state."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fraexp.data.signals import RecordTable
from fraexp.errors import ParameterError, RecordError
from fraexp.records.channels import (
    RATE_NAMES,
    SAMPLE_TIME_NAMES,
    SAMPLE_TIMES,
    TIME_NAMES,
    UNITLESS_MARKS,
    Channel,
    clock_unit,
    guess_role,
    si_unit,
)

MAX_JITTER = 1e-3
"""Largest relative deviation of a time step from the usual one, and of the stated rate from the clock."""
GAP_RATIO = 1.5
"""Time step relative to the usual one above which it is a gap."""
MAX_LOST = 4
"""Samples in a row that resampling may bridge."""
MAX_DECIMALS = 9
"""Decimal places up to which time stamps may be rounded."""
ROUNDING_DEVIATION = 0.55
"""Deviation from a uniform clock, relative to the last digit of the stamps, up to which it is rounding."""
DRIFT_RATIO = 10.0
"""Deviation from a uniform clock relative to its change from sample to sample above which it is drift."""
MAX_CLEAR_JITTER = 0.45
"""Deviation of steps from whole sample times up to which they are counted one by one."""
COMB_STAMPS, COMB_TRIALS, COMB_RANGE, MAX_COMB_STAMPS = 64, 61, 0.1, 2048
"""Stamps of the first trial of a rate, trials each time, their first range relative to the usual rate, and the largest
number of stamps that are looked at."""
MAX_SLIP = 0.5
"""Deviation of uniform steps from one rate, in steps, above which the clock drifts."""
RESAMPLING_HINT = 'resample it: resample = "cubic" (--resample cubic)'
UNIT_HINT = "state the unit of its time, such as us, ms, or day for the dates of a spreadsheet"
MAX_ODD_STEP = 0.5
"""Deviation of a step of the time, in steps, from which a sample is lost or written twice."""
MAX_ODD_SHARE = 0.02
"""Share of such steps above which the stamps are no clock."""
NEAR = 20
"""Stamps on either side of such a step that tell whether it lasts."""
UNIT_FACTORS = (1.0, 1e3, 1e6)
"""Possible units of a number without a unit: Hz, kHz or MHz of a rate; s, ms or µs of a time."""


@dataclass(frozen=True)
class TimeStamps:
    """What the time stamps of a record show: the uniform clock that fits them best, and how they deviate from it."""

    period: float
    """Sample time of the uniform clock [s]."""
    deviation: NDArray[np.float64]
    """Stamps less those of the uniform clock, in sample times, shape (n,)."""
    lost: NDArray[np.int64]
    """Samples missing before the next stamp, shape (n - 1,); jitter of half a step and more may make it -1."""
    digit: float
    """Last decimal digit of the stamps [s]; 0 if they have more than nine decimals."""

    @property
    def lost_count(self) -> int:
        """Number of missing samples."""
        return int(self.lost.sum())

    @property
    def are_rounded(self) -> bool:
        """Whether the stamps are those of a uniform clock with few digits, and a lost sample would show."""
        return not self.lost.any() and self.digit < self.period and self.is_within_digit

    @property
    def is_within_digit(self) -> bool:
        """Whether the deviation is that of the last digit."""
        return float(np.abs(self.deviation).max()) * self.period <= ROUNDING_DEVIATION * self.digit

    @property
    def jitter(self) -> float:
        """Standard deviation from the uniform clock, in sample times."""
        return float(np.std(self.deviation))

    @property
    def drifts(self) -> bool:
        """Whether the deviation changes slowly: the rate itself changes."""
        change = float(np.std(np.diff(self.deviation))) / np.sqrt(2)
        return self.jitter > max(DRIFT_RATIO * change, MAX_JITTER)


def examine_stamps(time: NDArray[np.float64]) -> TimeStamps:
    """Return what the time stamps [s] show, shape (n,) and ascending, of at least two samples."""
    seconds = time - time[0]
    digit, plain = _last_digit(seconds), np.arange(time.size)
    offset, period = _fit_line(plain, seconds)
    numbers = plain
    # Rounding explains the rest without a loss; one single longer step it explains only by a rate that is not round.
    is_one_longer = digit > 0 and round(float(seconds[-1]) / digit) == time.size
    if is_one_longer or np.ptp(seconds - period * plain) > 2 * ROUNDING_DEVIATION * digit:
        numbers = _stamp_numbers(seconds)
        offset, period = _fit_line(numbers, seconds)
    return TimeStamps(period, (seconds - offset) / period - numbers, np.diff(numbers) - 1, digit)


def _stamp_numbers(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the sample of each stamp; where samples are lost, numbers are missing.

    Steps are counted one by one, so that the rate may drift, unless jitter makes them ambiguous: then the stamps are
    compared with one uniform clock.
    """
    period = _comb_period(seconds)
    steps = np.diff(seconds) / period
    whole = np.maximum(np.rint(steps), 1)
    if np.all(np.abs(steps - whole) < MAX_CLEAR_JITTER):
        return np.append(0, np.cumsum(whole)).astype(np.int64)
    phase = float(np.angle(np.sum(np.exp(2j * np.pi * seconds / period)))) / (2 * np.pi)
    return np.rint(seconds / period - phase).astype(np.int64)


def _comb_period(seconds: NDArray[np.float64]) -> float:
    """Return the period [s] of the uniform clock on whose ticks the stamps lie best, whichever of them are missing.

    It is where |Σ exp(2πi t/T)| is greatest (the periodogram of the stamps), near the median step. Twice as many
    stamps are taken each time, because the peak becomes as narrow as the record is long.
    """
    steps = np.diff(seconds)
    rate = 1 / (float(np.median(steps)) or float(seconds[-1]) / steps.size)
    fitted, width = min(COMB_STAMPS, seconds.size), COMB_RANGE * rate
    while True:
        trials = rate + width * np.linspace(-1, 1, COMB_TRIALS)
        used = seconds[: fitted : max(fitted // MAX_COMB_STAMPS, 1)]
        score = np.abs(np.exp(2j * np.pi * trials[:, None] * used).sum(axis=1))
        rate = float(trials[np.argmax(score)])
        if fitted == seconds.size:
            return 1 / rate
        width = 2 / float(seconds[fitted - 1])
        fitted = min(2 * fitted, seconds.size)


def _fit_line(numbers: NDArray[np.int64], seconds: NDArray[np.float64]) -> tuple[float, float]:
    """Return offset and slope of stamps over their numbers."""
    swing = numbers - numbers.mean()
    slope = float(swing @ seconds) / float(swing @ swing)
    return float(seconds.mean() - slope * numbers.mean()), slope


def _last_digit(seconds: NDArray[np.float64]) -> float:
    """Return the last decimal digit that the stamps have [s], or 0 if they have more than nine decimals."""
    for decimals in range(MAX_DECIMALS + 1):
        scaled = seconds * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < MAX_JITTER):
            return float(10.0**-decimals)
    return 0.0


def sample_rate_of(time: NDArray[np.float64], place: str) -> float:
    """Return the sample rate [Hz] of a time column [s], shape (n,); RecordError if it is not uniform.

    Stamps that are rounded to few digits count as uniform if their deviation is that of the last digit.
    """
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    if usual > 0 and np.all(np.abs(steps / usual - 1) <= MAX_JITTER):
        _check_slip(time, usual, place)
        mean = (time[-1] - time[0]) / steps.size
        return float(f"{1 / mean:.10g}")  # the resolution of a column of decimal fractions
    if time.size > 2 and np.all(steps >= 0) and time[-1] > time[0]:
        found = examine_stamps(time)
        if found.are_rounded:
            return float(f"{1 / found.period:.10g}")
        if found.digit > found.period and not found.lost_count and found.is_within_digit:
            rate = f"{1 / found.period:.6g}"
            if found.period < SAMPLE_TIMES[0]:
                raise RecordError(f"{place} steps by {found.period:.3g} s; no machine is sampled so fast: {UNIT_HINT}")
            raise RecordError(
                f"{place} is rounded to {found.digit:g} s, more than a step, so that a lost sample does not show; if "
                f"none is lost, leave out time_column and give sample_rate = {rate} (--sample-rate {rate})"
            )
    check_ascending(time, place)
    raise RecordError(f"{place} {uneven_text(time)}")


def check_ascending(time: NDArray[np.float64], place: str) -> None:
    """Raise RecordError at the first time stamp that is not later than the one before it."""
    backward = np.flatnonzero(np.diff(time) <= 0)
    if time.size < 2 or backward.size:
        where = int(backward[0]) + 1 if backward.size else 1
        raise RecordError(f"{place} does not increase after sample {where}; expected one sample after the other")


def _check_slip(time: NDArray[np.float64], usual: float, place: str) -> None:
    """Raise RecordError if steps that are nearly equal add up to a clock of another rate."""
    uniform = np.linspace(time[0], time[-1], time.size)
    slip = float(np.abs(time - uniform).max()) / usual
    if slip > MAX_SLIP:
        raise RecordError(f"{place} drifts by {slip:.2g} samples from a uniform clock; {RESAMPLING_HINT}")


def uneven_text(time: NDArray[np.float64]) -> str:
    """Return how ascending time stamps are uneven, and what to do about it."""
    found = examine_stamps(time)
    step = found.period
    gaps = np.flatnonzero(np.diff(time) > (MAX_LOST + GAP_RATIO) * step)
    if gaps.size:
        return _gap_text(time, int(gaps[np.argmax(np.diff(time)[gaps])]), gaps.size - 1, step)
    uneven = np.flatnonzero(np.abs(np.diff(time) / step - 1) > MAX_JITTER)
    first = int(uneven[0]) if uneven.size else 0
    others = f", and {uneven.size - 1} more" if uneven.size > 1 else ""
    finding = (
        f"steps by {time[first + 1] - time[first]:.6g} s after sample {first + 1} ({time[first]:.6g} s){others}; "
        f"expected {step:.4g} s within {MAX_JITTER:.1%}: "
    )
    is_uneven = found.lost_count or found.drifts
    rate = (
        ""
        if is_uneven
        else f", or leave out time_column and give sample_rate = {1 / step:.6g} if only the stamps are off"
    )
    return f"{finding}{stamps_text(found)}; {RESAMPLING_HINT}{rate}"


def _gap_text(time: NDArray[np.float64], where: int, others: int, step: float) -> str:
    more = f", and {others} more" if others else ""
    before, after = time[where] - time[0], time[where + 1] - time[0]
    if after > (time[-1] - time[0]) / 2:
        remedy = f"use the part before it: end_time = {before:.6g} (--end-time {before:.6g})"
    else:
        remedy = f"use the part after it: start_time = {after:.6g} (--start-time {after:.6g})"
    return (
        f"has a gap of {time[where + 1] - time[where]:.4g} s after sample {where + 1} ({time[where]:.6g} s){more}; "
        f"expected a step of {step:.4g} s: {remedy}"
    )


def stamps_text(found: TimeStamps) -> str:
    """Return in words how time stamps deviate from a uniform clock."""
    lost = found.lost_count
    total = found.deviation.size + lost
    parts = [f"{lost} of {total} samples are lost ({lost / total:.2g})"] if lost else []
    if found.are_rounded:
        parts.append(f"the stamps are rounded to {found.digit:g} s")
    elif found.drifts:
        parts.append(f"the rate drifts, by {np.ptp(found.deviation):.2g} samples in all")
    elif found.jitter > MAX_JITTER:
        parts.append(f"the stamps jitter by {found.jitter:.1%} of a step (standard deviation)")
    return " and ".join(parts) or (
        "single stamps are off" if np.abs(found.deviation).max() > MAX_JITTER else "uniform stamps"
    )


def agreed_rate(stated: float | None, clock: float | None, place: str) -> float:
    """Return the sample rate [Hz] of the study or of the file's clock, one of which is known; both must agree."""
    if stated is not None and clock is not None and abs(stated / clock - 1) > MAX_JITTER:
        raise RecordError(
            f"{place}: sample_rate is {stated:.6g} Hz, but the time in the file says {clock:.6g} Hz; correct one"
        )
    return float(stated if stated is not None else clock or 0.0)


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
            f"{where + 1}, and by {usual / stated:.4g} s elsewhere{more}: samples are lost or written twice; fix the "
            f"file, or read its time in place of sample_rate (time_column = \"{column}\", --time '{column}')"
        )


def _median_change(values: NDArray[np.float64], at: int) -> float:
    """Return by how much values change from those up to an index to those after it."""
    return float(np.median(values[at + 1 :][:NEAR]) - np.median(values[: at + 1][-NEAR:]))


def find_time_column(reader: ColumnReader, table: RecordTable, path: Path) -> Channel | None:
    """Return an unused column that is the time by its name or its values, though its steps may be uneven, or None."""
    for column, factor in _time_columns(table):
        with suppress(ParameterError, RecordError):
            if not TIME_NAMES.fullmatch(column.strip()):
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
    for name, size in _content_sizes(reader, path).items():
        if size > 1 and guess_role(name, "", (size,)).name == "time":
            unit = "" if table.units.get(name) else clock_unit(name, reader.read(path, [name]).columns[name]) or "UNIT"
            text = f"{name} [{unit}]" if unit else name
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
