"""Axes that turn while they are measured are told; square waves, fast sines and small drifts are not."""

import numpy as np
import pytest
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.local_polynomial import LocalPolynomial
from numpy.typing import NDArray

from fraexp.analysis.steady_motion import steady_motion_text
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.records.wrong_samples import wrong_sample_questions

PERIODS, SAMPLES = 6, 1000
LINES = np.arange(1, 40, 3)
TIME = np.arange(PERIODS * SAMPLES) / SAMPLES
NOISE = np.random.default_rng(4).normal(size=TIME.size)
WAVE = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES**2)


def questions(y: NDArray[np.float64], unit: str = "rad", periodic: bool = True) -> str:
    blocks = y.reshape(PERIODS if periodic else 1, -1)
    return wrong_sample_questions([Segment(1e-3, {"y": blocks}, LINES, periodic=periodic)], {"y": unit}).text


def motion(y: NDArray[np.float64]) -> str:
    return steady_motion_text([Segment(1e-3, {"y": y.reshape(PERIODS, -1)}, LINES)], "y", "rad")


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
def test_a_steady_motion_is_told(speed: float) -> None:
    said = motion(0.01 * WAVE + speed * TIME + 1e-6 * NOISE)
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
    assert "wraps" not in questions(y)
    assert motion(y) == ""


def test_estimators_that_take_a_steady_motion_off_are_ok_on_it_and_others_are_not() -> None:
    channels = {"u": WAVE.reshape(PERIODS, -1), "y": (0.01 * WAVE + 0.1 * TIME + 1e-9 * NOISE).reshape(PERIODS, -1)}
    signals = Signals((Segment(1e-3, channels, LINES),), {"u": "N m", "y": "rad"})
    for estimator in (Conventional(), BestLinearApproximation(), LocalPolynomial()):
        found = estimator.estimate(signals)
        is_robust = isinstance(estimator, LocalPolynomial)
        assert found.response is not None
        assert found.outcome is (Outcome.OK if is_robust else Outcome.INACCURATE), found.message
        assert ("gains 0.1 rad each period" in found.message) is not is_robust
        off = float(np.abs(found.response.response / 0.01 - 1).max())
        assert (off < 0.01) is is_robust


def test_a_sawtooth_force_does_not_wrap() -> None:
    assert questions(np.mod(TIME, 1.0), unit="N") == ""
