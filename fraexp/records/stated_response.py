"""Responses that were measured elsewhere: Bode tables of drives, analysers and other programs, as a source of signals.

Each frequency becomes a sine of which only the fundamental is known, so that what takes a stepped sine takes such a
response as well: it is shown and compared, freed from dead time, fitted, and freed from friction by the describing
function of a friction model.
"""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.data import units
from fraexp.data.signals import RecordTable, Segment, Signals, StatedLine
from fraexp.data.sweep import Plain
from fraexp.errors import ParameterError, RecordError
from fraexp.records.channels import Channel, PlainTable, auxiliary_values, check_unit, column_text, si_unit
from fraexp.records.record_settings import RecordSettings

MIN_MIRRORED = 3
"""Number of frequencies from which a response does not mirror itself by chance."""
POLAR, CARTESIAN = ("magnitude", "phase"), ("real", "imaginary")
RESPONSE_CHANNELS = ("frequency", *POLAR, *CARTESIAN, "coherence")
"""Channels of a record that is a response: with ``frequency`` either the polar or the Cartesian ones."""
INPUT, OUTPUT = "u", "y"
SAMPLES_PER_PERIOD, FEW_SAMPLES_PER_PERIOD, MANY_POINTS = 1024, 128, 4000
"""Samples of each sine; fewer of them if there are more points than many."""
MAX_POINTS = 200_000
DECIBEL = "dB"
RATIO = re.compile(r"^\(?(?P<output>[^()/]+(?:/s(?:\^2|\*\*2|²)?)?)\)?/\(?(?P<input>[^()/]+)\)?$")
"""Unit of a response: that of the output over that of the input, such as ``mm/N``, ``(m/s)/V`` or ``rad/(N m)``."""


@dataclass(frozen=True)
class _Points:
    """The points of a response in SI units, by ascending frequency."""

    frequency: NDArray[np.float64]
    response: NDArray[np.complex128]
    coherence: NDArray[np.float64] | None


def is_response(channels: Mapping[str, object]) -> bool:
    """Say whether the channels of a record make it a response, and not samples over time."""
    return "frequency" in channels and any(name in channels for name in (*POLAR, *CARTESIAN))


def response_columns(settings: RecordSettings) -> set[str]:
    """Return the columns of a file that a response needs; ParameterError if its channels are not those of one."""
    given = settings.channels.keys()
    unknown = sorted(given - set(RESPONSE_CHANNELS))
    chosen = [pair for pair in (POLAR, CARTESIAN) if given & set(pair)]
    if unknown or len(chosen) != 1 or not given >= set(chosen[0]):
        raise ParameterError(
            f"channels of a response are {', '.join(sorted(given))}; expected frequency with magnitude and phase, or "
            "with real and imaginary, and coherence if it is known"
        )
    return {column for channel in settings.channels.values() for column in channel.columns}


def resolve_response(settings: RecordSettings, table: RecordTable, path: Path) -> PlainTable:
    """Return a response as plain data: its columns with their units, its segments and its unit."""
    for name in ("frequency", "phase"):
        one = settings.channels.get(name)
        if one is not None and one.unit and abs(one.scale) == 1 and table.units.get(one.column):
            check_unit(name, one, one.column, table.units[one.column], path)
    output, entry = _split_unit(_response_unit(settings, table, path), path)
    channels = {name: _plain_column(name, of, table) for name, of in settings.channels.items()}
    integrals = next((of.integrate for name, of in settings.channels.items() if name in (POLAR[0], CARTESIAN[0])), 0)
    plain: PlainTable = {"columns": channels, "factor": output[0] / entry[0]}
    if integrals:
        plain["integrals"] = integrals
        output = (output[0], si_unit(f"({output[1]})*s**{integrals}", path.name)[1])
    if settings.input_amplitude is not None:
        plain["input_amplitude"] = _input_amplitude(settings.input_amplitude, entry[1])
    if settings.averages is not None:
        plain["averages"] = settings.averages
    points = _read_points(plain, table, path)
    samples = SAMPLES_PER_PERIOD if points.frequency.size <= MANY_POINTS else FEW_SAMPLES_PER_PERIOD
    return {
        "response": plain,
        "channels": {INPUT: {"unit": entry[1]}, OUTPUT: {"unit": output[1]}},
        "segments": [
            {"start": 0, "periods": 1, "samples": samples, "sample_time": 1 / (samples * frequency), "lines": [1]}
            for frequency in points.frequency.tolist()
        ],
    }


