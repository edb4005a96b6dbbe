"""Axes that turn while they are measured are told; square waves, fast sines and small drifts are not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fraexp.data.signals import Segment
from fraexp.records.wrong_samples import wrong_sample_questions

PERIODS, SAMPLES = 6, 1000
LINES = np.arange(1, 40, 3)
TIME = np.arange(PERIODS * SAMPLES) / SAMPLES
NOISE = np.random.default_rng(4).normal(size=TIME.size)
WAVE = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES**2)


def questions(y: NDArray[np.float64], unit: str = "rad", periodic: bool = True) -> str:
    blocks = y.reshape(PERIODS if periodic else 1, -1)
    return wrong_sample_questions([Segment(1e-3, {"y": blocks}, LINES, periodic=periodic)], {"y": unit})


@pytest.mark.parametrize("modulus", [2 * np.pi, 1.0, 65536 / 10430.378])
@pytest.mark.parametrize("speed", [0.0, 0.6, -3.0])
@pytest.mark.parametrize("periodic", [True, False])
def test_an_angle_that_wraps_is_questioned(modulus: float, speed: float, periodic: bool) -> None:
    angle = np.mod(0.2 * WAVE + modulus * speed * TIME + 1e-5 * NOISE, modulus)
    said = questions(angle, periodic=periodic)
    assert "jumps by nearly its whole range" in said
    assert "unwrap the column before the import" in said
    assert questions(np.unwrap(angle, period=modulus), periodic=periodic).count("wraps") == 0


def test_one_wrap_of_a_whole_turn_is_enough() -> None:
    angle = 0.2 * WAVE + TIME + 1
    assert "once, after sample" in questions(np.mod(angle, 2 * np.pi))
    assert "wraps" not in questions(np.mod(angle, 4.0))


@pytest.mark.parametrize("speed", [0.1, -6.0])
def test_a_steady_motion_is_questioned(speed: float) -> None:
    said = questions(0.01 * WAVE + speed * TIME + 1e-6 * NOISE)
    assert said.startswith(f"'y' gains {speed:.3g} rad each period and does not repeat")
    assert "at 13 of 13 frequencies; --estimator local_polynomial removes" in said


@pytest.mark.parametrize(
    "y",
    [
        WAVE,
        WAVE + 1e-4 * TIME,
        WAVE + np.cumsum(NOISE) * 1e-4,
        WAVE + np.exp(-2 * TIME),
        np.sign(np.sin(2 * np.pi * TIME + 1e-3)) + 0.02 * NOISE,
        np.sin(2 * np.pi * TIME * SAMPLES / 3),
        np.where(np.abs(NOISE) > 3.2, -99.0, WAVE),
    ],
    ids=["wave", "drift", "walk", "settling", "square", "fast", "lost"],
)
def test_what_machines_do_is_neither_wrap_nor_motion(y: NDArray[np.float64]) -> None:
    said = questions(y)
    assert "wraps" not in said
    assert "each period" not in said


def test_a_sawtooth_force_does_not_wrap() -> None:
    assert questions(np.mod(TIME, 1.0), unit="N") == ""
