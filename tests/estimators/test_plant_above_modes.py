"""The plant at harmonics that friction causes, from their motion, against plants that are known."""

import numpy as np
import pytest
from fraexp_plugins.estimators._shared.plant_above_modes import Harmonics, PlantAboveModes, fit_above_modes
from fraexp_plugins.plants.modal import Modal

PLANT = Modal(
    rigid_body_gain=0.5, frequencies=(23.0, 140.0), damping_ratios=(0.01, 0.3), modal_gain_ratios=(0.15, -0.4)
)
GUESS = PlantAboveModes.of_gain(1.0, 2)
NOISE = 1e-9


def harmonics(frequency: float, seed: int, highest: float = 600.0) -> Harmonics:
    """Return the odd harmonics of a motion by a force with corners, and noise; they fall with the third power."""
    generator = np.random.default_rng(seed)
    number = np.arange(3, int(highest / frequency) + 1, 2)
    omega = 2 * np.pi * frequency * number
    force = 20 * number**-2.0 * np.exp(2j * np.pi * generator.random(number.size))
    noise = generator.normal(0, NOISE / np.sqrt(2), (2, number.size))
    motion = -PLANT.response(omega) * force + noise[0] + 1j * noise[1]
    return Harmonics(omega, motion, force, np.full(number.size, NOISE**2), np.abs(motion) > 3 * NOISE)


def test_the_plant_follows_from_harmonics_as_exactly_as_it_says():
    """The guess is 2.7 times too large."""
    omega, ratios, errors = 2 * np.pi * np.geomspace(160, 1200, 30), [], []
    for seed in range(8):
        parts = [harmonics(f, 10 * seed + n) for n, f in enumerate((2.0, 3.1, 5.0, 7.3, 11.0))]
        plant = fit_above_modes(parts, GUESS)
        errors.append(np.abs(plant.response(omega) / PLANT.response(omega) - 1))
        ratios.append(errors[-1] / plant.error(omega))
    assert np.median(errors) < 0.12
    assert np.max(ratios) < 3
    assert np.mean(np.array(ratios) < 1) > 0.6


def test_what_a_force_makes_likely_is_the_motion_without_its_noise():
    known = fit_above_modes([harmonics(f, n) for n, f in enumerate((2.0, 3.1, 5.0, 7.3, 11.0))], GUESS)
    other = harmonics(4.3, 9)
    weak = ~other.is_clear & (other.omega > 2 * np.pi * 160)
    likely = known.likely_terms(other.omega, other.force)
    truth = -PLANT.response(other.omega) * other.force
    error = np.abs(likely.mean - truth)[weak]
    assert weak.sum() > 20
    assert np.mean(error**2) < 0.05 * np.mean(np.abs(other.motion - truth)[weak] ** 2)
    assert np.mean(error**2) < 2 * np.mean(likely.variance[weak])


@pytest.mark.parametrize("guess", [GUESS, PlantAboveModes.of_gain(1.0, 0)], ids=["few harmonics", "unknown degree"])
def test_where_harmonics_do_not_show_it_nothing_is_likely(guess):
    parts = [harmonics(80.0, 1)] if guess is GUESS else [harmonics(2.0, 1)]
    plant = fit_above_modes(parts, guess)
    assert plant is guess
    likely = plant.likely_terms(parts[0].omega, parts[0].force)
    assert not likely.mean.any()
    assert np.isnan(likely.deviation).all()


def test_an_uncertain_prediction_counts_by_its_variance():
    """Near a mode the plant is uncertain by more than half: without a prediction weak terms were missed on one side."""
    plant = PlantAboveModes(np.array([10.0, 100.0]), np.array([1.0 + 0j, 1.0]), np.array([1.5, 2.5]), 2)
    omega, force = np.array([11.0, 99.0]), np.array([1.0 + 0j, 1.0])
    likely = plant.likely_terms(omega, force)
    np.testing.assert_allclose(likely.mean, [1 / 121, 0])
    np.testing.assert_allclose(likely.deviation[0] / np.abs(likely.mean[0]), 1.5, rtol=0.01)
    assert np.isnan(likely.deviation[1])