def load_response(record: Plain, table: RecordTable, path: Path) -> Signals:
    """Return the signals that stand for a response."""
    plain = record["response"]
    points = _read_points(plain, table, path)
    amplitude = plain.get("input_amplitude")
    variances = _relative_variances(points, plain.get("averages"))
    coherence = np.full(points.frequency.size, np.nan) if points.coherence is None else points.coherence
    phase = 2 * np.pi * np.arange(record["segments"][0]["samples"]) / record["segments"][0]["samples"]
    segments = [
        _as_sine(cut, phase, response, variance, coherence, amplitude)
        for cut, response, variance, coherence in zip(
            record["segments"], points.response, variances, coherence, strict=True
        )
    ]
    return Signals(tuple(segments), {name: str(channel["unit"]) for name, channel in record["channels"].items()})


def _as_sine(
    cut: Plain,
    phase: NDArray[np.float64],
    response: complex,
    variance: float,
    coherence: float,
    amplitude: float | None,
) -> Segment:
    size = amplitude or 1.0
    channels = {INPUT: size * np.cos(phase), OUTPUT: size * abs(response) * np.cos(phase + np.angle(response))}
    stated = StatedLine(variance * abs(size * response) ** 2, coherence, amplitude is not None)
    shaped = {name: samples[None, :] for name, samples in channels.items()}
    return Segment(cut["sample_time"], shaped, np.array([1]), stated=stated)


def _relative_variances(points: _Points, averages: int | None) -> NDArray[np.float64]:
    """Return E|dG|² / |G|² by coherence γ² and number of averages M, shape (n,): (1 - γ²) / (γ² M); NaN if unknown.

    Bendat and Piersol, Random Data, 4th ed., 2010, eq (9.90), whose 2M is for the magnitude alone.
    """
    if points.coherence is None or averages is None:
        return np.full(points.frequency.size, np.nan)
    return np.asarray((1 - points.coherence) / (points.coherence * averages))


def _read_points(plain: Plain, table: RecordTable, path: Path) -> _Points:
    """Return the points by ascending frequency, without one at 0 Hz; RecordError where they are no response."""
    columns = plain["columns"]
    frequency = _frequency(columns["frequency"], table, path)
    used = frequency > 0
    order = np.flatnonzero(used)[np.argsort(frequency[used])]
    response = (_response(columns, table, path) * plain["factor"])[order]
    found = frequency[order]
    response = response / (2j * np.pi * found) ** plain.get("integrals", 0)
    coherence = _column(columns["coherence"], table)[order] if "coherence" in columns else None
    _check_points(found, response, coherence, path)
    return _Points(found, response, coherence)


def _check_points(
    frequency: NDArray[np.float64], response: NDArray[np.complex128], coherence: NDArray[np.float64] | None, path: Path
) -> None:
    if not 1 <= frequency.size <= MAX_POINTS:
        raise RecordError(f"{path.name}: {frequency.size} frequencies are above 0 Hz; expected 1 to {MAX_POINTS}")
    same = np.flatnonzero(np.diff(frequency) <= 0)
    if same.size:
        raise RecordError(
            f"{path.name}: {frequency[same[0]]:.6g} Hz is there twice; expected each frequency once: import one "
            "measurement at a time"
        )
    bad = np.flatnonzero(~np.isfinite(response) | (response == 0))
    if bad.size:
        raise RecordError(
            f"{path.name}: the response at {frequency[bad[0]]:.6g} Hz is {response[bad[0]]:g}; expected a finite "
            "number other than 0"
        )
    middle = frequency.size // 2
    mirrored = response[::-1][:middle].conj()
    if middle > MIN_MIRRORED and np.allclose(response[:middle], mirrored, rtol=1e-6, atol=0):
        raise RecordError(
            f"{path.name}: the upper half is the complex conjugate of the lower one, as in a Fourier transform up to "
            f"the sample rate; leave out the rows above {frequency[middle]:.6g} Hz"
        )
    if coherence is not None and not ((coherence > 0) & (coherence <= 1)).all():
        raise RecordError(f"{path.name}: the coherence leaves the range from 0 to 1; expected γ² between them")


def _frequency(column: Plain, table: RecordTable, path: Path) -> NDArray[np.float64]:
    given = column["unit"] or "Hz"
    if "rad" in given:  # which pint takes for the same as Hz
        return _column(column, table) * units.factor(given, "rad/s") / (2 * np.pi)
    return auxiliary_values("frequency", Channel(column=column["column"], unit=given), table, "Hz", path)


