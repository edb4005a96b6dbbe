"""The stop operator, all samples at once, is the one that goes step by step."""

import numpy as np
import pytest
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.stop_operator import stop_operators, threshold_sensitivity, turning_points

THRESHOLDS = np.geomspace(0.3, 60, 20)


@pytest.fixture
def walk():
    """A random walk with rests in it."""
    rng = np.random.default_rng(1)
    steps = rng.normal(size=2000)
    steps[rng.random(2000) < 0.2] = 0
    return np.cumsum(steps)


def test_deflections_are_those_of_the_rolling_model(walk):
    found = stop_operators(walk, THRESHOLDS)
    for column, threshold in zip(found.T, THRESHOLDS, strict=True):
        element = Rolling(stiffness=(1.0,), limit_force=(float(threshold),))
        assert np.abs(column - element.force(walk, 1.0)).max() < 1e-12


def test_the_sensitivity_is_the_difference_quotient(walk):
    found = threshold_sensitivity(stop_operators(walk, THRESHOLDS), THRESHOLDS)
    step = 1e-7
    difference = (stop_operators(walk, THRESHOLDS + step) - stop_operators(walk, THRESHOLDS - step)) / (2 * step)
    assert np.mean(np.abs(found - difference) > 1e-6) < 1e-3  # but where a slip begins within the step


def test_turning_points_leave_small_reversals_out():
    way = np.interp(np.arange(61), [0, 10, 12, 20, 30, 40, 42, 60], [0, 5, 4.5, 9, 0, 6, 5.5, 10])
    assert turning_points(way, 1.0).tolist() == [20, 30]
    assert turning_points(way, 0.1).tolist() == [10, 12, 20, 30, 40, 42]


def test_a_motion_that_does_not_turn_has_no_turning_point():
    assert turning_points(np.arange(5.0), 0.1).size == 0
    assert turning_points(np.zeros(5), 0.1).size == 0
