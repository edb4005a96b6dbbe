"""Measured records as a source of signals: resolved to plain data that identifies them, and loaded."""

import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.quantisation import moves_visibly
from fraexp.components.kinds import Controller, RecordReader
from fraexp.components.registry import Registry, create
from fraexp.data.findings import Finding, remarks
from fraexp.data.identity import file_hash
from fraexp.data.results import Outcome
from fraexp.data.signals import RecordTable, Segment, Signals
from fraexp.data.sweep import Plain
from fraexp.errors import RecordError, did_you_mean
from fraexp.records.channels import PlainTable, auxiliary_values, channel_columns, channel_values, resolve_channel
from fraexp.records.cutting import (
    Cut,
    find_steps,
    integrate_blocks,
    parse_condition,
    periodic_cut,
    played_cuts,
    select_runs,
    split_realisations,
    stated_period,
    step_cuts,
    whole_cut,
)
from fraexp.records.record_doubts import column_doubts, find_wrong_samples, implausible_units
from fraexp.records.record_files import existing_file, find_reader, joined_reader, read_columns
from fraexp.records.record_settings import RecordSettings, check_keys
from fraexp.records.repeats import (
    check_levels,
    check_repeats,
    check_step_frequencies,
    common_lines,
    find_doubtful_lines,
    missing_period_error,
    select_lines,
    split_levels,
)
from fraexp.records.resampling import plan_sampling, sampled_table, sampling_columns, sampling_text
from fraexp.records.stated_response import is_response, load_response, resolve_response, response_columns
from fraexp.records.timebase import MAX_JITTER

POSITION_UNITS = ("m", "rad")
"""Units of positions, as records have them."""


@dataclass(frozen=True)
class _RecordPart:
    """A file, or a realisation in it, with the cuts of its segments."""

    paths: tuple[Path, ...]
    """The file, or those whose columns are joined."""
    reader: PlainTable
    channels: dict[str, PlainTable]
    values: dict[str, NDArray[np.float64]]
    rate: float
    sampling: PlainTable
    """Which samples are used, and how they are resampled; empty if as they are."""
    cuts: list[Cut]

    def as_plain(self) -> PlainTable:
        """Return the plain data that identifies its signals."""
        sampling = {"sampling": self.sampling} if self.sampling else {}
        joined = {"joined": [file_hash(path) for path in self.paths[1:]]} if len(self.paths) > 1 else {}
        return {"hash": file_hash(self.path), **joined, "channels": self.channels, **sampling}

    def levels(self) -> list["_RecordPart"]:
        """Return the part once for each of its cuts, which are the levels of one run: as if each had its own file."""
        return [replace(self, cuts=[cut]) for cut in self.cuts]

    @property
    def path(self) -> Path:
        """The first file, which messages name."""
        return self.paths[0]

    def blocks(self, name: str) -> list[NDArray[np.float64]]:
        """Return the blocks of a channel in each segment, each of shape (blocks, samples)."""
        return [cut.blocks_of(self.values[name]) for cut in self.cuts]


def resolve(settings: RecordSettings, base_folder: Path, registry: Registry) -> tuple[PlainTable, dict[str, str]]:
    """Return the experiment that the settings describe as plain data, and the paths of its files.

    The experiment contains the hash of the file, the sample rate [Hz], the column of each channel with its factor to
    the SI unit, and the cuts with their excited harmonics: the same signals have the same key, however a study
    describes them. All faults of a record are found here, as RecordError or ParameterError in one line.
    """
    of_response = is_response(settings.channels)
    check_keys(settings, of_response)
    if of_response:
        return _resolve_response(settings, base_folder, registry)
    found = (_resolve_part(one, base_folder, files, registry) for files, one in settings.parts())
    is_split = bool(settings.samples_per_period or settings.period_time) and not settings.has_stated_runs
    parts = [level for part in found for level in (part.levels() if is_split else [part])]
    _check_alike(parts)
    cuts = [cut for part in parts for cut in part.cuts]
    if len(cuts) > 1 and not (settings.steps or settings.frequency_column or settings.segments):
        for part in parts:  # each of which may have an amplitude of its own
            check_levels(part.cuts, part.blocks(settings.reference), settings.reference, part.path.name)
        cuts = cuts if settings.harmonics else common_lines(cuts)
    segments = [cut.as_plain() for cut in cuts]
    first = parts[0]
    record: PlainTable = {"reader": first.reader, "sample_rate": first.rate, "segments": segments}
    if settings.controller is not None:
        controller = create(registry, Controller, settings.controller, place="record.controller")
        record["controller"] = [part.tolist() for part in controller.transfer_function(1 / first.rate)]
    if len(parts) == 1:
        record |= first.as_plain()
    else:
        record["parts"] = [part.as_plain() for part in parts]
        owners = [number for number, part in enumerate(parts) for _ in part.cuts]
        record["segments"] = [{**plain, "part": number} for plain, number in zip(segments, owners, strict=True)]
    paths = [str(path) for part in parts for path in part.paths]
    more = {f"record.{number}": path for number, path in enumerate(paths[1:], start=1)}
    return {"source": "record", "record": record}, {"record": paths[0], **more}


