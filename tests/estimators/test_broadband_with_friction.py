"""Broadband estimators on the machine with rolling friction and a noisy scale."""

from dataclasses import replace
from functools import cache

import numpy as np
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.estimators.fast_best_linear_approximation import FastBestLinearApproximation
from fraexp_plugins.estimators.joint_input_output import JointInputOutput
from fraexp_plugins.excitations.multisine import Multisine

from fraexp.analysis.confidence import circle_factor
from fraexp.data.results import FrequencyResponse
from fraexp.data.signals import Signals
from tests.machines import TABLE, decibel, excited, guide

DELAYS = {"input_dead_time": 1e-3}
SCALE = {"noise": 30e-9, "resolution": 0.1e-6}


@cache
def recorded() -> Signals:
    """Return 40 realisations of an odd multisine of 12 N."""
    excitation = Multisine(rms=12.0, line_spacing=0.5, realisations=40, recorded_periods=2, settling_tolerance=1e-2)
    return excited(excitation, guide(), **SCALE)


def found(
    estimator: BestLinearApproximation | FastBestLinearApproximation | JointInputOutput | EffectiveInput,
    signals: Signals,
) -> FrequencyResponse:
    response = estimator.estimate(signals).response
    assert response is not None
    return response


def test_neither_realisations_nor_a_reference_take_friction_away_and_the_proposed_method_does() -> None:
    signals = recorded()
    proposed = found(EffectiveInput(friction=guide(), method=BestLinearApproximation(), **DELAYS, **SCALE), signals)
    truth = TABLE.response(2 * np.pi * proposed.frequency)
    low = proposed.frequency < 5
    for estimator in (
        BestLinearApproximation(refer_to_plant=True, **DELAYS),
        JointInputOutput(refer_to_plant=True, **DELAYS),
    ):
        response = found(estimator, signals)
        assert np.max(decibel(response.response / truth)[low]) < -10
        # and its band does not tell so
        assert np.min((np.abs(response.response - truth) / response.standard_deviation)[low]) > 100
    assert np.max(np.abs(decibel(proposed.response / truth))) < 0.1
    assert np.median(proposed.standard_deviation / np.abs(truth)) < 1e-3


def test_joint_estimate_and_best_linear_approximation_are_one_for_equal_amplitudes() -> None:
    best, joint = found(BestLinearApproximation(), recorded()), found(JointInputOutput(), recorded())
    np.testing.assert_allclose(joint.response, best.response, rtol=1e-9)
    np.testing.assert_allclose(joint.covariance, best.covariance, rtol=1e-6)
    np.testing.assert_array_equal(joint.freedom, best.freedom)


def test_the_band_of_a_single_realisation_holds_the_best_linear_approximation_of_all() -> None:
    signals = recorded()
    best = found(BestLinearApproximation(), signals)
    inside, ratio = [], []
    for segment in signals.segments:
        one = found(FastBestLinearApproximation(), replace(signals, segments=(segment,)))
        inside.append(np.abs(one.response - best.response) <= one.standard_deviation * circle_factor(one.freedom))
        ratio.append(one.nonlinear_variance / best.nonlinear_variance)
    assert 0.93 <= np.mean(inside) <= 0.97
    # where the response is half distortion the first order of the band is not enough
    assert np.mean(np.array(inside)[:, best.frequency < 20]) > 0.88
    assert 0.8 < np.median(ratio) < 1.2
