"""Sections [record] that are refused with a remedy, which no option of `fraexp import` can write."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit

from tests.records.test_remedies import PERIOD, PERIODS, RATE, csv, pair, wave, write_columns, write_response

Section = dict[str, Any]
Mend = Callable[[Section, re.Match[str]], None]
"""Changes the section as the message says."""


class RefusedSection(NamedTuple):
    """A section that is refused with a remedy."""

    name: str
    write: Callable[[Path], object]
    section: Section
    message: str
    mend: Mend


def write_steps(folder: Path) -> None:
    """Write a stepped sine of 10, 20 and 40 Hz, 2 s each."""
    frequency = np.repeat([10.0, 20.0, 40.0], int(2 * RATE))
    angle = 2 * np.pi * np.cumsum(frequency) / RATE
    write_columns(folder / "a.csv", "u [N],y [um],f [Hz]", np.cos(angle), 0.5 * np.cos(angle - 0.3), frequency)


def write_slow_clock(folder: Path) -> None:
    """Write a period of 200.37 samples."""
    angle = 2 * np.pi * np.outer(np.arange(3000), np.arange(1, 20)) / 200.37 + np.arange(19.0) ** 2
    write_columns(folder / "a.csv", "u [N],y [um]", *pair(np.cos(angle).sum(axis=1)))


def write_difference(folder: Path) -> None:
    u, y = pair(wave())
    write_columns(folder / "a.csv", "u [N],left [um],right [um]", u, y, -0.5 * y)


def write_levels_in_a_column(folder: Path) -> None:
    u, y = pair(wave())
    level = np.repeat([1.0, 2.0], u.size)
    write_columns(folder / "a.csv", "u [N],y [um],level", np.tile(u, 2) * level, np.tile(y, 2) * level, level)


def write_log(folder: Path) -> None:
    write_columns(folder / "a.trc", "u [N],y [um]", *pair(wave()))


def put(key: str, value: Any = None, place: str = "") -> Mend:
    """Return the remedy of another value, or of what the message says first; `place` is a channel or a list."""

    def change(section: Section, found: re.Match[str]) -> None:
        for one in section.get(place) or [section["channels"].get(place, section)]:
            one[key] = found[1] if value is None else value

    return change


def remove(key: str = "", channel: str = "") -> Mend:
    """Return the remedy of a key less: the one that the message names unless it is given."""
    return lambda section, found: (section["channels"][channel] if channel else section).pop(key or found[1])


def rename(old: str, place: str = "") -> Mend:
    """Return the remedy of another name for a key."""

    def change(section: Section, found: re.Match[str]) -> None:
        one = section["channels"].get(place) or (section[place][0] if place else section)
        one[found[1]] = one.pop(old)

    return change


def steps(*frequencies: float, length: float = 2.0) -> list[dict[str, float]]:
    return [{"start": 2 * k, "stop": 2 * k + length, "frequency": one} for k, one in enumerate(frequencies)]


def record(**more: Any) -> Section:
    return {"file": "a.csv", "sample_rate": RATE, "channels": {"u": "u", "y": "y"}, **more}


def periodic(**more: Any) -> Section:
    return record(samples_per_period=PERIOD, **more)


def response(**more: Any) -> Section:
    channels = {"frequency": "f", "magnitude": "mag", "phase": "phase"}
    return {"file": "a.csv", "channels": channels, "response_unit": "mm/N", **more}


def played(**more: Any) -> Section:
    one = {"start": 0, "periods": PERIODS, "samples": PERIOD, "harmonics": list(range(1, 31))}
    return record(segments=[{**one, **more}])


def channel(name: str, **table: Any) -> Section:
    return periodic(channels={"u": "u", "y": {"column": name, **table}})


PLAIN, STEPPED = csv(wave()), steps(10, 20, 40)
QUICK = ("a step of half the stated frequency", "two ways to state the period", "another key of a response", "no scale")
CASES = [
    RefusedSection(
        "two ways to state the period",
        PLAIN,
        periodic(period_time=0.2),
        r"samples_per_period and (period_time) are both given; expected one of them",
        remove(),
    ),
    RefusedSection(
        "steps with a period", write_steps, periodic(steps=STEPPED), r"(samples_per_period) and steps", remove()
    ),
    RefusedSection(
        "periodic and not",
        PLAIN,
        periodic(periodic=False),
        r"(periodic) = false and samples_per_period are both given",
        remove(),
    ),
    RefusedSection(
        "steps beyond the end",
        write_steps,
        record(steps=steps(10, 20, 40, length=3)),
        r"step 3 \(40 Hz\).* expected to lie within ([\d.]+) s",
        lambda section, found: section["steps"][2].update(stop=float(found[1])),
    ),
    RefusedSection(
        "a step backwards",
        write_steps,
        record(steps=[{"start": 2, "stop": 1, "frequency": 20}]),
        r"lasts from (\d) to (\d) s",
        lambda section, found: section["steps"][0].update(start=2, stop=4),
    ),
    RefusedSection(
        "a step above Nyquist",
        write_steps,
        record(steps=steps(10, 20, 4000)),
        r"step (3) .* expected less than half the sample rate of 1000 Hz",
        lambda section, found: section["steps"][int(found[1]) - 1].update(frequency=40),
    ),
    RefusedSection(
        "a step of half the stated frequency",
        write_steps,
        record(steps=steps(20, 40, 80)),
        r"strongest at 10 Hz where 20 Hz is stated, and so in 3 of 3 steps; check sample_rate and the steps",
        put("steps", STEPPED),
    ),
    RefusedSection(
        "a step of two periods' less",
        write_steps,
        record(steps=[{"start": 0, "stop": 0.1, "frequency": 10}]),
        r"expected at least (2) periods of (100) samples",
        lambda section, found: section["steps"][0].update(stop=int(found[1]) * int(found[2]) / RATE),
    ),
    RefusedSection(
        "steps are no list",
        write_steps,
        record(steps={"start": 0, "stop": 1, "frequency": 10}),
        r"expected such as (\[.*\])",
        lambda section, found: section.update(steps=tomlkit.parse(f"a = {found[1]}")["a"].unwrap()),
    ),
    RefusedSection(
        "steps that are selected",
        write_steps,
        record(steps=STEPPED, select="f = 10"),
        r"steps already defines the segments; leave out (select)",
        remove(),
    ),
    RefusedSection(
        "another key of a step",
        write_steps,
        record(steps=[{"start": 0, "stop": 2, "frequnecy": 10}]),
        r"no parameter 'frequnecy'; did you mean '(\w+)'",
        rename("frequnecy", "steps"),
    ),
    RefusedSection(
        "steps with harmonics",
        write_steps,
        record(steps=STEPPED, harmonics=[1]),
        r"steps states .*; leave (harmonics) out",
        remove(),
    ),
    RefusedSection(
        "steps within a range",
        write_steps,
        record(frequency_column="f", min_frequency=15),
        r"frequency_column states .*; leave (min_frequency) out",
        remove(),
    ),
    RefusedSection(
        "played beyond the end",
        PLAIN,
        played(periods=9),
        r"segment 1: it ends at sample 1800; the record has (\d+)",
        lambda section, found: section["segments"][0].update(periods=int(found[1]) // PERIOD),
    ),
    RefusedSection(
        "played harmonics above Nyquist",
        PLAIN,
        played(harmonics=[1, 2, 3, 150]),
        r"its harmonics are 1 to 150; expected some from 1 to below (\d+)",
        lambda section, found: section["segments"][0].update(harmonics=[1, 2, 3]),
    ),
    RefusedSection(
        "played from a later rest",
        PLAIN,
        played(rest=30),
        r"rest is sample 30; expected one before its start, (0)",
        put("rest", 0, "segments"),
    ),
    RefusedSection(
        "played periods that are dropped",
        PLAIN,
        {**played(), "skip_periods": 1},
        r"segments states .*; leave (skip_periods) out",
        remove(),
    ),
    RefusedSection(
        "a played excitation for other harmonics",
        PLAIN,
        played(excitation=[(5.0, 90.0)]),
        r"excitation has 1 pairs of amplitude and phase, .*; expected one for each, or (none)",
        lambda section, found: section["segments"][0].pop("excitation"),
    ),
    RefusedSection(
        "a controller without segments",
        PLAIN,
        periodic(controller={"name": "pid", "proportional": 1e3}),
        r"leave (controller) out of a record without segments",
        remove(),
    ),
    RefusedSection(
        "a file of another ending", write_log, periodic(file="a.trc"), r"give reader = one of (csv)", put("reader")
    ),
    RefusedSection("another reader", PLAIN, periodic(reader="csvv"), r"did you mean '(csv)'", put("reader")),
    RefusedSection(
        "another file", PLAIN, periodic(file="b.csv"), r"there is no such file; did you mean '(a\.csv)'", put("file")
    ),
    RefusedSection(
        "a number for a file",
        PLAIN,
        periodic(file=3),
        r"expected the name of a file, or a list",
        put("file", ["a.csv"]),
    ),
    RefusedSection(
        "no block of whole periods",
        write_slow_clock,
        record(period_time=0.20037, max_phase_slip=1e-6),
        r"; raise (max_phase_slip) .*, or record for longer",
        lambda section, found: section.update({found[1]: 0.01}),
    ),
    RefusedSection(
        "a slip of half a period",
        write_slow_clock,
        record(period_time=0.20037, max_phase_slip=0.5),
        r"max_phase_slip is 0.5; .* must be below (0.1)",
        put("max_phase_slip", 0.01),
    ),
    RefusedSection(
        "sum and difference",
        write_difference,
        channel("left", plus="right", minus="right"),
        r"has plus and (minus); expected only one of them",
        remove(channel="y"),
    ),
    RefusedSection(
        "no scale", PLAIN, channel("y", scale=0), r"(scale) is 0; expected another number", put("scale", -1, "y")
    ),
    RefusedSection(
        "an offset in words",
        PLAIN,
        channel("y", offset="zero"),
        r"channels.y.(offset) is 'zero'.*expected a valid number",
        put("offset", 0.5, "y"),
    ),
    RefusedSection(
        "another key of a channel",
        PLAIN,
        channel("y", scael=-1),
        r"channels.y has no parameter 'scael'; did you mean '(scale)'",
        rename("scael", "y"),
    ),
    RefusedSection(
        "a channel without a column",
        PLAIN,
        periodic(channels={"u": "u", "y": {"unit": "um"}}),
        r"channels.y lacks '(column)'",
        put("column", "y", "y"),
    ),
    RefusedSection(
        "a number for a column",
        PLAIN,
        periodic(channels={"u": "u", "y": 2}),
        r"expected the name of a column, or a table",
        lambda section, found: section["channels"].update(y="y"),
    ),
    RefusedSection(
        "a list of channels",
        PLAIN,
        periodic(channels=["u", "y"]),
        r'expected such as u = "iq \[A\]"',
        lambda section, found: section.update(channels={"u": "u", "y": "y"}),
    ),
    RefusedSection(
        "integrated thrice", PLAIN, channel("y", integrate=3), r"must be at most (2)", put("integrate", 2, "y")
    ),
    RefusedSection(
        "no such input", PLAIN, periodic(line_channel="v"), r"line_channel is 'v'.* known: (u)", put("line_channel")
    ),
    RefusedSection(
        "harmonics within a range",
        PLAIN,
        periodic(harmonics=[2, 3], max_frequency=50),
        r"expected either harmonics, or min_frequency, (max_frequency)",
        remove(),
    ),
    RefusedSection(
        "harmonics that are not excited",
        PLAIN,
        periodic(harmonics=[2, 50]),
        r"does not excite 250 Hz .*; correct (harmonics)",
        put("harmonics", [2, 30]),
    ),
    RefusedSection(
        "levels as realisations",
        write_levels_in_a_column,
        periodic(segment_column="level"),
        r"analyse each level by itself, with (\{level\}) in a column, a file or (select), and (level)",
        lambda section, found: section.update({found[2]: f"level = {found[1]}", found[3]: 2}),
    ),
    RefusedSection(
        "a level without its value",
        write_levels_in_a_column,
        periodic(select="level = {level}"),
        r"give (level) \(",
        lambda section, found: section.update({found[1]: 2}),
    ),
    RefusedSection(
        "another key", PLAIN, periodic(skip_period=1), r"did you mean '(skip_periods)'", rename("skip_period")
    ),
    RefusedSection(
        "a rate in seconds",
        PLAIN,
        periodic() | {"sample_rate": "1 ms"},
        r"the same kind as '(Hz)'",
        put("sample_rate", "1 kHz"),
    ),
    RefusedSection("a key of a response", PLAIN, periodic(averages=4), r"leave (averages) out", remove()),
    RefusedSection(
        "another key of a response",
        write_response,
        response(samples_per_period=200),
        r"leave (samples_per_period) out",
        remove(),
    ),
    RefusedSection(
        "a range of a response",
        write_response,
        response(min_frequency=5),
        r"leave (min_frequency) out",
        remove(),
    ),
    RefusedSection(
        "an amplitude below 0",
        write_response,
        response(input_amplitude=-3),
        r"input_amplitude is .*; expected a number above 0 (N)",
        lambda section, found: section.update(input_amplitude=f"3 {found[1]}"),
    ),
    RefusedSection(
        "an amplitude of the output",
        write_response,
        response(input_amplitude="3 mm"),
        r"input_amplitude: 'mm' is not a unit of the same kind as '(N)'",
        lambda section, found: section.update(input_amplitude=f"3 {found[1]}"),
    ),
    RefusedSection(
        "samples beside a response",
        write_response,
        response(channels={"frequency": "f", "magnitude": "mag", "phase": "phase", "u": "mag"}),
        r"are frequency, magnitude, phase, (u); expected frequency with magnitude and phase",
        lambda section, found: section["channels"].pop(found[1]),
    ),
    RefusedSection(
        "two responses as one",
        write_response,
        response(file=["a.csv", "a.csv"]),
        r"expected (one file) with one response",
        put("file", "a.csv"),
    ),
]
