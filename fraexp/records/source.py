"""Measured records as a source of signals: resolved to plain data that identifies them, and loaded."""

import itertools
import math
import os
from collections import Counter
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
from fraexp.data.record_table import RecordTable
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.data.sweep import Plain
from fraexp.errors import ParameterError, RecordError, did_you_mean
from fraexp.records.channels import Channel
from fraexp.records.clocks import ColumnReader
from fraexp.records.column_doubts import column_doubts, implausible_units
from fraexp.records.cutting import (
    Cut,
    find_steps,
    periodic_cut,
    played_cuts,
    split_realisations,
    step_cuts,
    whole_cut,
)
from fraexp.records.excited import (
    NEGLIGIBLE_RATIO,
    ROUNDING_RATIO,
    SIGNIFICANCE_RATIO,
    ExcitedLines,
    find_doubtful_lines,
    find_excited_lines,
    find_injected_lines,
    line_power,
    line_spectrum,
)
from fraexp.records.joined_files import JoinedFiles
from fraexp.records.quantities import PlainTable, auxiliary_values, channel_columns, channel_values, resolve_channel
from fraexp.records.record_sampling import (
    check_levels,
    parse_condition,
    plan_sampling,
    sampled_table,
    sampling_columns,
    sampling_text,
    select_runs,
)
from fraexp.records.record_settings import RecordSettings
from fraexp.records.repeats import check_repeats, detect_period, period_hint
from fraexp.records.stated_response import is_response, load_response, resolve_response, response_columns
from fraexp.records.timebase import MAX_JITTER
from fraexp.records.wrong_samples import find_wrong_samples

MIN_FREQUENCY_RATIO = 0.5
"""Frequency relative to the lowest line below which an integral is set to 0: there it is drift and noise."""


def integrate_blocks(blocks: NDArray[np.float64], cut: Cut, times: int, place: str) -> NDArray[np.float64]:
    """Return blocks of a channel, shape (blocks, samples), integrated `times` times; if below 0, differentiated.

    A periodic record is divided by (jω)ⁿ at all its frequencies at once, which is exact at its lines; its mean and
    what lies below half the lowest line cannot be integrated and become 0. A record that does not repeat itself is
    differentiated by central differences, too small by (ωTs)²/6, and cannot be integrated: it would drift.
    """
    if not times:
        return blocks
    if not cut.periodic and times > 0:
        raise RecordError(
            f"{place}: a record that does not repeat itself cannot be integrated, its offset would grow without end; "
            "give a measured position, or cut whole periods"
        )
    record = blocks.ravel()
    if not cut.periodic:
        for _ in range(-times):
            record = np.gradient(record, cut.sample_time)
        return record.reshape(blocks.shape)
    omega = 2 * np.pi * np.fft.rfftfreq(record.size, cut.sample_time)
    lowest = 2 * np.pi * cut.lines[0] / (cut.samples * cut.sample_time)
    kept = omega > (MIN_FREQUENCY_RATIO * lowest if times > 0 else 0.0)
    kept[-1] &= record.size % 2 == 1  # at the Nyquist frequency a derivative has no phase
    factor = np.zeros(omega.size, dtype=complex)
    factor[kept] = (1j * omega[kept]) ** -times
    return np.fft.irfft(factor * np.fft.rfft(record), record.size).reshape(blocks.shape)


RESPONSE_KEYS = ("response_unit", "input_amplitude", "averages")
"""Keys of a response that was measured elsewhere."""
COMMON_KEYS = ("file", "join_files", "reader", "channels", "level", "realisations")
LINE_KEYS = ("harmonics", "harmonic_step", "min_frequency", "max_frequency")
UNUSED_KEYS = {
    "steps": ("periods_per_realisation", *LINE_KEYS),
    "frequency_column": ("periods_per_realisation", *LINE_KEYS),
    "segments": ("periods_per_realisation", "skip_periods", "skip_time", "max_phase_slip", *LINE_KEYS),
}
"""What the key that states the frequencies of a record leaves no use for."""


def check_response_keys(settings: RecordSettings) -> None:
    """Raise ParameterError if a response has a key of samples over time."""
    used = (*COMMON_KEYS, *RESPONSE_KEYS)
    given = [key for key in type(settings).model_fields if key not in used and _is_given(settings, key)]
    if given:
        raise ParameterError(
            f"{given[0]} describes samples over time, and channel 'frequency' makes this record a response; leave "
            f"{given[0]} out, or the channel"
        )


