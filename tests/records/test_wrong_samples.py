"""A sample that stands far outside is questioned; what machines do is not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fraexp.data.signals import Segment
from fraexp.records.wrong_samples import wrong_sample_questions

PERIODS, SAMPLES = 8, 500
ANGLE = 2 * np.pi * np.arange(PERIODS * SAMPLES) / SAMPLES
NOISE = np.random.default_rng(1).normal(size=ANGLE.size)
SETTLING = np.exp(-np.arange(ANGLE.size) / SAMPLES)


def questions(y: NDArray[np.float64], periods: int = PERIODS, periodic: bool = True) -> str:
    segment = Segment(1e-3, {"y": y.reshape(periods, -1)}, np.array([1]), periodic=periodic)
    return wrong_sample_questions([segment], {"y": "m"}).text


def with_spike(value: float, *where: int) -> NDArray[np.float64]:
    y = 3e-4 * np.sin(ANGLE)
    y[list(where)] = value
    return y


@pytest.mark.parametrize("value", [1e-3, -1e-3, 0.1])
@pytest.mark.parametrize("where", [0, 1234, ANGLE.size - 1])
def test_a_spike_is_questioned_at_its_place(value: float, where: int) -> None:
    said = questions(with_spike(value, where))
    period, sample = divmod(where, SAMPLES)
    assert said.startswith(f"'y' is {value:.3g} m at sample {sample + 1} of period {period + 1}, and between -0.0003")
    assert "1 wrong sample?" in said


def test_several_are_counted_and_channels_of_all_segments_too() -> None:
    assert "3 wrong samples?" in questions(with_spike(1.0, 10, 11, 2000))
    wrong = Segment(1e-3, {"y": with_spike(1.0, 5).reshape(PERIODS, -1)}, np.array([1]))
    assert wrong_sample_questions([wrong, wrong], {"y": "m"}).text.endswith("; and 1 more channels or segments")


@pytest.mark.parametrize(
    "y",
    [
        np.sin(ANGLE),
        np.sign(np.sin(ANGLE + 1e-3)),
        NOISE,
        np.sin(ANGLE) + 0.2 * NOISE,
        np.sin(ANGLE) + 5 * SETTLING,
        np.sin(ANGLE) + 0.02 * ANGLE,
        np.round(np.sin(ANGLE)),
        np.zeros(ANGLE.size),
    ],
    ids=["sine", "square", "noise", "noisy", "settling", "drift", "coarse", "still"],
)
def test_what_machines_do_is_not_questioned(y: NDArray[np.float64]) -> None:
    assert questions(y) == ""


def test_two_periods_or_none_do_not_tell() -> None:
    assert questions(with_spike(1.0, 7), periods=2) == ""
    assert questions(with_spike(1.0, 7), periodic=False) == ""


@pytest.mark.parametrize(("value", "do_harm"), [(6e-4, False), (0.1, True)])
def test_what_hardly_changes_a_response_does_no_harm(value: float, do_harm: bool) -> None:
    segment = Segment(1e-3, {"y": with_spike(value, 1234).reshape(PERIODS, -1)}, np.array([1]))
    found = wrong_sample_questions([segment], {"y": "m"})
    assert found.text
    assert found.do_harm is do_harm
    without = np.fft.fft(3e-4 * np.sin(ANGLE).reshape(PERIODS, -1).mean(axis=0))[1]
    change = float(abs(np.fft.fft(segment.channels["y"].mean(axis=0))[1] / without - 1))
    assert (change > 0.01) is do_harm
