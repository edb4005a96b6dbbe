"""Friction laws that are called: against closed forms."""

import numpy as np
import pytest

import fraexp
from tests.refusals import refused

STIFFNESS, COULOMB = 1e6, 10.0
BREAKAWAY = COULOMB / STIFFNESS


@pytest.fixture
def slider(workspace: fraexp.Workspace) -> fraexp.FrictionLaw:
    return workspace.friction_law("rolling", stiffness=[STIFFNESS], limit_force=[COULOMB])


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_the_describing_function_of_a_spring_with_a_slider(slider: fraexp.FrictionLaw, ratio: float) -> None:
    amplitude = ratio * BREAKAWAY
    # the elastic slide, by integrating its loop over a sine (e.g. Gelb and Vander Velde, 1968, appendix B)
    theta = np.arccos(1 - 2 / ratio) if ratio > 1 else np.pi
    real = STIFFNESS / np.pi * (theta - np.sin(2 * theta) / 2)
    imaginary = 4 * COULOMB / (np.pi * amplitude) * (1 - 1 / ratio) if ratio > 1 else 0.0
    found = slider.describing_function(amplitude)
    assert found.real == pytest.approx(real, rel=1e-5, abs=1e-5 * STIFFNESS)
    assert found.imag == pytest.approx(imaginary, rel=1e-5, abs=1e-5 * STIFFNESS)


def test_viscous_friction_is_a_part_of_it(workspace: fraexp.Workspace) -> None:
    law = workspace.friction_law("rolling", stiffness=[STIFFNESS], limit_force=[COULOMB], viscous_coefficient=4.0)
    plain = workspace.friction_law("rolling", stiffness=[STIFFNESS], limit_force=[COULOMB])
    difference = law.describing_function([1e-5, 1e-3], 7.0) - plain.describing_function([1e-5, 1e-3], 7.0)
    np.testing.assert_allclose(difference, 2j * np.pi * 7.0 * 4.0)
    time = np.arange(1000) * 1e-3
    np.testing.assert_allclose((law.force(0.2 * time) - plain.force(0.2 * time)), 0.8, rtol=1e-9)


def test_the_shape_of_the_amplitudes_is_kept(slider: fraexp.FrictionLaw) -> None:
    assert slider.describing_function(np.full((2, 3), 1e-5)).shape == (2, 3)
    assert slider.describing_function(1e-5).shape == ()


@pytest.mark.parametrize("amplitude", [0.0, -1e-6, np.nan, np.inf, 1e-300])
def test_an_amplitude_that_is_none_is_refused(slider: fraexp.FrictionLaw, amplitude: float) -> None:
    with refused(fraexp.FraexpError, "rolling", "1e-12 m"):
        slider.describing_function(amplitude)


@pytest.mark.parametrize("displacement", [[], [1.0], [[1.0, 2.0]], [0.0, np.nan]])
def test_an_invalid_displacement_is_refused(slider: fraexp.FrictionLaw, displacement: object) -> None:
    with refused(fraexp.FraexpError, "displacement"):
        slider.force(displacement)


def test_quantities_are_numbers_with_units(slider: fraexp.FrictionLaw) -> None:
    found = slider.describing_function(["10 um", 2e-5])
    np.testing.assert_allclose(found, slider.describing_function([1e-5, 2e-5]), rtol=1e-12)
    np.testing.assert_allclose(slider.loop("10 µm", "2 Hz"), slider.loop(1e-5, 2.0), rtol=1e-12)
    np.testing.assert_allclose(slider.force(["0 um", "5 um"], "1 ms"), slider.force([0.0, 5e-6], 1e-3), rtol=1e-12)


def test_units_are_read_and_names_corrected(workspace: fraexp.Workspace) -> None:
    law = workspace.friction_law("rolling", stiffness=["1 N/µm"], limit_force=["10 N"])
    assert law.parameters["stiffness"] == [STIFFNESS]
    with refused(fraexp.FraexpError, "'roling'", "'rolling'"):
        workspace.friction_law("roling")
    with refused(fraexp.FraexpError, "'stifness'", "'stiffness'"):
        workspace.friction_law("rolling", stifness=[1.0], limit_force=[1.0])
