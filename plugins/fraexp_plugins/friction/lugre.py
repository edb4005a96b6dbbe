"""LuGre friction."""

import math
from typing import ClassVar

from fraexp_plugins.friction.bristles import BristleModel


class LuGre(BristleModel, name="lugre", version=1):
    """LuGre friction: bristles of mean deflection z, ż = v - σ0|v|z/g(v), F = σ0 z + σ1 ż + σ2 v.

    g(v) = Fc + (Fs - Fc) exp(-(v/vs)²). C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, IEEE Trans.
    Automatic Control 40(3), 1995, doi:10.1109/9.376053. The step is exact for a constant velocity, so |z| ≤ Fs/σ0 at
    any step. It drifts under small vibrations, and with the printed parameters it is not passive.
    """

    expected_failures: ClassVar[dict[str, str]] = {
        "energy": "the force is not passive if σ2 < σ1 (Fs - Fc)/Fc, as with the parameters of 1995",
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {
        "canudas_de_wit_1995": {
            "sigma0": 1e5,
            "sigma1": 316.22776601683796,
            "sigma2": 0.4,
            "coulomb": 1.0,
            "breakaway": 1.5,
            "stribeck_velocity": 1e-3,
        },
        "linear_motor_table": {  # the guide of the paper's machine, with a Stribeck effect and micro-damping added
            "sigma0": 3.9e5,
            "sigma1": 400.0,
            "sigma2": 4.69,
            "coulomb": 17.9,
            "breakaway": 22.0,
            "stribeck_velocity": 1e-3,
        },
    }

    @property
    def greatest_stiffness(self) -> float:
        """2σ0 [N/m]: at a reversal from full slip."""
        return 2 * self.sigma0

    @staticmethod
    def advance(z, dy, dt, z_next, sigma0, sigma1, coulomb, breakaway, stribeck_velocity):  # type: ignore[no-untyped-def]
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        velocity = dy / dt / stribeck_velocity
        steady = coulomb + (breakaway - coulomb) * math.exp(-velocity * velocity)
        limit = math.copysign(steady / sigma0, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-sigma0 * abs(dy) / steady)
        z_next[1] = z_next[0] - z[0]
        rate = (1.5 * z_next[1] - 0.5 * z[1]) / dt  # at the step's end, to second order
        return sigma0 * z_next[0] + sigma1 * rate
