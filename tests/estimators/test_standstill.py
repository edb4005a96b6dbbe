"""The proposed method where friction holds the machine still: it says so, and how far the response may be off."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.standstill import hidden_forces
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.estimators.moving_axis import MovingAxis
from fraexp_plugins.excitations.moving_sine import MovingSine
from fraexp_plugins.excitations.multisine import Multisine
from fraexp_plugins.friction.composite import Composite
from fraexp_plugins.friction.coulomb import Coulomb
from fraexp_plugins.friction.none import Frictionless

from fraexp.analysis.confidence import BandReach
from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from tests.examples import some, thorough
from tests.machines import FRICTIONLESS, TABLE, decibel, excited, guide, simulated, table_models
from tests.responses import judged

COULOMB = Coulomb(coulomb_force=17.9, viscous_coefficient=4.69)
STRIBECK = Coulomb(coulomb_force=15.0, static_force=20.0, viscous_coefficient=4.69)
STOP = COULOMB.model_copy(update={"stiction_displacement": 1e-7})
LOW = (2.0, 2.94, 4.33, 6.37)
DELAYS = {"input_dead_time": 1e-3}


def plant_error(result):
    """Return P over the response found, less 1: what would have to be corrected."""
    return TABLE.response(2 * np.pi * result.response.frequency) / result.response.response - 1


def estimated_error(result):
    """Return the error that a finding states [dB]."""
    return next(each for each in result.findings if each.kind == "hidden by standstill").quantities[0].value


@pytest.mark.parametrize(
    ("friction", "amplitude", "resolution"),
    [
        (COULOMB, 25.0, 1e-7),
        thorough(STOP, 25.0, 0.0),
        thorough(STRIBECK, 40.0, 1e-7),
        thorough(STRIBECK, 75.0, 0.0),
        thorough(COULOMB, 75.0, 1e-7),
    ],
)
def test_a_machine_that_sticks_is_not_ok_and_says_how_far_it_is_off(friction, amplitude, resolution):
    """With P the matched model is 10 dB off where the machine stands for half of the time; nothing else shows it."""
    signals = simulated(friction, LOW, amplitude, resolution=resolution)
    found = judged(EffectiveInput(friction=friction, resolution=resolution, **DELAYS), signals)
    error = np.abs(decibel(1 + plant_error(found)))
    assert found.outcome is Outcome.INACCURATE
    assert error.max() > 0.5
    assert estimated_error(found) == pytest.approx(error.max(), rel=0.5)


def test_an_ideal_encoder_does_not_show_the_force_of_a_set_valued_law():
    """Its stop of a nanometre is numerical; an integral action creeps within it by a picometre."""
    signals = simulated(FRICTIONLESS, LOW, 12.0)
    creeping = [replace(each, channels={**each.channels, "y": 1e-9 * each.channels["y"]}) for each in signals.segments]
    found = judged(EffectiveInput(friction=COULOMB, **DELAYS), replace(signals, segments=tuple(creeping)))
    assert "hidden by standstill" in [each.kind for each in found.findings]
    assert not BandReach.of(found.response).is_within().any()


def test_a_method_behind_the_observer_is_checked_as_the_observer_alone():
    """One is checked with û_e as a channel, the other with its phasors."""
    signals = simulated(COULOMB, LOW, 25.0)
    plain = EffectiveInput(friction=COULOMB, **DELAYS).resolve_oversampling(signals.segments)
    nested = plain.model_copy(update={"method": Conventional(refer_to_plant=True)})
    assert estimated_error(nested.estimate(signals)) == pytest.approx(estimated_error(plain.estimate(signals)))


@pytest.mark.parametrize(
    "delays",
    [
        {"input_dead_time": 1.3e-3, "output_dead_time": 0.4e-3},
        {"input_dead_time": 1e-3, "input_time_constants": (2e-4,)},
        {"output_time_constants": (2e-4,)},
    ],
)
def test_any_delay_is_taken_into_account(delays):
    signals = simulated(COULOMB, LOW, 40.0, **{"input_dead_time": 0.0, **delays})
    found = judged(EffectiveInput(friction=COULOMB, **delays), signals)
    error = np.abs(decibel(1 + plant_error(found)))
    assert found.outcome is Outcome.INACCURATE
    assert estimated_error(found) == pytest.approx(error.max(), rel=0.3)


def test_a_measured_record_is_checked_as_well():
    """A record has input and position alone, and does not say how it settled."""
    signals = simulated(COULOMB, LOW, 25.0)
    segments = tuple(
        replace(segment, channels={key: segment.channels[key] for key in ("u", "y")}, settling=None, lead_in={})
        for segment in signals.segments
    )
    measured = Signals(segments, {"u": "N", "y": "m"})
    results = [judged(EffectiveInput(friction=COULOMB, **DELAYS), each) for each in (signals, measured)]
    assert results[0].outcome is results[1].outcome is Outcome.INACCURATE
    assert estimated_error(results[1]) == pytest.approx(estimated_error(results[0]))


@pytest.mark.thorough
def test_a_part_that_sticks_hides_its_share():
    friction = Composite(parts=(COULOMB.model_copy(update={"coulomb_force": 6.0}), guide(12.0, viscous=0.0)))
    signals = simulated(friction, LOW, 40.0, steps=0)
    found = judged(EffectiveInput(friction=friction, **DELAYS), signals)
    error = np.abs(decibel(1 + plant_error(found)))
    assert found.outcome is Outcome.INACCURATE
    assert error.max() < estimated_error(found) < 3 * error.max()


@pytest.mark.parametrize("name", some(["rolling", "gms", "dahl", "lugre"], "rolling", "lugre"))
def test_friction_that_the_motion_shows_is_ok(registry, name):
    friction = table_models(registry)[name]
    signals = simulated(friction, (5.0, 12.0, 40.0, 150.0), 12.0, resolution=1e-7)
    observer = EffectiveInput(friction=friction, resolution=1e-7, **DELAYS)
    assert "hidden by standstill" not in [each.kind for each in observer.estimate(signals).findings]
    assert not any(hidden_forces(observer, signals.segments))


def test_a_machine_without_friction_is_ok():
    signals = simulated(Frictionless(), (5.0,), 12.0)
    assert judged(EffectiveInput(friction=Frictionless(), **DELAYS), signals).outcome is Outcome.OK


def test_a_multisine_that_sticks_is_not_ok():
    excitation = Multisine(
        rms=25.0, min_frequency=1, max_frequency=100, line_spacing=0.5, points=20, detection_group_size=0,
        realisations=2, settling_timeout=4.0,
    )  # fmt: skip
    signals = excited(excitation, COULOMB, steps=5)
    estimator = EffectiveInput(friction=COULOMB, **DELAYS, method=BestLinearApproximation())
    segments = tuple(replace(each, settling=None) for each in signals.segments)
    found = judged(estimator, replace(signals, segments=segments, outcome=Outcome.OK, findings=()))
    error = np.abs(decibel(1 + plant_error(found)))
    assert found.outcome is Outcome.INACCURATE
    assert 0.3 * error.max() < estimated_error(found) < 3 * error.max()


def test_a_moving_axis_does_not_stick():
    """The axis stands where it turns, which the method leaves out."""
    excitation = MovingSine(
        amplitude=4.0, velocity=0.05, frequencies=(5.0, 20.0), reversal_settling_time=1.0, base_period=4.0
    )
    signals = excited(excitation, COULOMB, steps=5)
    found = judged(EffectiveInput(friction=COULOMB, **DELAYS, method=MovingAxis(reversal_settling_time=1.0)), signals)
    assert found.outcome is Outcome.OK
    assert np.abs(plant_error(found)).max() < 1e-3
