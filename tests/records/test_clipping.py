"""A motion that a recorder clips is told; coarse encoders, sticking machines, square waves and commands are not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fraexp.data.signals import Segment
from fraexp.records.wrong_samples import wrong_sample_questions

PERIODS, SAMPLES = 6, 1000
LINES = np.arange(1, 40, 3)
TIME = np.arange(PERIODS * SAMPLES) / SAMPLES
NOISE = np.random.default_rng(8).normal(size=TIME.size)
WAVE = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES)
SINE = np.sin(2 * np.pi * TIME)
STICKING = np.cumsum(np.sign(SINE) * np.maximum(np.abs(SINE) - 0.5, 0)) / 100
"""It stands still for a third of the time, at both reversals."""
FLATTER = ("3 % flatter", "6 % flatter", "10 % flatter")


def flat_wave(line: int, flatter: float) -> NDArray[np.float64]:
    """Return a sine with a third harmonic that flattens its tops, as friction does."""
    return np.cos(2 * np.pi * line * TIME) - flatter * np.cos(6 * np.pi * line * TIME)


def questions(y: NDArray[np.float64], name: str = "y", unit: str = "rad") -> str:
    return wrong_sample_questions([Segment(1e-3, {name: y.reshape(PERIODS, -1)}, LINES)], {name: unit}).text


@pytest.mark.parametrize("level", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("step", [1e-9, 1e-3, 0.005])
def test_a_clipped_motion_is_questioned(level: float, step: float) -> None:
    top = level * np.abs(WAVE).max()
    y = np.clip(np.round(WAVE / step) * step + 1e-9 * NOISE, -top, top)
    said = questions(y)
    assert f"{top:.3g} rad, " in said
    assert "is it clipped? record with a larger range" in said
    assert said.startswith("'y' stands at ")
    assert " of its range, for " in said
    assert questions(y, unit="N") == ""
    assert questions(y, name="u") == ""


@pytest.mark.parametrize("lower", [-np.inf, -0.6])
def test_one_limit_is_enough(lower: float) -> None:
    assert ("stands at -0.6 and 0.5" if lower == -0.6 else "stands at 0.5") in questions(
        np.clip(SINE + 1e-6 * NOISE, lower, 0.5)
    )


@pytest.mark.parametrize("level", [0.5, 0.9, 0.97, 0.99])
def test_a_wave_that_is_clipped_near_its_top_is_questioned(level: float) -> None:
    """It slows down before, but is as fast as many changes from step to step when it stops."""
    flat = flat_wave(1, 0.08)
    assert "is it clipped" in questions(np.clip(np.round(flat, 5), -np.inf, level * flat.max()))


@pytest.mark.parametrize(
    "y",
    [
        WAVE,
        SINE,
        np.round(SINE, 2),
        np.round(SINE, 1),
        np.round(WAVE + 0.01 * NOISE, 2),
        np.sign(SINE) + 0.01 * NOISE,
        np.sign(np.sin(2 * np.pi * TIME + 0.1)),
        np.clip(3 * SINE + 0.0 * NOISE, -1, 1),
        np.round(STICKING, 3),
        np.round(np.abs(np.mod(2 * TIME, 2) - 1), 2),
        np.round(50 * flat_wave(35, 0.03)) / 50,
        np.round(45 * flat_wave(38, 0.06)) / 45,
        np.round(45 * flat_wave(43, 0.1)) / 45,
    ],
    ids=["wave", "sine", "fine", "coarse", "noisy", "levels", "square", "relay", "sticking", "triangle", *FLATTER],
)
def test_what_machines_do_is_not_clipped(y: NDArray[np.float64]) -> None:
    assert "clipped" not in questions(y)
