"""Elastoplastic friction."""

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import param
from fraexp_plugins.friction._shared.bristle_model import GUIDE, PUBLISHED, BristleModel


class Elastoplastic(BristleModel, name="elastoplastic", version=1):
    """Elastoplastic friction: LuGre bristles that are purely elastic up to z_ba, ż = v (1 - α(z, v) z/z_ss sgn v).

    α is 0 for |z| ≤ z_ba and while the bristles unload, 1 from z_ss(v) = g(v)/σ0 on, and a half sine between.
    P. Dupont, V. Hayward, B. Armstrong and F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002,
    doi:10.1109/TAC.2002.1000274. The step integrates over space, in pieces of a quarter of z_ss or less, with α of the
    piece's middle (V. Hayward, B. Armstrong, F. Altpeter and P. Dupont, IEEE Trans. Control Systems Technology 17(6),
    2009), so |z| ≤ Fs/σ0 at any step. It does not drift.
    """

    elastic_limit_ratio: float = param("1", "elastic limit z_ba over Fc/σ0", 0.7, above=0, below=1)

    expected_failures: ClassVar[dict[str, str]] = {
        "energy": "the force is not passive if σ2 < σ1 (Fs - Fc)/Fc, as with the parameters of 2002"
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {
        "dupont_2002": {**PUBLISHED, "elastic_limit_ratio": 0.7},
        "linear_motor_table": {**GUIDE, "elastic_limit_ratio": 0.7},
    }

    @property
    def max_stiffness(self) -> float:
        """σ0 [N/m]: α is 0 after a reversal."""
        return self.bristle_stiffness

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
        elastic_limit_ratio: float,
    ) -> float:
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        velocity = dy / dt / stribeck_velocity
        steady = (coulomb_force + (static_force - coulomb_force) * math.exp(-velocity * velocity)) / bristle_stiffness
        elastic = elastic_limit_ratio * coulomb_force / bristle_stiffness
        sign = math.copysign(1.0, dy)
        path = min(abs(dy), 12.0 * steady)  # beyond it the deflection is steady, whatever it was
        pieces = int(4.0 * path / steady) + 1
        deflection = sign * z[0]  # positive along the motion
        for _ in range(pieces):
            deflection = _deflection_after(deflection, path / pieces, steady, elastic)
        z_next[0] = sign * deflection
        z_next[1] = z_next[0] - z[0]
        rate = (1.5 * z_next[1] - 0.5 * z[1]) / dt  # at the step's end, to second order
        return bristle_stiffness * z_next[0] + bristle_damping * rate


def _deflection_after(start: float, path: float, steady: float, elastic: float) -> float:
    """Return the deflection [m] after a short path [m]: exact for a constant α, which is that of its middle."""
    middle = _deflection_at_alpha(start, 0.5 * path, steady, _alpha(start, steady, elastic))
    end = _deflection_at_alpha(start, path, steady, _alpha(middle, steady, elastic))
    return min(end, steady) if start <= steady else end


def _deflection_at_alpha(start: float, path: float, steady: float, alpha: float) -> float:
    """Return the deflection [m] after a path [m] with dz/dx = 1 - α z/z_ss."""
    if alpha == 0.0:
        return start + path
    return start - (steady / alpha - start) * math.expm1(-alpha * path / steady)


def _alpha(deflection: float, steady: float, elastic: float) -> float:
    """Return α, the plastic fraction of the motion, at a deflection [m] along it."""
    if deflection <= elastic:
        return 0.0
    if deflection >= steady:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (deflection - 0.5 * (steady + elastic)) / (steady - elastic))
