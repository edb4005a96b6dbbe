"""Rolling friction against closed forms of the stop operator (Jenkins element) and of Masing models."""

import numpy as np
import pytest
from fraexp_plugins.friction.rolling import Rolling

from tests.machines import guide

ELEMENT = Rolling(stiffness=(1.0,), limit_force=(1.0,))
POINTS = 20_000


def cosine(amplitude: float, points: int = POINTS) -> np.ndarray:
    return amplitude * np.cos(2 * np.pi * np.arange(points) / points)


def harmonic(signal: np.ndarray, number: int = 1) -> complex:
    return complex(np.fft.rfft(signal)[number] * 2 / signal.size)


def jenkins(stiffness: float, limit: float, amplitude: float) -> complex:
    """Describing function K/π (θ - ½ sin 2θ + j sin²θ), θ = arccos(1 - 2Y/A); K below slip."""
    if amplitude <= limit:
        return complex(stiffness)
    theta = np.arccos(1 - 2 * limit / amplitude)
    return complex(stiffness / np.pi * (theta - np.sin(2 * theta) / 2 + 1j * np.sin(theta) ** 2))


@pytest.mark.parametrize(
    ("amplitude", "expected"),
    [
        (0.7, 1),
        (1.5, 0.708209 + 0.282942j),
        (2, 0.5 + 0.318310j),
        (5, 0.142378 + 0.203718j),
        (10, 0.052044 + 0.114592j),
    ],
)
def test_describing_function_of_one_element(amplitude, expected):
    force = ELEMENT.force(cosine(amplitude), 1e-4, periodic=True)
    found = harmonic(force) / amplitude
    assert abs(found - expected) < 1e-6
    assert abs(found - jenkins(1.0, 1.0, amplitude)) < 1e-7


def test_describing_function_of_the_guide_is_the_sum_over_its_elements():
    friction = guide()
    for amplitude in (2e-6, 30e-6, 90e-6, 1e-3):
        expected = sum(
            jenkins(k, f / k, amplitude) for k, f in zip(friction.stiffness, friction.limit_force, strict=True)
        )
        found = harmonic(friction.force(cosine(amplitude), 1e-4, periodic=True)) / amplitude
        assert abs(found / expected - 1) < 1e-6


@pytest.mark.parametrize(("ratio", "third", "fifth"), [(2, 0.1790, 0.0358), (5, 0.2732, 0.1076)])
def test_odd_harmonics_of_one_element_and_no_even_ones(ratio, third, fifth):
    force = ELEMENT.force(cosine(ratio), 1e-4, periodic=True)
    first = abs(harmonic(force))
    assert abs(harmonic(force, 3)) / first == pytest.approx(third, abs=5e-5)
    assert abs(harmonic(force, 5)) / first == pytest.approx(fifth, abs=5e-5)
    assert abs(harmonic(force, 2)) / first < 1e-12


def test_energy_per_cycle_is_four_times_force_times_excess_stroke():
    friction, y = guide(), cosine(80e-6)
    force = friction.force(y, 1e-4, periodic=True)
    found = np.sum((force + np.roll(force, -1)) / 2 * (np.roll(y, -1) - y))
    deflections = np.array(friction.limit_force) / np.array(friction.stiffness)
    expected = 4 * np.sum(np.array(friction.limit_force) * np.maximum(80e-6 - deflections, 0))
    assert found == pytest.approx(expected, rel=1e-6)


def test_the_compiled_law_equals_plain_python_to_the_last_bit():
    friction = guide()
    path = np.cumsum(np.random.default_rng(5).normal(0, 2e-6, 300))
    z, plain, last = np.zeros((2, friction.state_size)), [], path[0]
    for now, value in enumerate(path):
        here, there = z[now % 2], z[(now + 1) % 2]
        plain.append(friction.law(here, value - last, 1e-4, there, *friction.law_arguments()))
        last = value
    assert np.array_equal(friction.force(path, 1e-4), plain)
