"""A miscounted period is noticed; noise, drift, hum and multiples of the period are not taken for one."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.data.signals import Signals
from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.repeats import check_repeats, common_lines, detect_period
from tests.examples import some

RATE = 1000.0
DISTURBANCES = ("white", "walk", "ramp", "decay", "hum")


def multisine(rng: np.random.Generator, period: int, blocks: int) -> np.ndarray:
    """A few to many lines in random phase, rms 1."""
    lines = np.arange(1, max(3, int(period * rng.choice([0.02, 0.1, 0.4]))))
    angle = 2 * np.pi * np.outer(np.arange(period), lines) / period + rng.uniform(0, 2 * np.pi, lines.size)
    wave = np.cos(angle).sum(axis=1)
    return np.tile(wave / wave.std(), blocks)


def disturbance(rng: np.random.Generator, kind: str, size: int) -> np.ndarray:
    n = np.arange(size)
    made = {
        "white": rng.normal(size=size),
        "walk": np.cumsum(rng.normal(size=size)),
        "ramp": n - size / 2.0,
        "decay": np.exp(-n / (0.1 * size)),
        "hum": np.cos(2 * np.pi * rng.uniform(0.003, 0.3) * n),
    }[kind]
    return np.asarray(made / made.std())


def test_lines_that_friction_adds_at_one_amplitude_are_left_out() -> None:
    cuts = [Cut(0, 2, 100, 1, 1e-3, lines) for lines in ((1, 3, 5, 7), tuple(range(1, 30)))]
    assert {cut.lines for cut in common_lines(cuts)} == {(1, 3, 5, 7)}


@pytest.mark.parametrize("kind", some(DISTURBANCES, "walk", "hum"))
def test_good_records_are_never_refused(kind: str) -> None:
    rng = np.random.default_rng(11)
    for _ in range(150):
        period, blocks, times = int(rng.integers(20, 400)), int(rng.integers(6, 16)), int(rng.integers(1, 4))
        level = rng.choice([0.01, 0.05, {"hum": 0.1, "white": 1.0}.get(kind, 0.5)])
        signal = multisine(rng, period, blocks)
        signal += level * disturbance(rng, kind, signal.size)
        cut = Cut(0, blocks // times, period * times, times, 1 / RATE)
        check_repeats(cut, signal, RATE, "u", "record")


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.03])
@pytest.mark.parametrize("off", [-3, -1, 1, 2, 9])
def test_a_miscounted_period_is_refused_with_the_right_one(off: int, noise: float) -> None:
    rng = np.random.default_rng(12)
    period, blocks = 2000, 6
    time = np.arange(period * blocks)
    signal = sum(np.cos(2 * np.pi * line * time / period + line**2) for line in range(1, 60)) / np.sqrt(30)
    signal = signal + noise * rng.normal(size=time.size)
    cut = Cut(0, time.size // (period + off), period + off, 1, 1 / RATE)
    hint = r"seems to repeat every 2000 samples \(2 s\): give samples_per_period = 2000"
    with pytest.raises(RecordError, match=hint) as caught:
        check_repeats(cut, signal, RATE, "u", "record")
    assert "\n" not in str(caught.value)
    assert detect_period(signal) == period


@pytest.mark.parametrize("heading", ["latency [ms]", "time", "pressure [bar]"])
def test_a_column_that_is_not_evidently_the_time_is_no_clock(
    tmp_path: Path, signals_of: Callable[..., Signals], bench: Any, heading: str
) -> None:
    rows = bench.rows(4)
    if heading != "time":
        rows[:, 0] = np.random.default_rng(6).uniform(1, 2, len(rows))
    bench.write(tmp_path / "bench.csv", rows, f"{heading},iq (A),Position [mm]")
    assert signals_of(time_column=None, sample_rate=500).segments[0].sample_time == 1 / 500


@pytest.mark.parametrize(
    ("pattern", "remedy"),
    [
        ("aaaabbbb", r"from period 5 on; .* follow one another, give periods_per_realisation = 4 \(--periods 4\)"),
        ("baaaaaaa", r"from period 2 on; if it was still settling, give skip_periods = 1 \(--skip-periods 1\)"),
        ("aaaaabbbbbbcccc", r"from period 6 on; cut the record there, or use segment"),
    ],
)
def test_another_signal_within_a_record_is_told(pattern: str, remedy: str) -> None:
    rng = np.random.default_rng(7)
    periods = {name: rng.normal(size=200) for name in "abc"}
    channel = np.concatenate([periods[name] for name in pattern])
    with pytest.raises(RecordError, match=remedy):
        check_repeats(Cut(0, len(pattern), 200, 1, 1e-3), channel, 1e3, "u", "a.csv")


@pytest.mark.parametrize("blocks", [1.9999, 2, 2.3, 3, 6, 10.7])
@pytest.mark.parametrize("lines", [(1,), (1, 2, 3), (3, 5, 40)])
def test_the_period_of_a_smooth_record_is_found_to_the_sample(blocks: float, lines: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    for phases in rng.uniform(0, 2 * np.pi, (5, len(lines))):
        angle = 2 * np.pi * np.outer(np.arange(round(10_000 * blocks)), lines) / 10_000 + phases
        assert detect_period(np.cos(angle).sum(axis=1)) == 10_000


def test_a_record_that_lacks_the_end_of_its_second_period_is_not_taken_for_two_shorter_ones() -> None:
    channel = np.cos(2 * np.pi * np.outer(np.arange(19_999), (1, 2, 5)) / 10_000 + [0.3, 2.0, 4.0]).sum(axis=1)
    with pytest.raises(RecordError, match=r"every 10000 samples \(10 s\), and ends 1 before 2 periods do: record for"):
        check_repeats(Cut(0, 2, 9999, 1, 1 / RATE), channel, RATE, "u", "record")
