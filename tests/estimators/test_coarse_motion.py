"""Sines of few encoder steps: rounding that repeats is told, or covered; a record shows the step of its encoder."""

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional

from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from tests.responses import judged

STEP = 2e-5


def record(amplitude: float, place: float, noise: float, periods: int = 10) -> Signals:
    """Return a sine of an amplitude [steps] on a gain of one step per newton, at a place within a step."""
    samples = 400
    wave = np.sin(2 * np.pi * np.arange(periods * samples) / samples)
    seen = amplitude * wave + place + noise * np.random.default_rng(8).normal(size=wave.size)
    channels = {"u": wave.reshape(periods, -1), "y": STEP * np.rint(seen).reshape(periods, -1)}
    return Signals((Segment(1e-3, channels, np.array([1])),), {"u": "N", "y": "m"})


@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("amplitude", [0.6, 1.3, 2.2, 5.0, 20.0])
def test_a_response_by_few_steps_is_right_or_not_ok(amplitude: float, place: float) -> None:
    found = judged(Conventional(refer_to_plant=False), record(amplitude, place, 0.0))
    assert found.response is not None
    off = abs(found.response.response[0] / (-1j * amplitude * STEP * 1j) - 1)
    assert found.outcome is Outcome.INACCURATE or off < 0.05
    if amplitude >= 5:
        assert (found.outcome, found.message) == (Outcome.OK, "")
    if amplitude <= 1.3:
        assert [each.kind for each in found.findings] == ["band by noise"]


def test_noise_blurs_the_rounding() -> None:
    found = judged(Conventional(refer_to_plant=False), record(1.3, 0.2, 0.5, 40))
    assert found.response is not None
    assert found.outcome is Outcome.OK
    assert abs(found.response.response[0] / (1.3 * STEP) - 1) < 0.05


def test_a_multisine_that_toggles_an_encoder_is_not_ok() -> None:
    time, lines = np.arange(500), np.array([1, 2, 3, 5, 8, 13])
    wave = np.cos(2 * np.pi * np.outer(time, lines) / 500 + lines**2).sum(axis=1)
    blocks = {"u": np.tile(wave, (6, 1)), "y": np.tile(STEP * np.rint(0.15 * wave + 0.5), (6, 1))}
    found = judged(Conventional(refer_to_plant=False), Signals((Segment(1e-3, blocks, lines),), {"u": "N", "y": "m"}))
    assert found.outcome is Outcome.INACCURATE
    (coarse,) = found.findings
    assert (coarse.kind, len(coarse.frequencies)) == ("band by noise", 6)
    assert coarse.quantities[0].value == np.inf
