"""LuGre friction."""

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.friction._shared.bristle_model import GUIDE, PUBLISHED, BristleModel


class LuGre(BristleModel, name="lugre", version=1):
    """LuGre friction: bristles of mean deflection z, ż = v - σ0|v|z/g(v), F = σ0 z + σ1 ż + σ2 v.

    g(v) = Fc + (Fs - Fc) exp(-(v/vs)²). C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, IEEE Trans.
    Automatic Control 40(3), 1995, doi:10.1109/9.376053. The step is exact for a constant velocity, so |z| ≤ Fs/σ0 at
    any step. It drifts under small vibrations, and with the published parameters it is not passive.
    """

    expected_failures: ClassVar[dict[str, str]] = {
        "energy": "the force is not passive if σ2 < σ1 (Fs - Fc)/Fc, as with the parameters of 1995"
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {"canudas_de_wit_1995": PUBLISHED, "linear_motor_table": GUIDE}

    @property
    def max_stiffness(self) -> float:
        """2σ0 [N/m]: at a reversal from gross sliding."""
        return 2 * self.bristle_stiffness

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        bristle_stiffness: float,
        bristle_damping: float,
        coulomb_force: float,
        static_force: float,
        stribeck_velocity: float,
    ) -> float:
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        velocity = dy / dt / stribeck_velocity
        steady = coulomb_force + (static_force - coulomb_force) * math.exp(-velocity * velocity)
        limit = math.copysign(steady / bristle_stiffness, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-bristle_stiffness * abs(dy) / steady)
        z_next[1] = z_next[0] - z[0]
        rate = (1.5 * z_next[1] - 0.5 * z[1]) / dt  # at the step's end, to second order
        return bristle_stiffness * z_next[0] + bristle_damping * rate
