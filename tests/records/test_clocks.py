"""Clocks that are in a record's file though nobody has named them."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.errors import RecordError
from fraexp.records import RecordSettings, resolve
from tests.records.strangers import write_classic


def rate_of(folder: Path, registry: Registry, file: str, **settings: object) -> float:
    channels = {"u": "u [N]", "y": "y [m]"}
    read = RecordSettings.parse({"file": file, "channels": channels, "periodic": False, **settings}, "record")
    return float(resolve(read, folder, registry)[0]["record"]["sample_rate"])


def write(folder: Path, **numbers: float) -> None:
    u, y = np.random.default_rng(1).normal(size=(2, 500))
    write_classic(folder / "moves.mat", {"u": u, "y": y, **numbers})


def test_a_column_with_a_unit_of_time_is_the_clock(tmp_path: Path, registry: Registry) -> None:
    rows = np.column_stack([np.arange(500) / 2.5, *np.random.default_rng(1).normal(size=(2, 500))])
    np.savetxt(tmp_path / "moves.csv", rows, "%.9g", ",", header="Zeit [ms],u,y", comments="")
    assert rate_of(tmp_path, registry, "moves.csv") == pytest.approx(2500)


@pytest.mark.parametrize(
    ("number", "says"),
    [
        ({"fs": 1000.0}, "'fs' in the file says 1000 Hz"),
        ({"Ts": 1e-3}, "'Ts' in the file says 1000 Hz"),
        ({"log": {"SampleRate": 500.0}}, "'log.SampleRate' in the file says 500 Hz"),
    ],
)
def test_a_rate_that_contradicts_a_number_in_the_file_is_refused(
    tmp_path: Path, registry: Registry, number: dict[str, float], says: str
) -> None:
    write(tmp_path, **number)
    with pytest.raises(RecordError, match=f"sample_rate is 2000 Hz, but {says}; correct one"):
        rate_of(tmp_path, registry, "moves.mat", sample_rate=2000)


@pytest.mark.parametrize("number", [{"fs": 2000.0}, {"fs": 2.0}, {"dt": 0.5}, {"rate": 5.0}])
def test_a_rate_that_agrees_in_some_unit_is_taken(tmp_path: Path, registry: Registry, number: dict[str, float]) -> None:
    write(tmp_path, **number)
    assert rate_of(tmp_path, registry, "moves.mat", sample_rate=2000) == 2000


JITTER = (1e-4, 2.4e-4)


def write_stamps(folder: Path, stamps: np.ndarray) -> None:
    rows = np.column_stack([stamps, *np.random.default_rng(1).normal(size=(2, stamps.size))])
    np.savetxt(folder / "moves.csv", rows, "%.9g", ",", header="time [s],u,y", comments="")


@pytest.mark.parametrize("fault", ["lost", "doubled"])
def test_lines_that_are_lost_or_doubled_are_told_though_the_rate_is_stated(
    tmp_path: Path, registry: Registry, fault: str
) -> None:
    stamps, lines = np.arange(9000) / 2000, np.random.default_rng(1).integers(2, 8990, 3)
    write_stamps(tmp_path, np.delete(stamps, lines) if fault == "lost" else np.insert(stamps, lines, stamps[lines]))
    with pytest.raises(
        RecordError, match=f"after sample {lines.min() + (fault == 'doubled')}, .*lost or written twice"
    ):
        rate_of(tmp_path, registry, "moves.csv", sample_rate=2000)


@pytest.mark.parametrize(
    ("stamps", "rate"),
    [
        (np.arange(9000) / 2000, 2000),
        (np.round(np.arange(9000) / 1001, 3), 1001),
        (np.round(np.arange(9000) / 999.7, 3), 999.7),
        *((np.arange(9000) / 2000 + np.random.default_rng(2).uniform(-most, most, 9000), 2000) for most in JITTER),
    ],
    ids=["uniform", "rounded, stamps twice", "rounded, stamps left out", *(f"jitter {most} s" for most in JITTER)],
)
def test_stamps_that_rounding_or_jitter_explains_are_taken(
    tmp_path: Path, registry: Registry, stamps: np.ndarray, rate: float
) -> None:
    write_stamps(tmp_path, stamps)
    assert rate_of(tmp_path, registry, "moves.csv", sample_rate=rate) == rate


def test_the_remedy_for_lost_lines_is_to_resample(tmp_path: Path, registry: Registry) -> None:
    for rate, lines in ((2000, [2000, 2001]), (1000, [4000])):  # a digit of the stamps is half a step, or all of it
        write_stamps(tmp_path, np.delete(np.arange(9000) / rate, lines))
        lost = rf"after sample {lines[0]} .* {len(lines)} of 9000 samples are lost .* resample = \"cubic\""
        for named in ({}, {"time_column": "time [s]"}):
            with pytest.raises(RecordError, match=lost):
                rate_of(tmp_path, registry, "moves.csv", **named)
            assert rate_of(tmp_path, registry, "moves.csv", resample="cubic", **named) == pytest.approx(rate)
