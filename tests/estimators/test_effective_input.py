"""The proposed method with other estimators behind its observer: û_e as a channel."""

from dataclasses import replace

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.effective_input_observer import is_from_rest
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.drift import Drift
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.estimators.local_polynomial import LocalPolynomial
from fraexp_plugins.excitations.multisine import Multisine

from fraexp.errors import ParameterError
from tests.machines import TABLE, excited, guide, simulated
from tests.refusals import refused

DELAYS = {"input_dead_time": 1e-3}


def multisine(rms, **changes):
    """Return the signals of a multisine on the paper's machine."""
    excitation = Multisine(
        rms=rms, min_frequency=1, max_frequency=200, line_spacing=0.5, points=60, detection_group_size=0, **changes
    )
    return excited(excitation, guide(), steps=10)


def error(response):
    return np.abs(response.response / TABLE.response(2 * np.pi * response.frequency) - 1)


@pytest.mark.parametrize(
    "delays", [{}, {"output_dead_time": 0.3e-3, "output_time_constants": (2e-4,), "input_time_constants": (1e-4,)}]
)
def test_the_channel_holds_the_phasors_of_the_plain_path(delays):
    """Time domain and phasors are two ways to the same û_e, at the excited lines to rounding."""
    signals = simulated(guide(), (4.0, 23.0, 61.0), 12.0, **delays)
    given = {"friction": guide(), **DELAYS, **delays}
    plain = EffectiveInput(**given).estimate(signals).response
    nested = EffectiveInput(**given, method=Conventional(refer_to_plant=True)).estimate(signals).response
    assert nested.input == plain.input == "u_e"
    assert np.max(np.abs(nested.response / plain.response - 1)) < 1e-9


def test_the_best_linear_approximation_of_the_effective_input_is_the_plant():
    signals = multisine(40.0, realisations=2, recorded_periods=2)
    bare = BestLinearApproximation(refer_to_plant=True, **DELAYS).estimate(signals).response
    seen = EffectiveInput(friction=guide(), **DELAYS, method=BestLinearApproximation()).estimate(signals).response
    assert np.median(error(bare)) > 0.1
    assert np.max(error(seen)) < 5e-3
    assert np.median(error(seen)) < 2e-4


def test_a_record_from_rest_needs_no_settling():
    """The transient is in û_e and y' alike: the local polynomial method takes it off, the friction model follows it."""
    signals = multisine(40.0, recorded_periods=4, transient=True)
    estimator = EffectiveInput(friction=guide(), **DELAYS, method=LocalPolynomial())
    assert is_from_rest(signals.segments[0])
    assert np.max(error(estimator.estimate(signals).response)) < 5e-3
    assert np.median(error(estimator.estimate(signals).response)) < 3e-4


def test_the_force_along_a_record_from_rest_is_that_of_the_loop():
    """A Fourier series of the record as it is would ring at both ends and turn the friction model about."""
    segment = multisine(40.0, recorded_periods=1, transient=True).segments[0]
    friction = guide(viscous=0.0)
    estimator = EffectiveInput(friction=friction, oversampling=4)
    true = friction.force(segment.channels["displacement"].ravel(), 500e-6)
    along, wrapped = (estimator._forces([one])[0].ravel()[::4] for one in (segment, replace(segment, settling=None)))
    assert np.max(np.abs(along - true)[:20]) < 0.05
    assert np.max(np.abs(wrapped - true)[:20]) > 5.0


def test_what_cannot_take_the_effective_input_is_refused():
    with refused(ParameterError, "effective_input.method", "drift", "'input'"):
        EffectiveInput(friction=guide(), method=Drift())
    with refused(ParameterError, "effective_input.method"):
        EffectiveInput(friction=guide(), method=EffectiveInput(friction=guide()))


def test_a_study_names_the_method_as_a_table(registry):
    spec = {"name": "effective_input", "friction": guide().spec(), "method": {"name": "conventional"}}
    estimator = registry.create("estimator", spec, {"loop": {"input_dead_time": 1e-3}})
    assert estimator.method == Conventional(input_dead_time=1e-3)
    assert registry.create("estimator", estimator.spec()) == estimator


@pytest.mark.parametrize("dead_time", [1e-3, 1.3e-3])
def test_images_of_the_hold_do_not_drive_the_friction_model(dead_time):
    """Friction takes 99.9 % of 1 N at 2 Hz: an image of 3e-6 of y' made the plant 0.28 % wrong."""
    loop = {"sample_time": 1e-3, "input_dead_time": dead_time}
    signals = simulated(guide(), (2.0, 4.0, 10.0, 100.0, 150.0, 200.0), 1.0, steps=60, tolerance=1e-9, **loop)
    method = EffectiveInput(friction=guide(), input_dead_time=dead_time, oversampling=32)
    kept = method.model_copy(update={"interpolation_tolerance": 1.0})
    with_images, without = (error(each.estimate(signals).response) for each in (kept, method))
    assert np.all(without[:4] < 2e-4)
    assert np.all(without < 0.6 * with_images)
    if dead_time > 1e-3:
        assert with_images[0] > 2e-3


def test_images_too_small_to_matter_are_left():
    signals = simulated(guide(), (2.0, 20.0), 75.0)
    method = EffectiveInput(friction=guide(), **DELAYS, oversampling=4)
    assert not method._images_that_matter(signals, method._estimate_along(method._contact_forces(signals)))