def check_sample_keys(settings: RecordSettings) -> None:
    """Raise ParameterError if a record over time has a key of a response, or one that another key makes useless."""
    for key in RESPONSE_KEYS:
        if _is_given(settings, key):
            raise ParameterError(
                f"{key} describes a response; expected channels frequency with magnitude and phase, or with real and "
                f"imaginary: leave {key} out of a record over time"
            )
    if settings.controller is not None and not settings.segments:
        raise ParameterError(
            "controller is compared with what was played, which segments state; leave controller out of a record "
            "without segments"
        )
    for way, unused in UNUSED_KEYS.items():
        given = [key for key in unused if getattr(settings, way) and _is_given(settings, key)]
        if given:
            raise ParameterError(f"{way} states the periods of the record and their frequencies; leave {given[0]} out")


def _is_given(settings: RecordSettings, key: str) -> bool:
    return bool(getattr(settings, key) != type(settings).model_fields[key].default)


MAX_LINE_DIFFERENCE = 0.2
"""Share of lines in which realisations of one multisine may differ by noise."""
MIN_POWER_SHARE = 0.5
"""Share of the input's power at the lines of the reference below which something else excites the machine."""


def select_lines(settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], place: str) -> Cut:
    """Return the cut with its excited harmonics: those stated, otherwise those that are found in the injected signal.

    `harmonics`, or `harmonic_step` from `min_frequency` to `max_frequency`, state them; RecordError if nothing is
    injected there. Without a channel for the injected signal they are found in the input, where they must be stronger
    than the lines of friction.
    """
    _check_statement(settings, cut, place)
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.min_frequency or 0.0) / base - 1e-6), 1)
    highest = math.floor(settings.max_frequency / base + 1e-6) if settings.max_frequency else last // cut.periods
    stated = sorted(
        set(
            settings.harmonics or (range(lowest, highest + 1, settings.harmonic_step) if settings.harmonic_step else ())
        )
    )
    lines = [line * cut.periods for line in stated]
    band = (lowest * cut.periods, highest * cut.periods)
    found = ExcitedLines(lines) if stated else _find_lines(settings, cut, values, band, place)
    lines = list(found.lines)
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0] // cut.periods} to {lines[-1] // cut.periods}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct min_frequency and max_frequency, or harmonics"
        )
    if stated:
        blocks = cut.blocks_of(values[settings.injected])
        _check_excited(lines, blocks, base / cut.periods, cut.periods, f"{place}: '{settings.injected}'")
    return replace(cut, lines=tuple(lines), left_out=found.left_out, doubtful=found.doubtful)


def _find_lines(
    settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], band: tuple[int, int], place: str
) -> ExcitedLines:
    """Return the excited lines within a frequency range, with the doubtful ones."""
    name, blocks = settings.injected, cut.blocks_of(values[settings.injected])
    if name == settings.reference:
        found = find_excited_lines(blocks, band, stated=bool(settings.min_frequency and settings.max_frequency))
    else:
        found = find_injected_lines(blocks, band)
        if name == "reference":
            _check_share(found.anywhere, cut.blocks_of(values[settings.reference]), settings.reference, place)
    if found.anywhere and not found.lines:
        spacing = 1 / (cut.samples * cut.sample_time)
        low, high = (line * spacing for line in (found.anywhere[0], found.anywhere[-1]))
        raise RecordError(
            f"{place}: none of the excited lines, {low:.4g} to {high:.4g} Hz, is between min_frequency and "
            "max_frequency; correct both, or give harmonics"
        )
    return found


def _check_share(lines: Sequence[int], blocks: NDArray[np.float64], name: str, place: str) -> None:
    """Raise RecordError if the input has most of its power at other lines than those of the reference."""
    power = line_power(blocks)
    share = float(power[np.array(lines, dtype=int) - 1].sum() / power.sum()) if power.any() else 1.0
    if share < MIN_POWER_SHARE:
        raise RecordError(
            f"{place}: '{name}' has {share:.0%} of its power at the {len(lines)} lines of 'reference': something else "
            f"excites the machine; give that as channel 'excitation', or line_channel = '{name}' (--input {name}) to "
            "look for lines there"
        )