def _response(columns: Mapping[str, Plain], table: RecordTable, path: Path) -> NDArray[np.complex128]:
    """Return the response in the unit that the record states, shape (n,)."""
    if "real" in columns:
        return np.asarray(_column(columns["real"], table) + 1j * _column(columns["imaginary"], table))
    size = _column(columns["magnitude"], table)
    if columns["magnitude"]["unit"] == DECIBEL:
        size = 10 ** (size / 20)
    else:
        _check_magnitude(columns["magnitude"]["column"], table, path)
    angle = _column(columns["phase"], table)
    if not columns["phase"]["unit"] and np.ptp(angle) <= 2 * np.pi:
        column = columns["phase"]["column"]
        raise RecordError(
            f"{path.name}: nothing tells if the phase in column '{column}' ({angle.min():.3g} to {angle.max():.3g}) is "
            f"in degrees or radians; give its unit: 'phase={column_text(column)} [rad]' or [deg]"
        )
    angle = angle * units.factor(columns["phase"]["unit"] or "deg", "rad")
    return np.asarray(size * np.exp(1j * angle))


def _check_magnitude(column: str, table: RecordTable, path: Path) -> None:
    smallest = float(table.columns[column].min(initial=0.0))
    if smallest < 0:
        raise RecordError(
            f"{path.name}: column '{column}' contains the magnitude {smallest:g}; expected 0 or more, or "
            f"dB: 'magnitude={column_text(column)} [dB]'"
        )


def _column(column: Plain, table: RecordTable) -> NDArray[np.float64]:
    return np.asarray(table.columns[column["column"]] * column["scale"])


def _plain_column(name: str, channel: Channel, table: RecordTable) -> PlainTable:
    """Return column, unit and factor of a channel; a magnitude without a unit is a plain ratio."""
    unit = (channel.unit or table.units.get(channel.column, "")).strip()
    if name == "magnitude" and unit.lower() == DECIBEL.lower():
        unit = DECIBEL
    elif name in ("magnitude", *CARTESIAN):
        unit = ""
    scale = channel.scale
    if name == "coherence" and unit == "%":
        unit, scale = "", scale / 100
    return {"column": channel.column, "unit": unit, "scale": scale}


def is_response_unit(text: str) -> bool:
    """Say whether a text is a unit of an output over that of an input, such as deg/Nm."""
    with suppress(ParameterError):
        return bool(_split_unit(text, Path()))
    return False


def _response_unit(settings: RecordSettings, table: RecordTable, path: Path) -> str:
    """Return the unit of the response: the study's, or that of its channels or their columns."""
    unit = settings.response_unit
    for name in (POLAR[0], *CARTESIAN):
        channel = settings.channels.get(name)
        if channel is None:
            continue
        heading = table.units.get(channel.column, "")
        _check_decibel(name, channel, heading, path)
        for stated in (channel.unit, heading) if abs(channel.scale) == 1 else ():
            if not is_response_unit(stated):
                continue
            unit = unit or stated
            if not _is_same_unit(unit, stated, path):
                raise RecordError(
                    f"{path.name}: the unit of the response is given as {unit}, but {stated} is stated for column "
                    f"'{channel.column}'; leave it out (response_unit, --unit) or correct it"
                )
    return unit


def _check_decibel(name: str, channel: Channel, heading: str, path: Path) -> None:
    given = channel.unit.strip().lower()
    if given and given != DECIBEL.lower() and heading.strip().lower() == DECIBEL.lower():
        raise RecordError(
            f"{path.name}, channel '{name}': the unit is given as {channel.unit}, but the file says dB; "
            "leave the unit out"
        )


def _is_same_unit(one: str, other: str, path: Path) -> bool:
    """Say whether two units of responses are equal, of whatever kind."""
    (output, entry), (other_output, other_entry) = _split_unit(one, path), _split_unit(other, path)
    kinds = (output[1], entry[1]) == (other_output[1], other_entry[1])
    return kinds and math.isclose(output[0] / entry[0], other_output[0] / other_entry[0], rel_tol=1e-9)


def _split_unit(text: str, path: Path) -> tuple[tuple[float, str], tuple[float, str]]:
    """Return factor and SI unit of output and input."""
    found = RATIO.match(text.strip())
    if not found:
        stated = f"'{text}'" if text else "not given"
        raise ParameterError(
            f"{path.name}: response_unit is {stated}; expected the output's over the input's, such as mm/N, rad/(N m) "
            "or (m/s)/A (--unit)"
        )
    return si_unit(found["output"], path.name), si_unit(found["input"], path.name)


def _input_amplitude(given: float | str, unit: str) -> float:
    try:
        value = units.number(given, unit) if isinstance(given, str) else given
    except ParameterError as error:
        raise ParameterError(f"input_amplitude: {error}") from None
    if not value > 0:
        raise ParameterError(f"input_amplitude is {given}; expected a number above 0 {unit}")
    return float(value)
