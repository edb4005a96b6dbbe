"""The sampling of a record: its rate, the part of it that is used, and whether it is resampled."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.data.record_table import RecordTable
from fraexp.data.sweep import Plain
from fraexp.errors import RecordError
from fraexp.records.channels import Channel
from fraexp.records.clocks import ColumnReader, check_stated_rate, find_clock, find_time_column, unknown_rate_error
from fraexp.records.quantities import PlainTable, auxiliary_values, clock_unit, resolve_channel
from fraexp.records.record_settings import RecordSettings
from fraexp.records.resampling import UniformClock, hold_values, plan_clock, resample, resampling_text
from fraexp.records.timebase import RESAMPLING_HINT, agreed_rate, examine_stamps, sample_rate_of

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
    column = settings.time_column
    if column is None and settings.resample and not table.times:
        column = find_time_column(reader, table, path)
        if column is None:
            raise RecordError(
                f"{path.name}: resample needs time stamps, and no column is the time; give time_column (--time)"
            )
        table = _with_column(reader, table, column, path)
    plain: PlainTable = {}
    if column is not None:
        unit = clock_unit(column.column, table.columns[column.column])
        auxiliary_values("time", column, table, unit, path)  # refuses a unit that is none of time
        plain["time"] = {"column": column.column, "scale": resolve_channel("time", column, table, path, unit)["scale"]}
    has_one_rate = table.sample_time is not None and not plain and not settings.resample
    stamps = {} if has_one_rate else _stamps(table, plain, path)
    rate = None if settings.resample else _uniform_rate(settings, reader, table, stamps, path)
    window = _window(settings, stamps, rate, table, path)
    if window:
        plain["window"] = list(window)
        stamps = {name: time[slice(*window)] for name, time in stamps.items()}
    if settings.resample:
        clock = plan_clock(stamps, settings.sample_rate, settings.period_time, settings.resample, path.name)
        plain["clock"] = clock.as_plain()
        return clock.rate, plain
    if stamps and rate is None:
        clock_rate = _common_rate(stamps, column.column if column else f"of '{next(iter(stamps))}'", path)
        return agreed_rate(settings.sample_rate, clock_rate, path.name), {"window": plain["window"]} if window else {}
    assert rate is not None  # without stamps it was found above
    return rate, {"window": plain["window"]} if window else {}


def _with_column(reader: ColumnReader, table: RecordTable, column: Channel, path: Path) -> RecordTable:
    more = reader.read(path, [column.column])
    return replace(table, columns={**table.columns, **more.columns})


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
    settings: RecordSettings, reader: ColumnReader, table: RecordTable, stamps: Stamps, path: Path
) -> float | None:
    """Return the sample rate [Hz] of a record without time stamps; None if it has some."""
    if stamps:
        return None
    clock = 1 / table.sample_time if table.sample_time else None
    if clock is None:
        clock = find_clock(reader, table, path, settings.sample_rate)
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
