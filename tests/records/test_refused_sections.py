"""Each refusal of a section [record] that no option of `fraexp import` can cause: what the message asks for works."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional

from fraexp.components.registry import Registry
from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.records import RecordSettings, load, resolve
from tests.records.test_remedies import PERIOD, PERIODS, RATE, csv, pair, wave, write_columns, write_response

Section = dict[str, Any]
Write = Callable[[Path], object]


def write_steps(folder: Path) -> None:
    """Write a stepped sine of 10, 20 and 40 Hz, 2 s each."""
    frequency = np.repeat([10.0, 20.0, 40.0], int(2 * RATE))
    angle = 2 * np.pi * np.cumsum(frequency) / RATE
    write_columns(folder / "a.csv", "u [N],y [um],f [Hz]", np.cos(angle), 0.5 * np.cos(angle - 0.3), frequency)


def write_slow_clock(folder: Path) -> None:
    """Write a period of 200.37 samples."""
    angle = 2 * np.pi * np.outer(np.arange(3000), np.arange(1, 20)) / 200.37 + np.arange(19.0) ** 2
    write_columns(folder / "a.csv", "u [N],y [um]", *pair(np.cos(angle).sum(axis=1)))


def write_levels_in_a_column(folder: Path) -> None:
    u, y = pair(wave())
    level = np.repeat([1.0, 2.0], u.size)
    write_columns(folder / "a.csv", "u [N],y [um],level", np.tile(u, 2) * level, np.tile(y, 2) * level, level)


def write_log(folder: Path) -> None:
    write_columns(folder / "a.trc", "u [N],y [um]", *pair(wave()))


def record(**more: Any) -> Section:
    return {"file": "a.csv", "sample_rate": RATE, "channels": {"u": "u", "y": "y"}, **more}


def periodic(**more: Any) -> Section:
    return record(samples_per_period=PERIOD, **more)


def channel(**table: Any) -> Section:
    return periodic(channels={"u": "u", "y": {"column": "y", **table}})


def response(**more: Any) -> Section:
    channels = {"frequency": "f", "magnitude": "mag", "phase": "phase"}
    return {"file": "a.csv", "channels": channels, "response_unit": "mm/N", **more}


def steps(*frequencies: float, length: float = 2.0) -> list[dict[str, float]]:
    return [{"start": 2 * k, "stop": 2 * k + length, "frequency": one} for k, one in enumerate(frequencies)]


def played(**more: Any) -> Section:
    """Return the section of a record that states what was played."""
    one = {"start": 0, "periods": PERIODS, "samples": PERIOD, "harmonics": list(range(1, 31))}
    return record(segments=[{**one, **more}])


PLAIN, STEPPED = csv(wave()), steps(10, 20, 40)
CONTROLLER = {"name": "pid", "proportional": 1e3}
SUPERFLUOUS = [
    (PLAIN, periodic(period_time=0.2), "period_time"),
    (PLAIN, periodic(controller=CONTROLLER), "controller"),
    (PLAIN, periodic(averages=4), "averages"),
    (PLAIN, periodic(harmonics=[2, 3], max_frequency=50), "max_frequency"),
    (PLAIN, {**played(), "skip_periods": 1}, "skip_periods"),
    (write_steps, periodic(steps=STEPPED), "samples_per_period"),
    (write_steps, record(steps=STEPPED, select="f = 10"), "select"),
    (write_steps, record(steps=STEPPED, harmonics=[1]), "harmonics"),
    (write_steps, record(frequency_column="f", min_frequency=15), "min_frequency"),
    (write_response, response(samples_per_period=200), "samples_per_period"),
    (write_response, response(min_frequency=5), "min_frequency"),
]
"""Who writes the file, the section, and the key that cannot be used."""
MISSPELT = [
    (PLAIN, periodic(skip_period=1), "skip_period", "skip_periods"),
    (PLAIN, channel(scael=-1), "scael", "scale"),
    (write_steps, record(steps=[{"start": 0, "stop": 2, "frequnecy": 10}]), "frequnecy", "frequency"),
]
WRONG: dict[str, tuple[Write, Section, str, Section]] = {
    "steps beyond the end": (
        write_steps, record(steps=steps(10, 20, 40, length=3)),
        r"step 3 \(40 Hz\).* expected to lie within 6 s", {"steps": STEPPED},
    ),
    "a step backwards": (
        write_steps, record(steps=[{"start": 2, "stop": 1, "frequency": 20}]),
        r"lasts from 2 to 1 s", {"steps": STEPPED},
    ),
    "a step above Nyquist": (
        write_steps, record(steps=steps(10, 20, 4000)),
        r"step 3 .* expected less than half the sample rate of 1000 Hz", {"steps": STEPPED},
    ),
    "a step of half the stated frequency": (
        write_steps, record(steps=steps(20, 40, 80)),
        r"strongest at 10 Hz where 20 Hz is stated, and so in 3 of 3 steps; check sample_rate", {"steps": STEPPED},
    ),
    "a step of less than two periods": (
        write_steps, record(steps=[{"start": 0, "stop": 0.1, "frequency": 10}]),
        r"expected at least 2 periods of 100 samples", {"steps": [{"start": 0, "stop": 0.2, "frequency": 10}]},
    ),
    "played beyond the end": (
        PLAIN, played(periods=9), r"segment 1: it ends at sample 1800; the record has 1200", played(),
    ),
    "played harmonics above Nyquist": (
        PLAIN, played(harmonics=[1, 150]), r"its harmonics are 1 to 150; expected some from 1 to below 100", played(),
    ),
    "played from a later rest": (
        PLAIN, played(rest=30), r"rest is sample 30; expected one before its start, 0", played(rest=0),
    ),
    "a played excitation for other harmonics": (
        PLAIN, played(excitation=[(5.0, 90.0)]),
        r"excitation has 1 pairs of amplitude and phase, .*; expected one for each, or none", played(),
    ),
    "a file of another ending": (
        write_log, periodic(file="a.trc"), r"no reader reads '\.trc'; give reader = one of csv", {"reader": "csv"},
    ),
    "another file": (PLAIN, periodic(file="b.csv"), r"no such file; did you mean 'a\.csv'", {"file": "a.csv"}),
    "no block of whole periods": (
        write_slow_clock, record(period_time=0.20037, max_phase_slip=1e-6),
        r"; raise max_phase_slip .*, or record for longer", {"max_phase_slip": 0.01},
    ),
    "a slip of half a period": (
        write_slow_clock, record(period_time=0.20037, max_phase_slip=0.5),
        r"max_phase_slip is 0.5; .* must be below 0.1", {"max_phase_slip": 0.01},
    ),
    "sum and difference": (
        PLAIN, channel(plus="u", minus="u"), r"has plus and minus; expected only one of them", channel(),
    ),
    "a channel without a column": (
        PLAIN, periodic(channels={"u": "u", "y": {"unit": "um"}}), r"channels.y lacks 'column'", channel(unit="um"),
    ),
    "harmonics that are not excited": (
        PLAIN, periodic(harmonics=[2, 50]), r"does not excite 250 Hz .*; correct harmonics", {"harmonics": [2, 30]},
    ),
    "levels as realisations": (
        write_levels_in_a_column, periodic(segment_column="level"),
        r"or analyse it by itself, with \{level\} in a column, a file or select, and level",
        {"segment_column": None, "select": "level = {level}", "level": 2},
    ),
    "samples beside a response": (
        write_response, response(channels={**response()["channels"], "u": "mag"}),
        r"are frequency, magnitude, phase, u; expected frequency with magnitude and phase", response(),
    ),
    "two responses as one": (
        write_response, response(file=["a.csv", "a.csv"]), r"expected one file with one response", {"file": "a.csv"},
    ),
}  # fmt: skip
"""Who writes the file, the section, the message, and the keys that it asks for; None for a key to leave out."""


@pytest.fixture
def compute(tmp_path: Path, registry: Registry) -> Callable[[Section], Result]:
    def run(section: Section) -> Result:
        experiment, files = resolve(RecordSettings.parse(deepcopy(section), "record"), tmp_path, registry)
        return Conventional().estimate(load(experiment, files, registry))

    return run


def refused(compute: Callable[[Section], Result], section: Section, message: str) -> None:
    with pytest.raises(FraexpError, match=message) as caught:
        compute(section)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("write", "section", "key"), SUPERFLUOUS)
def test_a_key_that_cannot_be_used_is_named_and_can_be_left_out(
    tmp_path: Path, compute: Callable[[Section], Result], write: Write, section: Section, key: str
) -> None:
    write(tmp_path)
    refused(
        compute, section, rf"leave {key} out|leave out {key}|{key} .*both given|expected either harmonics, or .*{key}"
    )
    assert compute({name: value for name, value in section.items() if name != key}).response is not None


@pytest.mark.parametrize(("write", "section", "wrong", "right"), MISSPELT)
def test_a_misspelt_key_is_named_with_the_nearest(
    tmp_path: Path, compute: Callable[[Section], Result], write: Write, section: Section, wrong: str, right: str
) -> None:
    write(tmp_path)
    refused(compute, section, rf"has no parameter '{wrong}'; did you mean '{right}'\?")


@pytest.mark.parametrize(("write", "section", "message", "asked"), WRONG.values(), ids=WRONG)
def test_what_a_refusal_asks_for_works(
    tmp_path: Path, compute: Callable[[Section], Result], write: Write, section: Section, message: str, asked: Section
) -> None:
    write(tmp_path)
    refused(compute, section, message)
    mended = {name: value for name, value in {**section, **asked}.items() if value is not None}
    assert compute(mended).response is not None