def _resolve_response(
    settings: RecordSettings, base_folder: Path, registry: Registry
) -> tuple[PlainTable, dict[str, str]]:
    """Return the experiment that stands for a response that was measured elsewhere, and the path of its file."""
    named = list(settings.parts())
    if len(named) > 1:
        raise RecordError(
            f"{named[0][0][0]} and others: expected one file with one response; compare several in a grid"
        )
    (file, *_), own = named[0]
    path = existing_file(Path(os.path.normpath(base_folder / file)))
    reader = find_reader(own.reader, path, registry)
    table = read_columns(reader, path, response_columns(own))
    record = {"hash": file_hash(path), "reader": reader.spec(), **resolve_response(own, table, path)}
    return {"source": "record", "record": record}, {"record": str(path)}


def load(experiment: Plain, files: Mapping[str, str], registry: Registry) -> Signals:
    """Return the signals of a resolved record; RecordError if its file is missing or has changed."""
    record = experiment["record"]
    parts: Sequence[PlainTable] = record.get("parts", [record])
    reader = create(registry, RecordReader, record["reader"], place="record")
    remaining = (f"record.{number}" if number else "record" for number in itertools.count())
    if "response" in record:
        path = _unchanged_file(files["record"], record["hash"])
        columns = {str(column["column"]) for column in record["response"]["columns"].values()}
        return load_response(record, read_columns(reader, path, columns), path)
    found: list[Segment] = []
    cuts = [Cut.from_plain(plain) for plain in record["segments"]]
    messages: list[Finding | str | None] = [find_doubtful_lines(cuts)]
    highest = max(max(plain["lines"]) / (plain["samples"] * plain["sample_time"]) for plain in record["segments"])
    for number, part in enumerate(parts):
        hashes = (part["hash"], *part.get("joined", ()))
        paths = [_unchanged_file(files[next(remaining)], content) for content in hashes]
        path, source = paths[0], joined_reader(paths, reader, registry)
        sampling = part.get("sampling", {})
        columns = set().union(*map(channel_columns, part["channels"].values())) | sampling_columns(sampling)
        raw = read_columns(source, path, columns)
        messages += [] if number else [sampling_text(raw, sampling, highest, path)]
        values = _values_of(sampled_table(raw, sampling, path), part["channels"], path)
        own = [plain for plain in record["segments"] if plain.get("part", 0) == number]
        found += [_load_segment(Cut.from_plain(plain), values, part["channels"], path) for plain in own]
    units = {name: str(channel["unit"]) for name, channel in parts[0]["channels"].items()}
    wrong = find_wrong_samples(found, units)
    unexpected = column_doubts(found, cuts, units, record.get("controller"))
    are_doubtful = any(not each.error for each in unexpected) or any(2 * cut.doubtful > len(cut.lines) for cut in cuts)
    still, moving = _standstill(found, units), _unsettled(cuts)
    causes = {Outcome.NO_MOTION: still, Outcome.NOT_SETTLED: moving, Outcome.INACCURATE: are_doubtful}
    outcome = next((of for of, cause in causes.items() if cause), Outcome.OK)
    findings = remarks(still, moving, *unexpected, *messages, *implausible_units(found, units), *wrong)
    return Signals(tuple(found), units, outcome, findings)


def _unsettled(cuts: Sequence[Cut]) -> Finding | None:
    count, remedy = sum(cut.settled is False for cut in cuts), "ignore the marked points, or measure for longer"
    return Finding("not periodic", place=f"{count} of {len(cuts)} segments", remedy=remedy) if count else None


def _standstill(segments: Sequence[Segment], units: Mapping[str, str]) -> Finding | None:
    """Return that no position moves at the excited frequencies; None if one does, or if there is none."""
    positions = [name for name, unit in units.items() if unit in POSITION_UNITS]
    if not positions or not all(segment.periodic for segment in segments):
        return None
    if any(moves_visibly(segments, name) for name in positions):
        return None
    text = "the axis does not move: nothing but noise at the excited frequencies"
    return Finding("no motion", place=" and ".join(positions), text=text)


def _load_segment(
    cut: Cut, values: Mapping[str, NDArray[np.float64]], channels: Mapping[str, PlainTable], path: Path
) -> Segment:
    blocks = {
        name: integrate_blocks(
            cut.blocks_of(samples), cut, channels[name].get("integrate", 0), f"{path.name}, '{name}'"
        )
        for name, samples in values.items()
    }
    lead_in = {}
    if cut.rest is not None:
        plain = {name: samples for name, samples in values.items() if not channels[name].get("integrate", 0)}
        lead_in = {name: samples[cut.rest : cut.start].copy() for name, samples in plain.items()}
    return Segment(cut.sample_time, blocks, np.array(cut.lines), cut.settling, lead_in, cut.periodic)