def common_lines(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts whose lines are those that most of them have, where noise alone makes them differ.

    Realisations are recognised by equal lines. If more than a few differ, as with random grids, all cuts are kept.
    """
    found = list(cuts)
    for shape in {(cut.samples, cut.sample_time) for cut in cuts}:
        places = [place for place, cut in enumerate(cuts) if (cut.samples, cut.sample_time) == shape]
        counts = Counter(line for place in places for line in cuts[place].lines)
        most = {line for line, count in counts.items() if count > len(places) / 2}
        if all(
            len(most.symmetric_difference(cuts[place].lines)) <= MAX_LINE_DIFFERENCE * len(most) for place in places
        ):
            for place in places:
                found[place] = replace(cuts[place], lines=tuple(sorted(most)))
    return found


def _check_statement(settings: RecordSettings, cut: Cut, place: str) -> None:
    if settings.harmonics and (settings.harmonic_step or settings.min_frequency or settings.max_frequency):
        raise RecordError(f"{place}: expected either harmonics, or min_frequency, max_frequency and harmonic_step")
    if settings.harmonic_step and not (settings.min_frequency and settings.max_frequency):
        raise RecordError(
            f"{place}: harmonic_step is given without min_frequency and max_frequency; give both, or harmonics"
        )
    if settings.max_frequency and settings.max_frequency > 0.5 / cut.sample_time:
        raise RecordError(
            f"{place}: max_frequency is {settings.max_frequency:.4g} Hz; expected at most half the sample rate, "
            f"{0.5 / cut.sample_time:.4g} Hz"
        )
    if settings.min_frequency and settings.max_frequency and settings.min_frequency > settings.max_frequency:
        raise RecordError(
            f"{place}: min_frequency is {settings.min_frequency:g} Hz and max_frequency {settings.max_frequency:g} Hz; "
            "expected the first below"
        )


def _check_excited(lines: list[int], blocks: NDArray[np.float64], spacing: float, periods: int, place: str) -> None:
    """Raise RecordError if a stated line is lost in noise; `spacing` is that of the block's lines [Hz]."""
    amplitude, scatter = line_spectrum(blocks)
    stated = np.array(lines) - 1
    others = np.delete(amplitude, stated)
    floor = np.maximum(scatter, np.median(others**2) if others.size else 0.0)[stated]
    share = amplitude[stated] / amplitude.max() if amplitude.any() else amplitude[stated]
    lost = (share < NEGLIGIBLE_RATIO) & (amplitude[stated] ** 2 <= SIGNIFICANCE_RATIO * floor) | (
        share < ROUNDING_RATIO
    )
    if lost.any():
        first = int(np.argmax(lost))
        more = f", nor at {int(lost.sum()) - 1} more of the {len(lines)} stated lines" if lost.sum() > 1 else ""
        raise RecordError(
            f"{place} does not excite {lines[first] * spacing:.6g} Hz (harmonic "
            f"{lines[first] // periods}), with {share[first]:.1e} of the strongest line{more}; "
            "correct harmonics, or leave out harmonic_step"
        )


def check_step_frequencies(
    cuts: Sequence[Cut], channel: NDArray[np.float64], rate: float, name: str, place: str
) -> None:
    """Raise RecordError if in most steps the input is strongest at another frequency than the stated one."""
    wrong = []
    for cut in cuts:
        samples = cut.blocks_of(channel).ravel()  # not the mean block, in which half of the stated frequency cancels
        spectrum = np.abs(np.fft.rfft(samples - np.linspace(samples[0], samples[-1], samples.size)))
        strongest = int(np.argmax(spectrum[1:])) + 1
        if spectrum[strongest] > 2 * spectrum[cut.lines[0] * cut.blocks]:
            wrong.append((cut, strongest / cut.blocks))
    if len(wrong) > len(cuts) / 2:
        cut, strongest_line = wrong[0]
        stated, found = (line * rate / cut.samples for line in (cut.lines[0], strongest_line))
        raise RecordError(
            f"{place}: '{name}' is strongest at {found:.4g} Hz where {stated:.4g} Hz is stated, and so in "
            f"{len(wrong)} of {len(cuts)} steps; check sample_rate and the steps"
        )


POSITION_UNITS = ("m", "rad")
"""Units of positions, as records have them."""
MAX_VALUE = 1e100
"""Magnitude of a sample from which a file is damaged: its square could not be computed."""


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
    if is_response(settings.channels):
        check_response_keys(settings)
        return _resolve_response(settings, base_folder, registry)
    check_sample_keys(settings)
    parts = [_resolve_part(one, base_folder, files, registry) for files, one in settings.parts()]
    _check_alike(parts)
    cuts = [cut for part in parts for cut in part.cuts]
    inputs = [blocks for part in parts for blocks in part.blocks(settings.reference)]
    if len(cuts) > 1 and not (settings.steps or settings.frequency_column or settings.segments):
        check_levels(cuts, inputs, settings.reference, parts[0].path.name)
        cuts = cuts if settings.harmonics or settings.harmonic_step else common_lines(cuts)
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
        path, source = paths[0], _joined_reader(paths, reader, registry)
        sampling = part.get("sampling", {})
        columns = set().union(*map(channel_columns, part["channels"].values())) | sampling_columns(sampling)
        raw = read_columns(source, path, columns)
        messages += [] if number else [sampling_text(raw, sampling, highest, path)]
        table = sampled_table(raw, sampling, path)
        values = {name: channel_values(table, channel, name, path) for name, channel in part["channels"].items()}
        own = [plain for plain in record["segments"] if plain.get("part", 0) == number]
        found += [_load_segment(Cut.from_plain(plain), values, part["channels"], path) for plain in own]
    units = {name: str(channel["unit"]) for name, channel in parts[0]["channels"].items()}
    wrong, do_harm = find_wrong_samples(found, units)
    unexpected = column_doubts(found, cuts, units, record.get("controller"))
    are_doubtful = bool(unexpected) or any(2 * cut.doubtful > len(cut.lines) for cut in cuts)
    unsettled = sum(cut.settled is False for cut in cuts)
    moving = (
        Finding(
            "not periodic",
            place=f"{unsettled} of {len(cuts)} segments",
            remedy="ignore the marked points, or measure for longer",
        )
        if unsettled
        else None
    )
    outcome = Outcome.INACCURATE if do_harm or are_doubtful else Outcome.OK
    outcome = Outcome.NOT_SETTLED if unsettled else outcome
    still = _standstill(found, units)
    outcome = Outcome.NO_MOTION if still else outcome
    findings = remarks(still, moving, *unexpected, *messages, *implausible_units(found, units), *wrong)
    return Signals(tuple(found), units, outcome, findings)


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


def _joined_reader(paths: Sequence[Path], first: RecordReader, registry: Registry) -> ColumnReader:
    """Return the reader of a file, or one for all files that are joined."""
    if len(paths) == 1:
        return first
    return JoinedFiles(paths, [first, *(find_reader("", path, registry) for path in paths[1:])])


def _resolve_part(settings: RecordSettings, base_folder: Path, files: Sequence[str], registry: Registry) -> _RecordPart:
    paths = tuple(existing_file(Path(os.path.normpath(base_folder / file))) for file in files)
    path, own = paths[0], find_reader(settings.reader, paths[0], registry)
    reader = _joined_reader(paths, own, registry)
    extra = _auxiliary_channels(settings)
    wanted = {column for channel in (*settings.channels.values(), *extra.values()) for column in channel.columns}
    chosen = parse_condition(settings.select, path.name)
    table = read_columns(reader, path, wanted | ({chosen[0]} if chosen else set()))
    plain = {name: resolve_channel(name, channel, table, path) for name, channel in settings.channels.items()}
    rate, sampling = plan_sampling(settings, reader, table, path)
    if not sampling_columns(sampling) <= table.columns.keys():  # a time that the study does not name
        table = read_columns(reader, path, set(table.columns) | sampling_columns(sampling))
    held = {column for channel in extra.values() for column in channel.columns} | ({chosen[0]} if chosen else set())
    table = sampled_table(table, sampling, path, held)
    values = {name: channel_values(table, channel, name, path) for name, channel in plain.items()}
    cuts = _plan_cuts(settings, values, table, rate, path)
    for name, channel in plain.items():
        if (
            channel.get("integrate", 0) and not cuts[0].periodic
        ):  # an impossible integral is reported before it is computed
            integrate_blocks(np.zeros((1, 2)), cuts[0], channel["integrate"], f"{path.name}, '{name}'")
    return _RecordPart(paths, own.spec(), plain, values, rate, sampling, cuts)


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


def existing_file(path: Path) -> Path:
    """Return the full path of a file; if it is missing, RecordError names the most similar one."""
    try:
        if path.is_file():
            return path.resolve()
        if path.is_dir():
            raise RecordError(f"{path}: is a folder; expected a file")
        if not path.parent.is_dir():
            raise RecordError(f"{path}: there is no folder '{path.parent}'; correct record.file")
    except OSError as error:  # such as a name that is too long
        raise RecordError(f"record.file: {error.strerror}; expected the name of a file") from None
    others = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix]
    raise RecordError(f"{path}: there is no such file{did_you_mean(path.name, others)}")


