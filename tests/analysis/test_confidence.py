"""Bands of 95 %: factors against their distributions, coverage by sampling, and ellipses around 1/G by brute force."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from fraexp.analysis.confidence import (
    circle_factor,
    confidence_limits,
    interval_factor,
    inverse_covariance,
    relative_deviations,
)
from fraexp.data.results import FrequencyResponse
from tests.responses import frequency_response


def response_of(values, covariance, **known) -> FrequencyResponse:
    count = len(values)
    return frequency_response(
        np.arange(1.0, count + 1), values, covariance=np.broadcast_to(covariance, (count, 2, 2)), **known
    )


@pytest.mark.parametrize("freedom", [1, 2, 4, 10, 30.5, 499, 1e3])
def test_the_factors_are_those_of_students_t_and_of_f(freedom: float) -> None:
    assert interval_factor(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-11)
    assert circle_factor(freedom) == pytest.approx(np.sqrt(stats.f.ppf(0.95, 2, freedom)), rel=1e-9)


def test_a_known_covariance_has_the_factors_of_the_normal_distribution() -> None:
    assert interval_factor(np.inf) == pytest.approx(stats.norm.ppf(0.975), rel=1e-6)
    np.testing.assert_allclose(circle_factor(np.array([4, 10, np.inf])), [2.635, 2.026, 1.731], atol=5e-4)
    assert circle_factor(1e7) == pytest.approx(circle_factor(np.inf), rel=1e-6)


@pytest.mark.parametrize("realisations", [3, 6])
def test_bands_from_few_realisations_hold_the_truth_in_95_percent(realisations: int) -> None:
    rng, count, truth = np.random.default_rng(5), 20_000, 2 - 1j
    noise = 0.02 * (rng.standard_normal((2, realisations, count)).T @ [1, 1j]).T
    found = truth + noise.mean(axis=0)
    variance = np.sum(np.abs(truth + noise - found) ** 2, axis=0) / (realisations * (realisations - 1))
    freedom = np.full(count, 2.0 * (realisations - 1))
    response = response_of(found, np.eye(2), freedom=freedom)
    response = replace(response, covariance=variance[:, None, None] / 2 * np.eye(2))
    inside = np.abs(found - truth) <= response.standard_deviation * circle_factor(freedom)
    magnitude, phase = confidence_limits(response)
    size, turn = np.abs(truth / found), np.angle(truth / found)
    assert inside.mean() == pytest.approx(0.95, abs=0.006)  # 3.9 standard deviations of 20,000 draws
    assert np.mean((magnitude[0] < size) & (size < magnitude[1])) == pytest.approx(0.95, abs=0.006)
    assert np.mean((phase[0] < turn) & (turn < phase[1])) == pytest.approx(0.95, abs=0.006)


def test_the_deviations_are_those_along_and_across_the_response() -> None:
    values = np.array([3.0, 3.0j, -3.0, 3 * np.exp(0.25j * np.pi)])
    along, across = relative_deviations(values, np.broadcast_to(np.diag([0.09, 0.36]), (4, 2, 2)))
    np.testing.assert_allclose(along, [0.1, 0.2, 0.1, np.sqrt(0.025)])
    np.testing.assert_allclose(across, [0.2, 0.1, 0.2, np.sqrt(0.025)])


def test_an_unknown_covariance_gives_no_limits() -> None:
    for known in ({}, {"model_covariance": np.full((1, 2, 2), np.nan)}):
        magnitude, phase = confidence_limits(response_of([1 + 1j], np.full((2, 2), np.nan), **known))
        assert np.isnan(magnitude).all()
        assert np.isnan(phase).all()


def test_noise_and_model_add_in_the_inverse_response() -> None:
    values, small = np.array([2 * np.exp(0.7j), 0.5j]), 1e-8 * np.array([[2.0, 0.5], [0.5, 1.0]])
    model = np.tile(1e-8 * np.diag([3.0, 1.0]), (2, 1, 1))
    found, freedom = inverse_covariance(response_of(values, small, model_covariance=model))
    assert np.isinf(freedom).all()
    rng = np.random.default_rng(2)
    for value, part in zip(values, found, strict=True):
        noise = rng.multivariate_normal([0, 0], small, 200_000) @ [1, 1j]
        error = rng.multivariate_normal([0, 0], model[0], 200_000) @ [1, 1j]
        inverse = 1 / (value + noise) + error
        np.testing.assert_allclose(np.cov(inverse.real, inverse.imag), part, rtol=0.02, atol=2e-10)


def test_the_limits_are_the_extremes_of_the_ellipse_around_the_inverse() -> None:
    value = 0.5 * np.exp(-2.0j)
    covariance = np.array([[0.05, 0.03], [0.03, 0.04]])
    magnitude, phase = confidence_limits(response_of([value], np.zeros((2, 2)), model_covariance=covariance[None]))
    angle = np.linspace(0, 2 * np.pi, 100_001)
    edge = np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)])
    reach = stats.norm.ppf(0.975)  # of a covariance that is known
    ratio = 1 / (1 / value + reach * (edge[0] + 1j * edge[1])) / value
    expected = [np.abs(ratio).min(), np.abs(ratio).max()], [np.angle(ratio).min(), np.angle(ratio).max()]
    np.testing.assert_allclose(magnitude[:, 0], expected[0], rtol=2e-3)  # 180 points of the ellipse are looked at
    np.testing.assert_allclose(phase[:, 0], expected[1], rtol=2e-3)


def test_a_response_may_be_infinite_where_the_ellipse_holds_the_origin() -> None:
    covariance = np.eye(2)[None]  # of 1/G = 1: √6 wide
    magnitude, phase = confidence_limits(response_of([1.0], np.zeros((2, 2)), model_covariance=covariance))
    assert magnitude[1, 0] == np.inf
    assert magnitude[0, 0] == pytest.approx(1 / (1 + np.sqrt(stats.chi2.ppf(0.95, 2))), rel=1e-3)
    np.testing.assert_allclose(phase[:, 0], [-np.pi, np.pi])


@pytest.mark.parametrize("size", [0.01, 0.3, 0.8, 1.0])
def test_limits_around_the_inverse_hold_the_truth_in_95_percent(size: float) -> None:
    """Of magnitude and phase alike, until the origin is nearly in reach."""
    rng, truth = np.random.default_rng(7), 1 / (2 + 1j)
    covariance = size * np.array([[0.6, 0.15], [0.15, 0.3]])
    found = 1 / (1 / truth + rng.multivariate_normal([0, 0], covariance, 20_000) @ [1, 1j])
    models = np.broadcast_to(covariance, (20_000, 2, 2))
    limits = confidence_limits(response_of(found, np.zeros((2, 2)), model_covariance=models))
    for (low, high), value in zip(limits, (np.abs(truth / found), np.angle(truth / found)), strict=True):
        assert 0.945 <= np.mean((low <= value) & (value <= high)) <= 0.97


def test_a_stated_friction_model_adds_degrees_of_freedom_to_those_of_few_periods() -> None:
    noise, model = np.diag([1e-4, 1e-4]), 9e-4 * np.eye(2)[None]
    several = response_of([1.0], noise, model_covariance=model, freedom=np.array([4.0]))
    # Welch and Satterthwaite: ν (total/noise)² where the other part is known
    assert inverse_covariance(several)[1] == pytest.approx([4 * 10**2])
