"""The sampling of a record: its rate, the part of it that is used, and its channels on one uniform clock.

What interpolation adds differs from period to period, because the stamps do: the scatter over the periods, and with
it the confidence band, contains it. Input and output of equal stamps are interpolated alike, so that a common loss of
amplitude near the Nyquist frequency cancels in their ratio.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.signals import RecordTable
from fraexp.data.sweep import Plain
from fraexp.errors import RecordError
from fraexp.records.channels import PlainTable, auxiliary_values, clock_unit, resolve_channel
from fraexp.records.record_settings import RecordSettings
from fraexp.records.timebase import (
    GAP_RATIO,
    MAX_JITTER,
    MAX_LOST,
    RESAMPLING_HINT,
    UNIT_HINT,
    ColumnReader,
    TimeStamps,
    agreed_rate,
    check_ascending,
    check_stated_rate,
    examine_stamps,
    find_clock,
    find_time_column,
    sample_rate_of,
    stamps_text,
    uneven_text,
    unknown_rate_error,
)

Interpolation = Callable[[NDArray[Any], NDArray[np.float64], NDArray[np.float64]], NDArray[Any]]
"""Signature of a method: values, their time stamps [s], and the instants [s] at which it returns the values."""
PASSBAND_RATIO = 0.8
"""Highest frequency relative to the Nyquist frequency at which a channel that is sampled faster keeps its amplitude."""
STOPBAND_ATTENUATION_DB = 80.0
FASTER_RATIO = 1.5
"""Rate of a channel relative to the common one from which it is low-pass filtered before."""
RATE_TOLERANCE = 0.01
"""Relative difference by which the common rate may exceed that of the slowest channel."""
MAX_STAMP_DIFFERENCE = 0.01
"""Difference of time stamps of channels, in sample times, up to which they are the same."""
Stamps = Mapping[str, NDArray[np.float64]]
"""Time stamps [s] of each column."""


def plan_sampling(
    settings: RecordSettings, reader: ColumnReader, table: RecordTable, path: Path
) -> tuple[float, PlainTable]:
    """Return the sample rate [Hz] of a record, and as plain data how its samples are used; empty if as they are.

    The keys are `window`, first sample and the one after the last, and `clock`, that of resampled channels; then
    `time` is the column of the time, unless columns have their own.
    """
    column, clock = settings.time_column, 1 / table.sample_time if table.sample_time else None
    if column is None and not table.times:
        if not (clock or settings.resample):
            clock = find_clock(reader, table, path, settings.sample_rate)
        if settings.resample or not (clock or settings.sample_rate):  # then its steps tell what is wrong
            column = find_time_column(reader, table, path)
        if column is None and settings.resample:
            raise RecordError(
                f"{path.name}: resample needs time stamps, and no column is the time; give time_column (--time)"
            )
        if column is not None:
            table = replace(table, columns={**table.columns, **reader.read(path, [column.column]).columns})
    plain: PlainTable = {}
    if column is not None:
        unit = clock_unit(column.column, table.columns[column.column])
        if not (unit or column.unit or table.units.get(column.column)):
            raise RecordError(f"{path.name}: the unit of the time in column '{column.column}' is unknown; {UNIT_HINT}")
        auxiliary_values("time", column, table, unit or "s", path)  # refuses a unit that is none of time
        plain["time"] = {"column": column.column, "scale": resolve_channel("time", column, table, path, unit)["scale"]}
    has_one_rate = table.sample_time is not None and not plain and not settings.resample
    stamps = {} if has_one_rate else _stamps(table, plain, path)
    rate = None if stamps or settings.resample else _uniform_rate(settings, reader, table, clock, path)
    window = _window(settings, stamps, rate, table, path)
    part: PlainTable = {"window": list(window)} if window else {}
    stamps = {name: time[slice(*window)] for name, time in stamps.items()} if window else stamps
    if settings.resample:
        even = plan_clock(stamps, settings.sample_rate, settings.period_time, settings.resample, path.name)
        return even.rate, {**plain, **part, "clock": asdict(even)}
    if rate is None:
        clock_rate = _common_rate(stamps, column.column if column else f"of '{next(iter(stamps))}'", path)
        rate = agreed_rate(settings.sample_rate, clock_rate, path.name)
    return rate, part


def sampling_columns(plain: Plain) -> set[str]:
    """Return the columns that are needed to sample a record so."""
    return {plain["time"]["column"]} if "time" in plain else set()


def sampled_table(table: RecordTable, plain: Plain, path: Path, held: Collection[str] = ()) -> RecordTable:
    """Return the columns of a record as `plan_sampling` says; those `held` change only where they do in the file."""
    stamps = _stamps(table, plain, path) if "clock" in plain else {}
    columns = dict(table.columns)
    if "window" in plain:
        part = slice(*plain["window"])
        columns = {name: values[part] for name, values in columns.items()}
        stamps = {name: time[part] for name, time in stamps.items()}
    if "clock" in plain:
        clock = UniformClock(**plain["clock"])
        columns = {
            name: (hold_values if name in held else resample)(columns[name], time, clock)
            for name, time in stamps.items()
        }
    return replace(table, columns=columns, times={})


def sampling_text(table: RecordTable, plain: Plain, frequency: float, path: Path) -> str:
    """Return how exactly a record was resampled at its highest line [Hz]; empty if it was not."""
    if "clock" not in plain:
        return ""
    stamps = _stamps(table, plain, path)
    part = slice(*plain["window"]) if "window" in plain else slice(None)
    worst = max(stamps.values(), key=lambda time: examine_stamps(time[part]).jitter)
    return resampling_text(worst[part], frequency, UniformClock(**plain["clock"]))


def _stamps(table: RecordTable, plain: Plain, path: Path) -> Stamps:
    """Return the time stamps of each column: those of the stated time, or its own if the file has them."""
    if "time" not in plain:
        lacking = [name for name in table.columns if name not in table.times]
        if table.times and lacking:
            raise RecordError(f"{path.name}: '{lacking[0]}' has no time of its own, as others have; choose another")
        return table.times
    time = table.columns[plain["time"]["column"]] * plain["time"]["scale"]
    others = {name: values for name, values in table.columns.items() if name != plain["time"]["column"]}
    for name, values in others.items():
        if values.size != time.size:
            raise RecordError(
                f"{path.name}: '{name}' has {values.size} samples, and the time {time.size}; "
                f"choose the time of '{name}'"
            )
    return dict.fromkeys(others, time)


def _uniform_rate(
    settings: RecordSettings, reader: ColumnReader, table: RecordTable, clock: float | None, path: Path
) -> float:
    """Return the sample rate [Hz] of a record without time stamps, which its clock or the study states."""
    if settings.sample_rate and clock is None:
        check_stated_rate(settings.sample_rate, reader, path)
    if clock is None and settings.sample_rate is None:
        raise unknown_rate_error(reader, table, path)
    return agreed_rate(settings.sample_rate, clock, path.name)


def _common_rate(stamps: Stamps, column: str, path: Path) -> float:
    """Return the sample rate [Hz] of columns that share their time stamps; RecordError if they do not."""
    first, *others = stamps
    rate = sample_rate_of(stamps[first], f"{path.name}: the time in column '{column}'")
    for name in others:
        same = stamps[name] is stamps[first] or (
            stamps[name].size == stamps[first].size
            and np.abs(stamps[name] - stamps[first]).max() < MAX_STAMP_DIFFERENCE / rate
        )
        if not same:
            theirs = 1 / examine_stamps(stamps[name]).period
            raise RecordError(
                f"{path.name}: the channels have different sample times ('{first}' {1e3 / rate:.6g} ms, "
                f"'{name}' {1e3 / theirs:.6g} ms), or begin at different instants; {RESAMPLING_HINT}"
            )
    return rate


def _window(
    settings: RecordSettings, stamps: Stamps, rate: float | None, table: RecordTable, path: Path
) -> tuple[int, int] | None:
    """Return the samples between `start_time` and `end_time`, by the time stamps if there are some."""
    if not settings.start_time and settings.end_time is None:
        return None
    size = next(iter(table.columns.values())).size
    time = next(iter(stamps.values())) if stamps else np.arange(size) / (rate or 1.0)
    since = time - time[0]
    end = np.inf if settings.end_time is None else settings.end_time
    tolerance = 1e-9 * max(since[-1], 1.0)
    inside = np.flatnonzero((since >= settings.start_time - tolerance) & (since <= end + tolerance))
    if inside.size < 2:
        raise RecordError(f"{path.name}: no samples from start_time to end_time; expected times within {since[-1]:g} s")
    return int(inside[0]), int(inside[-1]) + 1


@dataclass(frozen=True)
class UniformClock:
    """The clock to which channels are brought."""

    start: float
    """First instant [s], on the clock of the stamps."""
    rate: float
    """Sample rate [Hz]."""
    samples: int
    method: str

    @property
    def instants(self) -> NDArray[np.float64]:
        """Its instants [s], shape (samples,)."""
        return self.start + np.arange(self.samples) / self.rate


def plan_clock(
    times: Mapping[str, NDArray[np.float64]], rate: float | None, period_time: float | None, method: str, place: str
) -> UniformClock:
    """Return the common clock of channels with these time stamps [s].

    Its rate is the stated one, or that of the slowest channel, changed so that a stated period is a whole number of
    samples. RecordError if stamps do not ascend, leave too long a gap, or are too few for the stated rate.
    """
    found = {name: _checked_stamps(time, f"{place}: the time of '{name}'") for name, time in times.items()}
    slowest = max(found, key=lambda name: found[name].period)
    nominal = 1 / found[slowest].period
    if rate is not None and rate > (1 + RATE_TOLERANCE) * nominal:
        raise RecordError(
            f"{place}: sample_rate is {rate:.6g} Hz, but '{slowest}' was sampled at {nominal:.6g} Hz; expected no more"
        )
    common = rate or nominal
    if period_time:
        common = max(round(period_time * common), 1) / period_time
    margins = {name: _filter_length(1 / stamps.period, common) / 2 * stamps.period for name, stamps in found.items()}
    start = max(float(time[0]) + margins[name] for name, time in times.items())
    own = times[slowest]  # at its own stamps the slowest channel is exact
    start = float(own[min(int(np.searchsorted(own, start - MAX_JITTER / nominal)), own.size - 1)])
    end = min(float(time[-1]) - margins[name] for name, time in times.items())
    samples = int(np.floor((end - start) * common * (1 + 1e-12))) + 1
    if samples < 2:
        raise RecordError(f"{place}: the channels have no time in common; expected records of the same instants")
    return UniformClock(start, common, samples, method)


def _checked_stamps(time: NDArray[np.float64], place: str) -> TimeStamps:
    check_ascending(time, place)
    found = examine_stamps(time)
    if np.diff(time).max() > (MAX_LOST + GAP_RATIO) * found.period:
        raise RecordError(f"{place} {uneven_text(time)}")
    return found


def resample(values: NDArray[np.float64], time: NDArray[np.float64], clock: UniformClock) -> NDArray[np.float64]:
    """Return a channel at the instants of the clock, shape (samples,).

    A channel that is sampled faster is first freed from what lies above the common Nyquist frequency, by a
    symmetric filter that does not shift it in time.
    """
    own = 1 / examine_stamps(time).period
    taps = _filter_length(own, clock.rate)
    if taps:
        even = time[0] + np.arange(int((time[-1] - time[0]) * own) + 1) / own
        values, time = _low_pass(METHODS[clock.method](values, time, even), own, clock.rate, taps), even
    return METHODS[clock.method](values, time, clock.instants)


def hold_values(values: NDArray[np.float64], time: NDArray[np.float64], clock: UniformClock) -> NDArray[np.float64]:
    """Return the last value before each instant of the clock, for columns that number or select samples."""
    places = np.searchsorted(time, clock.instants + MAX_JITTER / clock.rate, side="right") - 1
    return np.asarray(values[np.clip(places, 0, values.size - 1)])


def resampling_text(time: NDArray[np.float64], frequency: float, clock: UniformClock) -> str:
    """Return in words what was resampled, how, and how exactly at the highest line [Hz].

    That is the root mean square error of interpolating a sine of this frequency, relative to its amplitude.
    """
    turning, exact = (np.exp(2j * np.pi * frequency * (of - clock.start)) for of in (time, clock.instants))
    error = float(np.sqrt(np.mean(np.abs(METHODS[clock.method](turning, time, clock.instants) - exact) ** 2)))
    stamps = examine_stamps(time)
    is_random = stamps.jitter > MAX_JITTER or stamps.lost_count
    share = "and the scatter over periods contains it" if is_random else "which the confidence band does not contain"
    return (
        f"resampled to {clock.rate:.6g} Hz by {DESCRIPTIONS[clock.method]} ({stamps_text(stamps)}): at "
        f"{frequency:.4g} Hz, the highest line, it is exact to {error:.1g} of the amplitude, {share}"
    )


def _filter_length(own: float, common: float) -> int:
    """Return the taps of the filter of a channel with its own rate [Hz]; 0 if it needs none."""
    from scipy.signal import kaiserord

    if own < FASTER_RATIO * common:
        return 0
    width = 2 * (1 - PASSBAND_RATIO) * common / own
    return int(kaiserord(STOPBAND_ATTENUATION_DB, width)[0]) | 1


def _low_pass(values: NDArray[np.float64], own: float, common: float, taps: int) -> NDArray[np.float64]:
    from scipy.signal import fftconvolve, firwin, kaiser_beta

    window = ("kaiser", kaiser_beta(STOPBAND_ATTENUATION_DB))
    return np.asarray(fftconvolve(values, firwin(taps, common / own, window=window), mode="same"))


def _cubic(values: NDArray[Any], time: NDArray[np.float64], instants: NDArray[np.float64]) -> NDArray[Any]:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time - time[0], values)(instants - time[0]))


def _linear(values: NDArray[Any], time: NDArray[np.float64], instants: NDArray[np.float64]) -> NDArray[Any]:
    return np.interp(instants, time, values)


METHODS: Mapping[str, Interpolation] = {"cubic": _cubic, "linear": _linear}
DESCRIPTIONS = {"cubic": "cubic splines", "linear": "straight lines"}
