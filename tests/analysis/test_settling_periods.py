"""Records whose periods had not settled are not ok; noise, drift and settled machines are."""

from functools import cache

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from numpy.typing import NDArray

from fraexp.analysis.confidence import BandReach
from fraexp.data.results import Outcome, Result
from fraexp.data.signals import Segment, Signals
from tests.responses import judged

SAMPLE_TIME, SUBSTEPS = 1e-3, 8
FREQUENCIES = (4, 8, 20, 40, 50)


def dahl_axis(force: NDArray[np.float64], position_gain: float) -> NDArray[np.float64]:
    """Return the position of 2 kg with friction of 8 N and a spring, from rest, by small Euler steps."""
    step, x, v, friction = SAMPLE_TIME / SUBSTEPS, 0.0, 0.0, 0.0
    positions = np.empty(force.size)
    for sample, pushed in enumerate(force):
        positions[sample] = x
        for _ in range(SUBSTEPS):
            v += (pushed - friction - 20 * v - position_gain * x) / 2.0 * step
            x += v * step
            friction += 2e5 * (v - abs(v) * friction / 8) * step
    return positions


@cache
def stepped_record(periods: int, skipped: int, noise: float) -> Signals:
    """Return a stepped sine whose steps begin when the frequency changes, less the first periods of each."""
    samples = [round(1 / frequency / SAMPLE_TIME) for frequency in FREQUENCIES]
    force = np.concatenate([12 * np.sin(2 * np.pi * np.arange(periods * n) / n) for n in samples])
    position = dahl_axis(force, 2e4) + noise * np.random.default_rng(periods).normal(size=force.size)
    ends = np.cumsum([0, *(periods * n for n in samples)])
    segments = []
    for start, stop, n in zip(ends, ends[1:], samples, strict=False):
        channels = {"u": force[start:stop], "y": position[start:stop]}
        blocks = {name: values.reshape(periods, n)[skipped:] for name, values in channels.items()}
        segments.append(Segment(SAMPLE_TIME, blocks, np.array([1])))
    return Signals(tuple(segments), {"u": "N", "y": "m"})


def response_of(signals: Signals) -> Result:
    return judged(Conventional(refer_to_plant=False), signals)


@pytest.mark.parametrize("noise", [0.0, 2e-8])
@pytest.mark.parametrize("periods", [4, 6, 15])
def test_steps_that_are_recorded_from_their_beginning_are_right_or_not_ok(periods: int, noise: float) -> None:
    exact = response_of(stepped_record(60, 40, 0.0)).response
    found = response_of(stepped_record(periods, 0, noise))
    assert exact is not None and found.response is not None
    off = np.abs(found.response.response / exact.response - 1)
    assert found.outcome is Outcome.INACCURATE
    assert "the machine was still settling at" in found.message
    assert "leave the first periods out (skip_periods, --skip-periods)" in found.message
    is_ok = BandReach.of(found.response).is_within()
    assert not is_ok.all()
    assert off[is_ok].max(initial=0.0) < 0.05


def test_the_remedy_helps() -> None:
    exact = response_of(stepped_record(60, 40, 0.0)).response
    found = response_of(stepped_record(15, 8, 2e-8))
    assert exact is not None and found.response is not None
    assert (found.outcome, found.message) == (Outcome.OK, "")
    assert np.abs(found.response.response / exact.response - 1).max() < 0.01


def disturbed(kind: str, periods: int, lines: NDArray[np.int64], generator: np.random.Generator) -> Segment:
    """Return a record of a gain of 1 with a disturbance as large as the signal at its lines."""
    time = np.arange(periods * 200)
    wave = np.cos(2 * np.pi * np.outer(time, lines) / 200 + lines**2).sum(axis=1)
    noise = generator.normal(size=time.size)
    disturbance = {
        "white": 3 * noise,
        "walk": 0.3 * np.cumsum(noise),
        "drift": noise + 20 * time / time.size,
        "hum": noise + np.sin(0.0531 * time),
    }[kind]
    channels = {"u": wave, "y": wave + disturbance}
    return Segment(SAMPLE_TIME, {name: values.reshape(periods, -1) for name, values in channels.items()}, lines)


@pytest.mark.parametrize("kind", ["white", "walk", "drift", "hum"])
@pytest.mark.parametrize("periods", [3, 6, 20])
def test_noise_is_not_taken_for_a_transient(kind: str, periods: int) -> None:
    alarms, generator = 0, np.random.default_rng([periods, len(kind)])
    for _ in range(14):
        steps = tuple(disturbed(kind, periods, np.array([line]), generator) for line in range(1, 21))
        multisine = (disturbed(kind, periods, np.arange(1, 60, 2), generator),)
        alarms += sum(
            "settling" in response_of(Signals(parts, {"u": "N", "y": "m"})).message for parts in (steps, multisine)
        )
    assert alarms <= 1


def test_two_periods_do_not_tell_a_transient_from_noise() -> None:
    assert "settling" not in response_of(stepped_record(2, 0, 0.0)).message
