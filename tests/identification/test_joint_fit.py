"""The likelihood of rounded samples, and the linear step that maximises it for all records jointly."""

import numpy as np
import pytest
from fraexp_plugins.identification._likelihood import LinearRecord, fit_linear, interval_loss
from scipy.optimize import minimize
from scipy.stats import norm


@pytest.mark.parametrize(("resolution", "std"), [(1.0, 0.3), (1.0, 0.03), (1.0, 5.0), (0.0, 0.7)])
def test_the_loss_is_that_of_a_rounded_normal_variable(resolution, std):
    residual = np.linspace(-1.5, 1.5, 61)
    loss = interval_loss(residual, resolution, std)
    if resolution:
        # the survival function is exact where the distribution function rounds to 1
        far = np.abs(residual)
        expected = norm.sf((far - resolution / 2) / std) - norm.sf((far + resolution / 2) / std)
        known = expected > 1e-290
        np.testing.assert_allclose(np.exp(-loss.value)[known], expected[known], rtol=1e-9)
    else:
        np.testing.assert_allclose(loss.value, residual**2 / (2 * std**2))
    step = 1e-5
    after, before = (interval_loss(residual + sign * step, resolution, std) for sign in (1, -1))
    scale = np.abs(loss.slope).max()
    np.testing.assert_allclose(loss.slope, (after.value - before.value) / (2 * step), rtol=1e-5, atol=1e-6 * scale)
    rise = (after.slope - before.slope) / (2 * step)
    np.testing.assert_allclose(loss.curvature, rise, rtol=1e-4, atol=1e-5 * np.abs(rise).max())


def test_the_joint_step_is_that_of_a_minimiser_that_knows_no_blocks():
    random = np.random.default_rng(3)
    records = [LinearRecord(random.normal(0, 2, 40), random.normal(0, 1, (40, 5)), 1.0, 0.4) for _ in range(3)]
    radii = np.full(2, 5.0), [np.full(3, 5.0)] * 3

    def loss(values):
        shared, own = values[:2], values[2:].reshape(3, 3)
        total = 0.5 * np.sum(values**2) / 25
        for record, each in zip(records, own, strict=True):
            residual = record.residual - record.jacobian @ np.concatenate([shared, each])
            total += interval_loss(residual, record.resolution, record.std).value.sum()
        return total

    expected = minimize(loss, np.zeros(11), method="BFGS", options={"gtol": 1e-7})
    step = fit_linear(records, *radii)
    np.testing.assert_allclose(np.concatenate([step.shared, *step.own]), expected.x, atol=2e-6)
    assert step.gain == pytest.approx(loss(np.zeros(11)) - expected.fun, rel=1e-9)
    h, unit = 1e-3, np.eye(11)
    corners = [
        [[loss(expected.x + s * h * (a + t * b)) * t for s in (1, -1) for t in (1, -1)] for a in unit] for b in unit
    ]
    covariance = np.linalg.inv(np.sum(corners, axis=2) / (4 * h**2))
    np.testing.assert_allclose(step.covariances[1][:2, :2], covariance[:2, :2], rtol=0.01)
    held = np.array([0.2, -0.1])
    beside = minimize(lambda own: loss(np.append(held, own)), np.zeros(9), method="BFGS", options={"gtol": 1e-7})
    step = fit_linear(records, *radii, held)
    np.testing.assert_array_equal(step.shared, held)
    np.testing.assert_allclose(np.concatenate(step.own), beside.x, atol=2e-6)
