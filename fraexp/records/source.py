"""From a study's record to plain data that identifies it, and from that to signals."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.kinds import RecordReader, RecordTable
from fraexp.components.registry import Registry, create
from fraexp.data.identity import file_hash
from fraexp.data.signals import Segment, Settling, Signals
from fraexp.errors import RecordError, did_you_mean
from fraexp.records.calculus import integrated
from fraexp.records.channels import Channel
from fraexp.records.clocks import check_numbers, evident_clock, unknown_rate
from fraexp.records.cutting import Cut, periodic_cut, realisations_of, step_cuts, steps_of, whole_cut
from fraexp.records.excited import doubts
from fraexp.records.line_selection import check_steps, common_lines, with_lines
from fraexp.records.quantities import auxiliary_values, columns_of, in_si, values_of
from fraexp.records.record_segments import check_levels, condition, runs_in
from fraexp.records.record_settings import RecordSettings
from fraexp.records.repeats import check_repeats, detected_period, seems_to_repeat
from fraexp.records.timebase import JITTER, agreed_rate, rate_of

Plain = dict[str, Any]
AS_FROM_REST = Settling(settled=True, time=0.0, residual=float("nan"))
"""Of a record that does not repeat itself: nothing is known of what came before its first sample."""


@dataclass(frozen=True)
class _Part:
    """A file, or a realisation in it, with the plan of its segments."""

    path: Path
    reader: Plain
    channels: dict[str, Plain]
    values: dict[str, np.ndarray]
    rate: float
    cuts: list[Cut]

    def blocks(self, name: str) -> list[np.ndarray]:
        """Return the blocks of a channel in each segment, each of shape (blocks, samples)."""
        return [cut.blocks_of(self.values[name]) for cut in self.cuts]


def resolve(settings: RecordSettings, base_folder: Path, registry: Registry) -> tuple[Plain, dict[str, str]]:
    """Return the experiment that the settings describe, as plain data, and where its files are.

    The experiment holds the file's content hash, the sample rate [Hz], each channel's column and factor to its SI
    unit, and the cuts with their excited harmonics, so that however a study says it, the same signals have one
    key. All that can be wrong with a record is found here: RecordError or ParameterError in one line.
    """
    parts = [_part(one, Path(os.path.normpath(base_folder / file)), registry) for file, one in settings.parts()]
    _check_alike(parts)
    cuts = [cut for part in parts for cut in part.cuts]
    inputs = [blocks for part in parts for blocks in part.blocks(settings.reference)]
    if len(cuts) > 1 and not (settings.steps or settings.frequency):
        check_levels(cuts, inputs, settings.reference, parts[0].path.name)
        cuts = cuts if settings.lines or settings.every else common_lines(cuts)
    segments = [cut.plain() for cut in cuts]
    first = parts[0]
    record: Plain = {
        "hash": file_hash(first.path),
        "reader": first.reader,
        "sample_rate": first.rate,
        "channels": first.channels,
        "segments": segments,
    }
    if len(parts) > 1:
        del record["hash"], record["channels"]
        record["parts"] = [{"hash": file_hash(part.path), "channels": part.channels} for part in parts]
        owners = [number for number, part in enumerate(parts) for _ in part.cuts]
        record["segments"] = [{**plain, "part": number} for plain, number in zip(segments, owners, strict=True)]
    paths = [str(part.path) for part in parts]
    more = {f"record.{number}": path for number, path in enumerate(paths[1:], start=1)}
    return {"source": "record", "record": record}, {"record": paths[0], **more}


def load(experiment: Mapping[str, Any], files: Mapping[str, str], registry: Registry) -> Signals:
    """Return the signals of a resolved record; RecordError if its file is gone or has changed since."""
    record = experiment["record"]
    parts: Sequence[Plain] = record.get("parts", [record])
    reader = create(registry, RecordReader, record["reader"], place="record")  # type: ignore[type-abstract]
    found: list[Segment] = []
    for number, part in enumerate(parts):
        path = _unchanged(files[f"record.{number}" if number else "record"], part["hash"])
        table = _read(reader, path, set().union(*map(columns_of, part["channels"].values())))
        values = {name: values_of(table, channel, name, path) for name, channel in part["channels"].items()}
        own = [plain for plain in record["segments"] if plain.get("part", 0) == number]
        found += [_segment(Cut.of(plain), values, part["channels"], path) for plain in own]
    units = {name: str(channel["unit"]) for name, channel in parts[0]["channels"].items()}
    return Signals(tuple(found), units, message=doubts([Cut.of(plain) for plain in record["segments"]]))


def _segment(cut: Cut, values: Mapping[str, np.ndarray], channels: Mapping[str, Plain], path: Path) -> Segment:
    blocks = {
        name: integrated(cut.blocks_of(samples), cut, channels[name].get("integrate", 0), f"{path.name}, '{name}'")
        for name, samples in values.items()
    }
    settling = None if cut.periodic else AS_FROM_REST
    return Segment(cut.sample_time, blocks, np.array(cut.lines), settling, periodic=cut.periodic)


def _unchanged(file: str, content: str) -> Path:
    path = existing(Path(file))
    if file_hash(path) != content:
        raise RecordError(f"{path.name}: the file has changed since the study was read; run the study again")
    return path


def _part(settings: RecordSettings, file: Path, registry: Registry) -> _Part:
    path = existing(file)  # the folder itself may be yet to come
    reader = reader_of(settings.reader, path, registry)
    extra = _auxiliary(settings)
    wanted = {column for channel in (*settings.channels.values(), *extra.values()) for column in channel.columns}
    chosen = condition(settings.where, path.name)
    table = _read(reader, path, wanted | ({chosen[0]} if chosen else set()))
    plain = {name: in_si(name, channel, table, path) for name, channel in settings.channels.items()}
    values = {name: values_of(table, channel, name, path) for name, channel in plain.items()}
    rate = _rate(settings, reader, table, path)
    cuts = _cuts(settings, values, table, rate, path)
    for name, channel in plain.items():
        if channel.get("integrate", 0) and not cuts[0].periodic:  # what cannot be done is said before it is asked for
            integrated(np.zeros((1, 2)), cuts[0], channel["integrate"], f"{path.name}, '{name}'")
    return _Part(path, reader.spec(), plain, values, rate, cuts)


def _check_alike(parts: Sequence[_Part]) -> None:
    """Raise RecordError unless all parts can be parts of one experiment."""
    first = parts[0]
    for part in parts[1:]:
        place = f"{first.path.name} and {part.path.name}"
        ours, theirs = ({name: of["unit"] for name, of in one.channels.items()} for one in (first, part))
        if ours != theirs:
            name = next(name for name in ours if ours[name] != theirs[name])
            raise RecordError(
                f"{place}: channel '{name}' is in {ours[name]} in one and in {theirs[name]} in the other; "
                "expected records of one experiment"
            )
        if first.reader != part.reader:
            raise RecordError(f"{place}: they are files of different formats; give those of one format at a time")
        if abs(part.rate / first.rate - 1) > JITTER:
            raise RecordError(
                f"{place}: sample rates of {first.rate:g} and {part.rate:g} Hz; expected records of one experiment"
            )


def existing(path: Path) -> Path:
    """Return the full path of a file; RecordError names the nearest one if there is none."""
    try:
        if path.is_file():
            return path.resolve()
        if not path.parent.is_dir():
            raise RecordError(f"{path}: there is no folder '{path.parent}'; correct record.file")
    except OSError as error:  # such as a name that is too long
        raise RecordError(f"record.file: {error.strerror}; expected the name of a file") from None
    others = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix]
    raise RecordError(f"{path}: there is no such file{did_you_mean(path.name, others)}")


def reader_of(name: str, path: Path, registry: Registry) -> RecordReader:
    """Return the reader of this name, or if it is empty the one that reads files with this ending."""
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
    found = {"time": settings.time, "frequency": settings.frequency, "segment": settings.segment}
    return {f" {name}": channel for name, channel in found.items() if channel is not None}


def _read(reader: RecordReader, path: Path, columns: set[str]) -> RecordTable:
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


def _rate(settings: RecordSettings, reader: RecordReader, table: RecordTable, path: Path) -> float:
    clock = 1 / table.sample_time if table.sample_time else None
    if settings.time is not None:
        time = auxiliary_values("time", settings.time, table, "s", path)
        clock = rate_of(time, f"{path.name}: the time in column '{settings.time.column}'")
    elif clock is None:
        clock = evident_clock(reader, table, path, even=settings.sample_rate is None)
    if settings.sample_rate and clock is None and not table.units:  # such as in MATLAB files
        check_numbers(settings.sample_rate, reader, path)
    if clock is None and settings.sample_rate is None:
        raise unknown_rate(reader, table, path)
    return agreed_rate(settings.sample_rate, clock, path.name)


def _cuts(
    settings: RecordSettings, values: dict[str, np.ndarray], table: RecordTable, rate: float, path: Path
) -> list[Cut]:
    name = settings.reference
    if name not in values:
        raise RecordError(f"{path.name}: input is '{name}', which is no channel{did_you_mean(name, values)}")
    channel = values[name]
    ways = [key for key in ("period", "period_time", "steps", "frequency") if getattr(settings, key)]
    runs = runs_in(settings, table, channel.size, path.name)
    if not settings.periodic:
        if ways:
            raise RecordError(f"{path.name}: periodic = false and {ways[0]} are both given; expected one of them")
        return [whole_cut(settings, rate, run, place) for place, run in runs]
    if len(ways) != 1:
        raise _undecided(ways, channel[slice(*runs[0][1])], rate, path.name)
    if ways[0] in ("period", "period_time"):
        return [
            _periodic(settings, values, rate, name, place, run)
            for place, whole in runs
            for run in realisations_of(settings, rate, whole, place)
        ]
    if settings.where or settings.segment:
        raise RecordError(f"{path.name}: {ways[0]} tells the segments already; leave out where and segment")
    steps = list(settings.steps)
    if settings.frequency is not None:
        steps = steps_of(auxiliary_values("frequency", settings.frequency, table, "Hz", path), rate)
    if not steps:
        raise RecordError(f"{path.name}: the frequency is nowhere above 0; expected one for each step")
    cuts = step_cuts(settings, steps, rate, channel.size, path.name)
    check_steps(cuts, channel, rate, name, path.name)
    return cuts


def _periodic(
    settings: RecordSettings, values: Mapping[str, np.ndarray], rate: float, name: str, place: str, run: tuple[int, int]
) -> Cut:
    cut = periodic_cut(settings, rate, run, place)
    check_repeats(cut, values[name][: run[1]], rate, name, place)
    return with_lines(settings, cut, values, place)


def _undecided(ways: list[str], channel: np.ndarray, rate: float, place: str) -> RecordError:
    if ways:
        return RecordError(f"{place}: {' and '.join(ways)} are both given; expected one of them")
    found = detected_period(channel)
    seems = f": {seems_to_repeat(found, rate)}" if found else ", as period = N (--period N)"
    return RecordError(
        f"{place}: give period (samples) or period_time (s) of a periodic record{seems}; "
        "steps or frequency of a stepped sine; or periodic = false (--not-periodic) if it does not repeat itself"
    )
