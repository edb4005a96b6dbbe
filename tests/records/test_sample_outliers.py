"""Samples that only one period has are told, however many periods have some; what does not quite repeat is not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fraexp.data.signals import Segment
from fraexp.records.wrong_samples import wrong_sample_questions

PERIODS, SAMPLES = 6, 1000
LINES = np.arange(1, 40, 3)
COUNT = np.arange(PERIODS * SAMPLES)
TIME = COUNT / SAMPLES
RNG = np.random.default_rng(6)
NOISE = RNG.normal(size=COUNT.size)
WAVE = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES)
SQUARE = np.sign(np.sin(2 * np.pi * TIME * (1 + 3e-4) + 0.3))
HIDDEN = slice(40, None, 497)
"""Twelve samples, two in each period."""


def questions(y: NDArray[np.float64], periods: int = PERIODS) -> str:
    return wrong_sample_questions([Segment(1e-3, {"y": y.reshape(periods, -1)}, LINES)], {"y": "N"}).text


def replaced(where: slice, value: float, noise: float = 1e-3) -> NDArray[np.float64]:
    y = WAVE + noise * NOISE
    y[where] = value
    return y


@pytest.mark.parametrize("value", [-9999.0, 5.0])
@pytest.mark.parametrize("noise", [1e-6, 1e-2])
def test_outliers_of_all_periods_do_not_hide_one_another(value: float, noise: float) -> None:
    said = questions(replaced(HIDDEN, value, noise))
    assert said.startswith(f"'y' is {value:g} N" if value > 0 else "'y' is -1e+04 N")
    assert "there in the others: 12 wrong samples? interpolate them before the import" in said


def test_zeros_within_the_range_are_outliers() -> None:
    assert "wrong samples? interpolate" in questions(replaced(HIDDEN, 0.0))


@pytest.mark.parametrize(("start", "length"), [(2300, 120), (3500, 700), (2500, 1500), (200, 300), (5800, 200)])
def test_a_frozen_signal_is_questioned(start: int, length: int) -> None:
    said = questions(replaced(slice(start, start + length), WAVE[start]))
    assert f" for {length * 1e-3:.3g} s from sample {start % SAMPLES + 1} of period {start // SAMPLES + 1} on" in said


@pytest.mark.parametrize(
    "y",
    [
        WAVE,
        WAVE + 0.3 * NOISE,
        WAVE + 4 * np.exp(-2 * TIME),
        np.where(TIME < 0.2, 0.0, WAVE),
        WAVE + np.cumsum(NOISE) * 0.005,
        SQUARE,
        SQUARE + 0.01 * NOISE,
        np.round(WAVE + 0.1 * NOISE),
        np.round(2 * np.sin(2 * np.pi * TIME) + 0.02 * NOISE),
        np.clip(WAVE, -0.5, 0.5),
        np.where(np.sin(2 * np.pi * TIME + 0.01 * np.cumsum(NOISE) / 10) > 0.9, 1.0, 0.0),
        np.zeros(COUNT.size),
    ],
    ids=[
        "wave",
        "noisy",
        "settling",
        "from rest",
        "walk",
        "square",
        "noisy square",
        "coarse",
        "coarse sine",
        "flat",
        "pulse",
        "still",
    ],
)
def test_what_does_not_quite_repeat_is_not_questioned(y: NDArray[np.float64]) -> None:
    assert questions(y) == ""


@pytest.mark.parametrize("mass", [1e-4, 1e-2])
@pytest.mark.parametrize("step", [1e-9, 2e-3])
def test_a_machine_that_starts_from_rest_and_sticks_is_not_questioned(mass: float, step: float) -> None:
    """A mass on a spring with Coulomb friction, integrated by small steps."""
    fine, samples = 10, 200
    angle = 2 * np.pi * np.arange(PERIODS * samples * fine) / (samples * fine)
    lines = np.arange(1, 6)
    force = np.cos(np.outer(angle, lines) + 1.3 * lines**2).sum(axis=1) / 3
    x, v, dt = 0.0, 0.0, 1 / (samples * fine)
    positions = []
    for drive in force:
        pull = drive - 30 * x - 1e-3 * v
        if v or abs(pull) > 0.5:
            after = v + dt * (pull - 0.5 * np.sign(v or pull)) / mass
            v = after if after * v >= 0 else 0.0
        x += dt * v
        positions.append(x)
    y = np.round(np.array(positions[::fine]) / np.ptp(positions) / step) * step
    assert wrong_sample_questions([Segment(5e-3, {"y": y.reshape(PERIODS, -1)}, lines)], {"y": "m"}).text == ""
