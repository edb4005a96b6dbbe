"""Rolling friction of a linear guide: parallel elasto-slide elements (paper, section V-A)."""

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.friction._shared.element_model import ElementModel


class Rolling(ElementModel, name="rolling", version=2):
    """Rolling friction by N parallel viscoelastic elements that slip, eqs (6)-(11), with viscous friction, eq (12).

    Each element is a stop operator: its deflection follows the displacement up to ±F_mi/K_i (eq 9) and its force
    is K_i y_i + D_i dy_i/dt (eq 7), limited to ±F_mi (eq 10). Also known as Maxwell slip, Jenkins or Iwan model.

    With D_i > 0 eqs (9) and (10) bind at different instants. Here (9) is the slider: the deflection stops at Y_mi,
    then the force is limited. `rolling_force_slider` takes (10) for the slider; without D_i both are the same.
    """

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        element_stiffness: NDArray[np.float64],
        damping: NDArray[np.float64],
        limit_deflection: NDArray[np.float64],
    ) -> float:
        """Friction force [N] after the displacement moved by dy [m] in dt [s]; z holds the deflections [m]."""
        force, n = 0.0, element_stiffness.size
        # An element that moves has the table's velocity: at the step's end, to second order, from two mean ones. One
        # that has reached its limit needs no other, because the force limit holds there.
        mean_velocity = dy / dt
        velocity = 1.5 * mean_velocity - 0.5 * z[n]
        z_next[n] = mean_velocity
        for i in range(n):
            limit = limit_deflection[i]
            z_next[i] = min(max(z[i] + dy, -limit), limit)
            limit_force = element_stiffness[i] * limit
            force += min(max(element_stiffness[i] * z_next[i] + damping[i] * velocity, -limit_force), limit_force)
        return force