def find_reader(name: str, path: Path, registry: Registry) -> RecordReader:
    """Return the reader with a name, or if the name is empty the one for the suffix of the file."""
    fitting = [
        known
        for known in registry.names(RecordReader.kind)
        if path.suffix.lower() in getattr(registry.provider(RecordReader.kind, known).component, "suffixes", ())
    ]
    if not name and len(fitting) > 1:
        readers = {known: create(registry, RecordReader, {"name": known}, place=path.name) for known in fitting}
        fitting = [known for known in fitting if readers[known].recognises(path)] or [
            known for known in fitting if type(readers[known]).recognises is RecordReader.recognises
        ]
    if not name and len(fitting) != 1:
        which = f"readers {', '.join(fitting)} all read" if fitting else "no reader reads"
        ending = f"{which} '{path.suffix}'" if path.suffix else "its name has no ending that tells its format"
        known = ", ".join(registry.names(RecordReader.kind))
        raise RecordError(
            f"{path.name}: {ending}; give reader = one of {known}; rename it to .csv if it is text in columns, or "
            "export it as CSV"
        )
    return create(registry, RecordReader, {"name": name or fitting[0]}, place=path.name)


def _auxiliary_channels(settings: RecordSettings) -> dict[str, Channel]:
    found = {"time": settings.time_column, "frequency": settings.frequency_column, "segment": settings.segment_column}
    return {f" {name}": channel for name, channel in found.items() if channel is not None}


