"""What measured records tell of an axis: the estimator that suits them, and the study that applies it."""

import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fraexp.analysis.fourier import line_amplitude, phasors
from fraexp.analysis.quantisation import grid_step
from fraexp.analysis.response import response_result
from fraexp.components.registry import Registry
from fraexp.data import toml
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from fraexp.records.proposals import propose_files
from fraexp.records.record_doubts import LOOP_UNITS
from fraexp.records.record_files import list_contents
from fraexp.records.record_settings import INJECTED_CHANNELS, RecordSettings
from fraexp.records.source import load, resolve
from fraexp.records.stated_response import is_response
from fraexp.records.study_writer import PERIODIC_ESTIMATOR, ImportRequest, study_data

LEVEL_RATIO = float(np.sqrt(2.0))
"""Ratio of the input's amplitudes from which records are levels, and no repetitions of one.

Friction is identified from amplitudes a factor of 2 apart (`plant_and_friction`); this is half of it in dB.
"""
LEVELS_FOR_LAWS = 3
"""Number of levels that tell laws apart: nearly still, presliding and sliding."""
RESPONSE = "response"
"""Label of the response to which a plant is fitted."""
ALL_RECORDS = "all records"
"""Label of the sweep to which all levels contribute."""
PLACEHOLDERS = ("HZ", "OUTPUT/INPUT")
"""What a proposal has for what the user must state."""
CUTTING_KEYS = {"samples_per_period", "period_time", "steps", "frequency_column", "segments", "periodic"}
"""Keys of [record] that say what repeats itself, of which one is given."""
SPEED_UNITS = tuple((force, f"{position}/s") for force, position in LOOP_UNITS)
"""Units of control input and velocity, which tell friction of a record that does not repeat itself."""
JOINT, PLANT, SLIDING = "plant_and_friction", "modal_fit", "friction_identification"


class RecordLook(NamedTuple):
    """What is to be seen in records before anything is estimated."""

    unit: str
    """Unit of the input; empty for a response that was measured elsewhere."""
    frequencies: tuple[float, ...]
    """Excited frequencies [Hz], ascending; empty for a record that does not repeat itself."""
    amplitudes: tuple[float, ...]
    """Median amplitude of the input in each file [its unit]; empty where the record does not repeat itself."""
    levels: int
    """Number of amplitudes at a frequency that are further apart than `LEVEL_RATIO`, the median over frequencies."""
    resolution: float
    """Quantisation step of the position [its unit]; 0 if it is as good as continuous."""
    skipped: int = 0
    """Number of first periods that are left out."""


class Choice(NamedTuple):
    """An estimator that suits records, as a study names it, and why."""

    estimator: Mapping[str, Any]
    reason: str


def with_channels(request: ImportRequest, registry: Registry) -> ImportRequest:
    """Return a request with what names, units and values of its files show: channels, clock, and what repeats itself.

    Raises
    ------
    RecordError : if the request states no channels, and these leave something open.
    """
    _check_files(request.files)
    proposal = propose_files({file: list_contents(file, registry) for file in request.files}, registry)
    is_open = any("UNIT]" in text or text.startswith("COLUMN") for text in proposal.channels.values())
    is_open |= any(value in PLACEHOLDERS and key not in request.options for key, value in proposal.options.items())
    if not request.channels and (is_open or proposal.levels):
        needs = proposal.needs or ["the columns are those of several levels: leave out {level}, and choose one"]
        given = proposal.command.removeprefix("fraexp import ")
        raise RecordError(f"{request.files[0]}: {'; '.join(needs)}; give the options of: fraexp identify {given}")
    known = {key: value for key, value in proposal.options.items() if value not in PLACEHOLDERS}
    if not CUTTING_KEYS.isdisjoint(request.options):
        known = {key: value for key, value in known.items() if key not in CUTTING_KEYS}
    found = replace(request, channels=request.channels or proposal.channels, options={**known, **request.options})
    skipped = {} if {"skip_periods", "skip_time"} & found.options.keys() else _skipped_periods(found, registry)
    return replace(found, options={**found.options, **skipped})


