"""Poles of the sampled loop without friction but for its viscous part."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Controller, Plant, StateSpace
from fraexp_plugins.positioning._shared.design_model import DesignModel


def closed_loop_radius(model: DesignModel, controller: Controller) -> float:
    """Return the magnitude of the greatest pole of a loop: it is stable below 1.

    The model's thrust is held over each sample; its position is measured a dead time later.
    """
    from scipy.linalg import companion

    sample_time = model.sample_time
    late = int(np.ceil(model.dead_time / sample_time - 1e-9))
    state_part, thrust_part = model.transition(sample_time)
    rest_state, rest_thrust = model.transition(max(late * sample_time - model.dead_time, 0.0))
    numerator, denominator = controller.transfer_function(sample_time)
    n, order = model.b.size, max(numerator.size, denominator.size) - 1
    b, a = np.pad(numerator, (0, order + 1 - numerator.size)), np.pad(denominator, (0, order + 1 - denominator.size))
    filter_state = companion(a).T if order else np.zeros((0, 0))  # transposed direct form II
    size = n + order + max(late, 1)
    matrix = np.zeros((size, size))
    line = n + order
    # measured position of this sample: the line's last element, or the present one without dead time
    position = np.zeros(size)
    if late:
        position[line + late - 1] = 1.0
    else:
        position[:n] = model.measured
    thrust = -b[0] * position
    if order:
        thrust[n] += 1.0
    matrix[:n, :n] = state_part
    matrix[:n] += np.outer(thrust_part, thrust)
    matrix[n : n + order, n : n + order] = filter_state
    matrix[n : n + order] -= np.outer(b[1:] - a[1:] * b[0], position)
    if late:
        matrix[line, :n] = model.measured @ rest_state
        matrix[line] += (model.measured @ rest_thrust) * thrust
        for i in range(1, late):
            matrix[line + i, line + i - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def damped_plant(plant: Plant, viscous: float) -> StateSpace:
    """Return a plant with viscous friction [N s/m] where the thrust acts."""
    free = plant.state_space()
    return StateSpace(free.a - viscous * np.outer(free.b, free.c @ free.a), free.b, free.c)


def rigid_gain(nominal: NDArray[np.complex128], frequency: NDArray[np.float64]) -> float:
    """Return |ω² P| at the lowest frequency [m/(N s²)]: the gain of the rigid body."""
    return float(np.abs(nominal[0]) * (2 * np.pi * frequency[0]) ** 2)