def read_columns(reader: ColumnReader, path: Path, columns: set[str]) -> RecordTable:
    """Return columns of a file; RecordError if their lengths differ, or they hold no plausible numbers."""
    table = reader.read(path, sorted(columns))
    lengths = {name: samples.size for name, samples in table.columns.items()}
    if len(set(lengths.values())) > 1 and not table.times:
        text = ", ".join(f"'{name}' {length}" for name, length in lengths.items())
        raise RecordError(
            f"{path.name}: the columns have different numbers of samples ({text}); expected equal ones: "
            "choose channels of one sample rate"
        )
    for name, samples in table.columns.items():
        bad = np.flatnonzero(~(np.abs(samples) < MAX_VALUE))
        if bad.size:
            raise RecordError(
                f"{path.name}: {bad.size} of {samples.size} samples in '{name}' are not finite numbers "
                f"below {MAX_VALUE:g}, the first is sample {bad[0] + 1}; mend or cut them out"
            )
    return table


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
        raise _missing_period_error(ways, channel[slice(*runs[0][1])], rate, path.name)
    if ways[0] in ("samples_per_period", "period_time"):
        return [
            _periodic_cut(settings, values, rate, name, place, run)
            for place, whole in runs
            for run in split_realisations(settings, rate, whole, place)
        ]
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


def _periodic_cut(
    settings: RecordSettings,
    values: Mapping[str, NDArray[np.float64]],
    rate: float,
    name: str,
    place: str,
    run: tuple[int, int],
) -> Cut:
    cut = periodic_cut(settings, rate, run, place)
    check_repeats(cut, values[name][: run[1]], rate, name, place)
    return select_lines(settings, cut, values, place)


def _missing_period_error(ways: list[str], channel: NDArray[np.float64], rate: float, place: str) -> RecordError:
    if ways:
        return RecordError(f"{place}: {' and '.join(ways)} are both given; expected one of them")
    found = detect_period(channel)
    seems = f": {period_hint(found, rate)}" if found else ", as samples_per_period = N (--samples-per-period N)"
    return RecordError(
        f"{place}: give samples_per_period or period_time (s) of a periodic record{seems}; "
        "steps or frequency_column (--frequency) of a stepped sine; or periodic = false (--aperiodic) if it "
        "does not repeat itself"
    )