def _skipped_periods(request: ImportRequest, registry: Registry) -> dict[str, float | bool | str]:
    """Return the option that leaves out the first periods, up to half of them, in which the machine was settling."""
    try:
        settings, _, signals = _read(request, registry)
    except RecordError:  # the look at the records says why
        return {}
    names = [name for name in request.channels if name not in INJECTED_CHANNELS][:2]
    if is_response(settings.channels) or len(names) < 2 or not signals.segments[0].periodic:
        return {}
    pair = names[0], names[1]

    def unsettled(skipped: int) -> int:
        """Count the lines of segments that still settle without so many of their first blocks."""
        count = 0
        for segment in signals.segments:
            phases = ([phasors(segment, name)[skipped:]] for name in pair)
            found = response_result(replace(signals, segments=(segment,)), *phases, names=pair, units=("", ""))
            count += sum(len(of.frequencies) for of in found.findings if of.kind == "still settling")
        return count

    fewest = min(range(min(len(of.channels[names[0]]) for of in signals.segments) // 2 + 1), key=unsettled)
    return {"skip_periods": fewest} if fewest else {}


def _check_files(files: Sequence[Path]) -> None:
    twice = next((file for at, file in enumerate(files) if file.resolve() in [of.resolve() for of in files[:at]]), None)
    if twice is not None:
        raise RecordError(f"{twice}: the file is given twice; expected records of one machine, each once")


def find_levels(request: ImportRequest, registry: Registry) -> RecordLook | None:
    """Return what is to be seen in the records of one axis at several amplitudes; None if they are others."""
    with suppress(RecordError):  # of no axis, or invalid, which their own study says
        look = look_at(request, registry)
        return look if look.levels > 1 else None
    return None


def look_at(request: ImportRequest, registry: Registry) -> RecordLook:
    """Return what is to be seen in the records of a request; RecordError if they are none of one axis."""
    settings, experiment, signals = _read(request, registry)
    if is_response(settings.channels):
        return RecordLook("", _frequencies(signals), (), 1, 0.0)
    channels = [name for name in request.channels if name not in INJECTED_CHANNELS]
    if len(channels) < 2:
        found = f"{channels[0]} is the only channel" if channels else "neither input nor position is a channel"
        raise RecordError(f"{request.files[0]}: {found}; name both: u=COLUMN and y=COLUMN")
    source, position = channels[:2]
    units = signals.units[source], signals.units[position]
    if not signals.segments[0].periodic and units in SPEED_UNITS:
        return RecordLook(units[0], (), (), 1, 0.0)
    if units in SPEED_UNITS:
        given = [part for name, text in request.channels.items() for part in ("--channel", f"{name}={text}")]
        raise RecordError(
            f"{request.files[0]}: '{position}' is a velocity; expected a position: integrate it over its periods, "
            f"{shlex.join([*given, '--integrate', position])}, or give --aperiodic"
        )
    if units not in LOOP_UNITS:
        raise RecordError(
            f"{request.files[0]}: the input is in {units[0]}, the output in {units[1]}; expected N and m, or N m and "
            f"rad: give the factors, such as '{source}=COLUMN * 31.5 [N]' for a current, or "
            f"'{position}=COLUMN * 0.5 [um]' for counts"
        )
    steps = [grid_step(segment.channels[position]) for segment in signals.segments]
    if not signals.segments[0].periodic:
        return RecordLook(units[0], (), (), 1, _rounded(min(steps)))
    by_file: dict[int, list[Segment]] = defaultdict(list)
    for plain, segment in zip(experiment["record"]["segments"], signals.segments, strict=True):
        by_file[plain.get("part", 0)].append(segment)
    sizes = (np.median([line_amplitude(segment, source) for segment in segments]) for segments in by_file.values())
    levels = _level_count(signals, source)
    amplitudes, resolution = tuple(map(float, sizes)), _rounded(min(steps))
    return RecordLook(units[0], _frequencies(signals), amplitudes, levels, resolution, settings.skip_periods)


def _read(request: ImportRequest, registry: Registry) -> tuple[RecordSettings, dict[str, Any], Signals]:
    """Return settings, experiment and signals of the records of a request."""
    section = {"file": [str(file) for file in request.files], "channels": dict(request.channels), **request.options}
    settings = RecordSettings.parse(section, "record")
    experiment, paths = resolve(settings, Path(), registry)
    return settings, experiment, load(experiment, paths, registry)


def _rounded(value: float) -> float:
    """Return a number without the rounding errors of what it was found in."""
    return float(f"{value:.6g}")


def _frequencies(signals: Signals) -> tuple[float, ...]:
    return tuple(sorted({_rounded(float(of)) for segment in signals.segments for of in segment.frequency}))


def _level_count(signals: Signals, source: str) -> int:
    """Return how many amplitudes of the input a frequency has, the median over the frequencies."""
    sizes: dict[str, list[float]] = defaultdict(list)
    for segment in signals.segments:
        found = np.abs(phasors(segment, source).mean(axis=0))
        for frequency, size in zip(segment.frequency, found, strict=True):
            sizes[f"{frequency:.6g}"].append(float(size))
    steps = [np.diff(np.log(np.sort(of))) for of in sizes.values() if min(of) > 0]
    return 1 + int(np.median([np.sum(of > np.log(LEVEL_RATIO)) for of in steps] or [0]))


def choose(look: RecordLook) -> Choice:
    """Return the estimator that suits records."""
    if not look.unit:
        return Choice({"name": PLANT}, "it is a response that was measured elsewhere")
    if not look.frequencies:
        return Choice(
            {"name": SLIDING, "laws": ["coulomb"]},
            "the record does not repeat itself (of a stepped sine, state --frequency)",
        )
    if look.levels > 1:
        law = {"law": "any"} if look.levels >= LEVELS_FOR_LAWS else {}
        encoder = {"resolution": look.resolution} if look.resolution else {}
        joint = {"name": JOINT, **law, "estimate_dead_time": True, **encoder}
        return Choice(joint, f"the same frequencies were excited at {look.levels} amplitudes")
    return Choice({"name": PLANT}, "there is one amplitude, at which friction may look like a spring")


def identification_study(
    request: ImportRequest, look: RecordLook, choice: Choice, folder: Path, registry: Registry
) -> dict[str, Any]:
    """Return the study, as plain data, that applies the chosen estimator; files of several levels also one by one."""
    own = dict(choice.estimator)
    name = str(own.pop("name"))
    if name == PLANT and len(request.files) > 1 and not set(INJECTED_CHANNELS) & set(request.channels):
        own["excitation_channel"] = next(iter(request.channels))  # repetitions are averaged
    settings = [*(f"estimator.{key}={toml.dumps(value)}" for key, value in own.items()), *request.settings]
    estimators = [] if name == PLANT else [name]  # a plant is fitted to what the usual estimator of a record finds
    data: dict[str, Any] = study_data(
        replace(request, estimators=estimators, settings=settings, each_file=False), folder, registry
    )
    data["title"] = f"Plant and friction of {', '.join(file.name for file in request.files)}"
    files = [data["record"]["file"]] if isinstance(data["record"]["file"], str) else data["record"]["file"]
    names = [Path(file).name for file in files]
    labels = names if len(set(names)) == len(names) else [Path(*Path(file).parts[-2:]).as_posix() for file in files]
    plain = {"name": PERIODIC_ESTIMATOR, **{key: data["estimator"][key] for key in ("input", "output")}}
    each = [
        {"label": label, "record": {"file": file}, "estimator": plain}
        for label, file in zip(labels, files, strict=True)
        if len(files) > 1
    ]
    if name == PLANT:
        method = data.pop("estimator")
        fit = {"name": PLANT, "method": method}
        return {**data, "case": [*each, {"label": RESPONSE, "estimator": method}, {"label": PLANT, "estimator": fit}]}
    if not each:
        return data
    joint = {"label": ALL_RECORDS, "estimator": data.pop("estimator")}
    return {**data, "case": [*each, joint]}