def _unchanged_file(file: str, content: str) -> Path:
    path = existing_file(Path(file))
    if file_hash(path) != content:
        raise RecordError(f"{path.name}: the file has changed since the study was read; run the study again")
    return path


def _resolve_part(settings: RecordSettings, base_folder: Path, files: Sequence[str], registry: Registry) -> _RecordPart:
    paths = tuple(existing_file(Path(os.path.normpath(base_folder / file))) for file in files)
    path, own = paths[0], find_reader(settings.reader, paths[0], registry)
    reader = joined_reader(paths, own, registry)
    held = {column for channel in settings.auxiliary_columns for column in channel.columns}
    if chosen := parse_condition(settings.select, path.name):
        held.add(chosen[0])
    wanted = held.union(*(channel.columns for channel in settings.channels.values()))
    table = read_columns(reader, path, wanted)
    plain = {name: resolve_channel(name, channel, table, path) for name, channel in settings.channels.items()}
    rate, sampling = plan_sampling(settings, reader, table, path)
    if not sampling_columns(sampling) <= table.columns.keys():  # a time that the study does not name
        table = read_columns(reader, path, set(table.columns) | sampling_columns(sampling))
    table = sampled_table(table, sampling, path, held)
    values = _values_of(table, plain, path)
    cuts = _plan_cuts(settings, values, table, rate, path)
    for name, channel in plain.items() if not cuts[0].periodic else ():
        times = channel.get("integrate", 0)  # an impossible integral is reported before it is computed
        integrate_blocks(np.zeros((1, 2)), cuts[0], times, f"{path.name}, '{name}'")
    return _RecordPart(paths, own.spec(), plain, values, rate, sampling, cuts)


def _values_of(table: RecordTable, channels: Mapping[str, PlainTable], path: Path) -> dict[str, NDArray[np.float64]]:
    return {name: channel_values(table, channel, name, path) for name, channel in channels.items()}


def _check_alike(parts: Sequence[_RecordPart]) -> None:
    """Raise RecordError if the parts cannot belong to one experiment."""
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
        if abs(part.rate / first.rate - 1) > MAX_JITTER:
            raise RecordError(
                f"{place}: sample rates of {first.rate:g} and {part.rate:g} Hz; expected records of one experiment"
            )


def _plan_cuts(
    settings: RecordSettings, values: dict[str, NDArray[np.float64]], table: RecordTable, rate: float, path: Path
) -> list[Cut]:
    name = settings.reference
    if name not in values:
        raise RecordError(f"{path.name}: line_channel is '{name}', which is not a channel{did_you_mean(name, values)}")
    channel = values[name]
    keys = ("samples_per_period", "period_time", "steps", "frequency_column", "segments")
    ways = [key for key in keys if getattr(settings, key)]
    runs = select_runs(settings, table, channel.size, path.name)
    if not settings.periodic:
        if ways:
            raise RecordError(f"{path.name}: periodic = false and {ways[0]} are both given; expected one of them")
        return [whole_cut(settings, rate, run, place) for place, run in runs]
    if len(ways) != 1:
        raise missing_period_error(ways, channel[slice(*runs[0][1])], rate, path.name)
    if ways[0] in ("samples_per_period", "period_time"):
        cuts = []
        for place, whole in runs:
            parts = split_realisations(settings, rate, whole, place)
            for run in (
                parts if settings.has_stated_runs else split_levels(whole, channel, stated_period(settings, rate))
            ):
                cut = periodic_cut(settings, rate, run, place)
                check_repeats(cut, channel[: run[1]], rate, name, place)
                cuts.append(select_lines(settings, cut, values, place))
        return cuts
    if settings.select or settings.segment_column:
        raise RecordError(f"{path.name}: {ways[0]} already defines the segments; leave out select and segment_column")
    if settings.segments:
        cuts = played_cuts(settings, rate, channel.size, path.name)
        check_step_frequencies([cut for cut in cuts if len(cut.lines) == 1], channel, rate, name, path.name)
        return cuts
    steps = list(settings.steps)
    if settings.frequency_column is not None:
        steps = find_steps(auxiliary_values("frequency", settings.frequency_column, table, "Hz", path), rate)
    if not steps:
        raise RecordError(f"{path.name}: the frequency is nowhere above 0; expected one for each step")
    cuts = step_cuts(settings, steps, rate, channel.size, path.name)
    check_step_frequencies(cuts, channel, rate, name, path.name)
    return cuts
