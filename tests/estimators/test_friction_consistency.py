"""A wrong friction model of the proposed method: the harmonics of the motion contradict it, and the sweep is not ok."""

import numpy as np
import pytest
from fraexp_plugins.estimators.effective_input import EffectiveInput

from fraexp.data.results import Outcome
from tests.machines import TABLE, decibel, guide, simulated

DELAYS = {"input_dead_time": 1e-3}
FREQUENCIES = tuple(np.geomspace(2.0, 100.0, 24))


@pytest.fixture(scope="module")
def signals():
    """Return a record at 12 N by an encoder of 0.1 µm."""
    return simulated(guide(), FREQUENCIES, 12.0, resolution=1e-7, tolerance=1e-4)


def estimated(signals, **changes):
    given = {"friction": guide(), "resolution": 1e-7, "oversampling": 8, **DELAYS, **changes}
    return EffectiveInput(**given).estimate(signals)


@pytest.mark.parametrize(
    "changes", [{"force_scale": 1.05}, {"force_scale": 0.95}, {"displacement_scale": 1.05}, {"friction": guide(18.8)}]
)
def test_a_model_five_percent_wrong_is_not_ok(signals, changes):
    """It was ok, and 20 dB off at 2 Hz."""
    found = estimated(signals, **changes)
    error = np.abs(decibel(found.response.response / TABLE.response(2 * np.pi * found.response.frequency)))
    assert error.max() > 10
    assert found.outcome is Outcome.INACCURATE
    assert "contradict the friction model" in found.message
    assert "maximum_likelihood" in found.message


def test_the_right_model_is_not_contradicted(signals):
    assert "contradict" not in estimated(signals).message


def test_a_stated_uncertainty_of_the_model_is_in_the_band(signals):
    assert estimated(signals, force_scale=1.05, force_std=0.05).outcome is Outcome.OK


def test_a_wrong_delay_is_not_ok_either(signals):
    """A sample of dead time too little turns the input at the harmonics, and the plant at the fundamentals less."""
    assert "or the delays" in estimated(signals, input_dead_time=0.0).message


@pytest.mark.parametrize("spacing", [1.6, 3.0])
def test_frequencies_far_apart_tell_nothing(spacing):
    """Between them may be a mode: what the harmonics should do is unknown."""
    sparse = tuple(2.0 * spacing ** np.arange(int(np.log(50) / np.log(spacing))))
    record = simulated(guide(), sparse, 40.0, tolerance=1e-4)
    assert estimated(record, resolution=0.0, force_scale=1.05).outcome is Outcome.OK


@pytest.mark.parametrize(("scale", "is_said"), [(1.0, False), (1.05, True)])
def test_a_mode_between_two_frequencies_is_no_contradiction(scale, is_said):
    """At 75 Hz, below the mode at 80 Hz, the plant between 63 and 84 Hz was off by 3.6; the right model was blamed."""
    record = simulated(guide(), tuple(np.geomspace(2.0, 150.0, 16)), 12.0, resolution=1e-7, tolerance=1e-4)
    assert ("contradict" in estimated(record, force_scale=scale).message) is is_said
