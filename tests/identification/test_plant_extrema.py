"""Resonances and antiresonances of a fit: against poles and zeros of the state space, and drawn in the Bode plot."""

import numpy as np
import pytest
from scipy.linalg import eigvals

from fraexp.figures.elements.grouping import ShownResult
from fraexp.figures.kinds.bode import bode_info
from tests.identification.plant_responses import TWO, fitted, measured


def zeros_of_state_space() -> np.ndarray:
    """Return the complex zeros [rad/s] of the plant: where its Rosenbrock matrix loses rank."""
    system = TWO.state_space()
    rosenbrock = np.block([[system.a, system.b.reshape(-1, 1)], [system.c.reshape(1, -1), np.zeros((1, 1))]])
    mass = np.zeros_like(rosenbrock)
    mass[: len(system.a), : len(system.a)] = np.eye(len(system.a))
    found = eigvals(rosenbrock, mass)
    upper = found[np.isfinite(found) & (found.imag > 1.0) & (np.abs(found) < 1e4)]
    return np.asarray(upper[np.argsort(np.abs(upper))])


def test_intervals_cover_poles_and_zeros() -> None:
    zeros = zeros_of_state_space()
    truth = {
        "resonances": np.column_stack([TWO.frequencies, TWO.damping_ratios]),
        "antiresonances": np.column_stack([np.abs(zeros) / (2 * np.pi), -zeros.real / np.abs(zeros)]),
    }
    inside = []
    for seed in range(3):
        curves = {curve.name: curve for curve in fitted(measured(known=True, seed=seed), modes=2).curves}
        for name, values in truth.items():
            columns = curves[name].columns
            magnitude = np.abs(TWO.response(2 * np.pi * values[:, 0]))
            for column, true in zip(("frequency", "damping ratio", "magnitude"), (*values.T, magnitude), strict=True):
                assert columns[column] == pytest.approx(true, rel=0.03)
                inside.append(np.abs(columns[column] - true) <= columns[f"{column}, ± 95 %"])
    assert np.mean(inside) > 0.85  # of 36, with 95 % expected


def test_a_bode_plot_marks_them_and_has_the_line_of_the_apparent_mass() -> None:
    shown = ShownResult("fitted", fitted(measured(noise=1e-3), modes=2))
    assert shown.response
    (curve,) = bode_info([(shown.label, shown.response)], fitted=[shown.fitted]).curves
    model = curve.model
    assert model
    assert model.frequency[model.extremum > 0] == pytest.approx(TWO.frequencies, rel=1e-3)
    assert model.frequency[model.extremum < 0] == pytest.approx(np.abs(zeros_of_state_space()) / (2 * np.pi), rel=1e-3)
    mass = 1e3 / (10 ** (model.rigid_body / 20) * (2 * np.pi * model.frequency) ** 2)  # the plot is in mm/N
    assert mass == pytest.approx(1 / 0.132, rel=1e-3)
