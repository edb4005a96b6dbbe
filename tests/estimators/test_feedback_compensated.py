"""Friction compensation by feedback during the experiment, after the paper's description of its reference [10]."""

import numpy as np
import pytest
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.estimators.feedback_compensated import FeedbackCompensated
from fraexp_plugins.excitations.stepped_sine import SteppedSine

from fraexp.analysis.delays import hold_response, path_response
from fraexp.analysis.fourier import phasors
from fraexp.data.results import Outcome
from fraexp.errors import ParameterError, RecordError
from fraexp.simulation.experiments import Compensation
from fraexp.simulation.loop import simulate_loop
from fraexp.simulation.machine import ControlLoop, Machine, Numerics
from tests.examples import some
from tests.machines import LEAD, TABLE, cosine, decibel, guide, harmonic, simulated
from tests.refusals import refused

DELAYS = {"input_dead_time": 1e-3}
ABOVE = (30.0, 39.0, 60.0, 80.0, 110.0, 150.0)
VISCOUS = 4.69


def compensated(gain, frequencies=ABOVE, amplitude=12.0, **loop):
    machine = Machine(
        TABLE, guide(viscous=VISCOUS), LEAD, ControlLoop(sample_time=500e-6, **DELAYS, **loop), Numerics(),
        Compensation(gain=gain, friction=guide(viscous=VISCOUS)),
    )  # fmt: skip
    return simulate_loop(machine, SteppedSine(amplitude=amplitude, frequencies=frequencies), lambda _: None)


def law(response, gain, describing):
    """Return P/(1 + P(N - α N̂ G)): the compensation reaches the plant after dead time and hold."""
    omega = 2 * np.pi * response.frequency
    plant = TABLE.response(omega)
    delay = path_response(omega, DELAYS["input_dead_time"], ()) * hold_response(omega, 500e-6)
    return plant / (1 + plant * (describing - gain * describing * delay))


@pytest.mark.parametrize("amplitude", [12.0, 75.0])
@pytest.mark.parametrize("gain", some([0.0, 0.5, 0.9, 1.0], 0.9))
def test_it_follows_the_closed_form(gain, amplitude):
    """To 0.1 dB with the describing function of a sine of the amplitude that was measured."""
    estimator = FeedbackCompensated(refer_to_plant=True, **DELAYS)
    response = estimator.estimate(compensated(gain, amplitude=amplitude)).response
    describing = [
        harmonic(guide().force(cosine(a, 4000), 1e-4, periodic=True)) / a for a in response.output_amplitude.tolist()
    ]
    omega = 2 * np.pi * response.frequency
    expected = law(response, gain, np.array(describing) + 1j * omega * VISCOUS)
    assert np.max(np.abs(decibel(response.response / expected))) < 0.1


def test_with_the_describing_function_of_the_true_motion_it_does_so_at_all_frequencies():
    """Where the motion is no sine, at the presliding resonance, the first harmonic of the true friction is the N."""
    signals = compensated(0.5, (5.0, 12.0, 20.0, 26.0))
    response = FeedbackCompensated(refer_to_plant=True, **DELAYS).estimate(signals).response
    describing = [phasors(s, "friction")[0, 0] / phasors(s, "displacement")[0, 0] for s in signals.segments]
    assert np.max(np.abs(decibel(response.response / law(response, 0.5, np.array(describing))))) < 0.05


def test_without_gain_it_is_the_conventional_method():
    found = FeedbackCompensated().estimate(compensated(0.0)).response
    conventional = Conventional().estimate(simulated(guide(viscous=VISCOUS), ABOVE, 12.0)).response
    assert np.max(np.abs(found.response / conventional.response - 1)) < 2e-4  # either is within its tolerance, 1e-4


def test_the_observer_needs_no_gain_and_does_not_mind_one():
    for gain in (0.0, 1.0):
        signals = compensated(gain, (5.0, 39.0, 80.0))
        found = EffectiveInput(friction=guide(viscous=VISCOUS), **DELAYS).estimate(signals).response
        truth = TABLE.response(2 * np.pi * found.frequency)
        assert np.max(np.abs(decibel(found.response / truth))) < 0.01


def test_over_compensation_is_an_outcome():
    signals = compensated(3.0, (5.0,), divergence_limit=0.01)
    result = FeedbackCompensated().estimate(signals)
    assert signals.outcome in (Outcome.DIVERGED, Outcome.NOT_SETTLED)
    assert result.outcome is signals.outcome


def test_the_compensating_force_is_reported():
    (metric,) = FeedbackCompensated().estimate(compensated(1.0, (5.0,), 75.0)).metrics
    assert metric.name == "peak compensation"
    assert metric.value == pytest.approx(17.9, abs=2.0)


def test_a_loop_without_compensation_is_refused():
    with refused(RecordError, "[compensation]"):
        FeedbackCompensated().estimate(simulated(guide(), (39.0,), 12.0))


def test_the_observer_refuses_to_take_friction_off_once_more():
    with refused(ParameterError, "effective_input.method", "feedback_compensated"):
        EffectiveInput.parse({"friction": guide(), "method": FeedbackCompensated()}, "effective_input")
