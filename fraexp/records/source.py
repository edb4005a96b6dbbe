"""From a study's record to plain data that identifies it, and from that to signals."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components import RecordReader, Table
from fraexp.errors import RecordError, did_you_mean
from fraexp.identity import file_hash
from fraexp.plugins import Registry, create
from fraexp.records.cutting import Cut, periodic_cut, step_cuts, steps_of
from fraexp.records.lines import check_steps, excited_lines
from fraexp.records.quantities import auxiliary_values, evident_clock, in_si, values_of
from fraexp.records.repeats import check_repeats, detected_period, seems_to_repeat
from fraexp.records.settings import Channel, RecordSettings
from fraexp.records.timebase import agreed_rate, rate_of
from fraexp.signals import Segment, Signals

Plain = dict[str, Any]


def resolve(settings: RecordSettings, base_folder: Path, registry: Registry) -> tuple[Plain, dict[str, str]]:
    """Return the experiment that the settings describe, as plain data, and where its file is.

    The experiment holds the file's content hash, the sample rate [Hz], each channel's column and factor to its SI
    unit, and the cuts with their excited harmonics, so that however a study says it, the same signals have one
    key. All that can be wrong with a record is found here: RecordError or ParameterError in one line.
    """
    path = _existing(Path(os.path.normpath(base_folder / settings.file)))  # the folder itself may be yet to come
    reader = _reader(settings.reader, path, registry)
    wanted = {**settings.channels, **_auxiliary(settings)}
    table = _read(reader, path, {channel.column for channel in wanted.values()})
    plain = {name: in_si(name, channel, table, path) for name, channel in settings.channels.items()}
    values = {name: values_of(table, channel, name, path) for name, channel in plain.items()}
    rate = _rate(settings, reader, table, path)
    cuts = _cuts(settings, values, table, rate, path)
    record: Plain = {
        "hash": file_hash(path),
        "reader": reader.spec(),
        "sample_rate": rate,
        "channels": plain,
        "segments": [cut.plain() for cut in cuts],
    }
    return {"source": "record", "record": record}, {"record": str(path)}


def load(experiment: Mapping[str, Any], files: Mapping[str, str], registry: Registry) -> Signals:
    """Return the signals of a resolved record; RecordError if its file is gone or has changed since."""
    record = experiment["record"]
    path = _existing(Path(files["record"]))
    if file_hash(path) != record["hash"]:
        raise RecordError(f"{path.name}: the file has changed since the study was read; run the study again")
    reader = create(registry, RecordReader, record["reader"], place=path.name)  # type: ignore[type-abstract]
    channels: Mapping[str, Plain] = record["channels"]
    table = _read(reader, path, {channel["column"] for channel in channels.values()})
    values = {name: values_of(table, channel, name, path) for name, channel in channels.items()}
    segments = tuple(
        Segment(
            cut.sample_time, {name: cut.blocks_of(samples) for name, samples in values.items()}, np.array(cut.lines)
        )
        for cut in map(Cut.of, record["segments"])
    )
    return Signals(segments, {name: str(channel["unit"]) for name, channel in channels.items()})


def _existing(path: Path) -> Path:
    if path.is_file():
        return path.resolve()
    if not path.parent.is_dir():
        raise RecordError(f"{path}: there is no folder '{path.parent}'; correct record.file")
    others = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix]
    raise RecordError(f"{path}: there is no such file{did_you_mean(path.name, others)}")


def _reader(name: str, path: Path, registry: Registry) -> RecordReader:
    fitting = [
        known
        for known in registry.names(RecordReader.kind)
        if path.suffix.lower() in getattr(registry.supply(RecordReader.kind, known).component, "suffixes", ())
    ]
    if not name and len(fitting) != 1:
        which = f"readers {', '.join(fitting)} all read" if fitting else "no reader reads"
        known = ", ".join(registry.names(RecordReader.kind))
        raise RecordError(f"{path.name}: {which} '{path.suffix}'; give reader = one of {known}")
    return create(registry, RecordReader, {"name": name or fitting[0]}, place=path.name)  # type: ignore[type-abstract]


def _auxiliary(settings: RecordSettings) -> dict[str, Channel]:
    found = {"time": settings.time, "frequency": settings.frequency}
    return {f" {name}": channel for name, channel in found.items() if channel is not None}


def _read(reader: RecordReader, path: Path, columns: set[str]) -> Table:
    table = reader.read(path, sorted(columns))
    lengths = {name: samples.size for name, samples in table.columns.items()}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"'{name}' {length}" for name, length in lengths.items())
        raise RecordError(f"{path.name}: the columns have different numbers of samples ({text}); expected equal ones")
    for name, samples in table.columns.items():
        bad = np.flatnonzero(~np.isfinite(samples))
        if bad.size:
            raise RecordError(
                f"{path.name}: {bad.size} of {samples.size} samples in '{name}' are no finite numbers, "
                f"the first is sample {bad[0] + 1}; mend or cut them out"
            )
    return table


def _rate(settings: RecordSettings, reader: RecordReader, table: Table, path: Path) -> float:
    clock = 1 / table.sample_time if table.sample_time else None
    if settings.time is not None:
        time = auxiliary_values("time", settings.time, table, "s", path)
        clock = rate_of(time, f"{path.name}: the time in column '{settings.time.column}'")
    elif settings.sample_rate and clock is None:
        clock = evident_clock(reader, table, path)
    return agreed_rate(settings.sample_rate, clock, path.name)


def _cuts(settings: RecordSettings, values: dict[str, np.ndarray], table: Table, rate: float, path: Path) -> list[Cut]:
    name = settings.reference
    if name not in values:
        raise RecordError(f"{path.name}: input is '{name}', which is no channel{did_you_mean(name, values)}")
    channel = values[name]
    ways = [key for key in ("period", "period_time", "steps", "frequency") if getattr(settings, key)]
    if len(ways) != 1:
        raise _undecided(ways, channel, rate, path.name)
    if ways[0] in ("period", "period_time"):
        cut = periodic_cut(settings, rate, channel.size, path.name)
        check_repeats(cut, channel, rate, name, path.name)
        return [replace(cut, lines=excited_lines(settings, cut, channel, path.name))]
    steps = list(settings.steps)
    if settings.frequency is not None:
        steps = steps_of(auxiliary_values("frequency", settings.frequency, table, "Hz", path), rate)
    if not steps:
        raise RecordError(f"{path.name}: the frequency is nowhere above 0; expected one for each step")
    cuts = step_cuts(settings, steps, rate, channel.size, path.name)
    check_steps(cuts, channel, rate, name, path.name)
    return cuts


def _undecided(ways: list[str], channel: np.ndarray, rate: float, place: str) -> RecordError:
    if ways:
        return RecordError(f"{place}: {' and '.join(ways)} are both given; expected one of them")
    found = detected_period(channel)
    seems = f": {seems_to_repeat(found, rate)}" if found else ", as period = N (--period N)"
    return RecordError(
        f"{place}: give period (samples) or period_time (s) of a periodic record{seems}; "
        "or steps or frequency of a stepped sine"
    )
