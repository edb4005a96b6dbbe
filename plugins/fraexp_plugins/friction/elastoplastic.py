"""Elastoplastic friction."""

import math
from typing import ClassVar

from fraexp.api import param
from fraexp_plugins.friction.bristles import BristleModel


class Elastoplastic(BristleModel, name="elastoplastic", version=1):
    """Elastoplastic friction: LuGre bristles that are purely elastic up to z_ba, ż = v (1 - α(z, v) z/z_ss sgn v).

    α is 0 for |z| ≤ z_ba and on the way back, 1 from z_ss(v) = g(v)/σ0 on, and a half sine between. P. Dupont,
    V. Hayward, B. Armstrong and F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002, doi:10.1109/TAC.2002.1000274.
    The step integrates over space, in pieces of a quarter of z_ss at most, with α of the piece's middle (V. Hayward,
    B. Armstrong, F. Altpeter and P. Dupont, IEEE Trans. Control Systems Technology 17(6), 2009), so |z| ≤ Fs/σ0 at
    any step. It does not drift.
    """

    elastic_share: float = param("1", "elastic limit z_ba as a share of Fc/σ0", 0.7, above=0, below=1)

    expected_failures: ClassVar[dict[str, str]] = {
        "energy": "the force is not passive if σ2 < σ1 (Fs - Fc)/Fc, as with the parameters of 2002",
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {
        "dupont_2002": {
            "sigma0": 1e5,
            "sigma1": 316.22776601683796,
            "sigma2": 0.4,
            "coulomb": 1.0,
            "breakaway": 1.5,
            "stribeck_velocity": 1e-3,
            "elastic_share": 0.7,
        },
        "linear_motor_table": {  # the guide of the paper's machine, with a Stribeck effect and micro-damping added
            "sigma0": 3.9e5,
            "sigma1": 400.0,
            "sigma2": 4.69,
            "coulomb": 17.9,
            "breakaway": 22.0,
            "stribeck_velocity": 1e-3,
            "elastic_share": 0.7,
        },
    }

    @property
    def greatest_stiffness(self) -> float:
        """σ0 [N/m]: α is 0 after a reversal."""
        return self.sigma0

    @staticmethod
    def advance(  # type: ignore[no-untyped-def]
        z, dy, dt, z_next, sigma0, sigma1, coulomb, breakaway, stribeck_velocity, elastic_share
    ):
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        velocity = dy / dt / stribeck_velocity
        steady = (coulomb + (breakaway - coulomb) * math.exp(-velocity * velocity)) / sigma0
        elastic = elastic_share * coulomb / sigma0
        sign = math.copysign(1.0, dy)
        path = min(abs(dy), 12.0 * steady)  # after which the deflection is steady whatever it was
        pieces = int(4.0 * path / steady) + 1
        reached = sign * z[0]  # the deflection seen along the motion
        for _ in range(pieces):
            reached = _slid(reached, path / pieces, steady, elastic)
        z_next[0] = sign * reached
        z_next[1] = z_next[0] - z[0]
        rate = (1.5 * z_next[1] - 0.5 * z[1]) / dt  # at the step's end, to second order
        return sigma0 * z_next[0] + sigma1 * rate


def _slid(start: float, path: float, steady: float, elastic: float) -> float:
    """Deflection [m] after a short path [m]: exact for a constant α, which is that of the middle."""
    middle = _relaxed(start, 0.5 * path, steady, _alpha(start, steady, elastic))
    reached = _relaxed(start, path, steady, _alpha(middle, steady, elastic))
    return min(reached, steady) if start <= steady else reached


def _relaxed(start: float, path: float, steady: float, alpha: float) -> float:
    """Deflection [m] after a path [m] with dz/dx = 1 - α z/z_ss."""
    if alpha == 0.0:
        return start + path
    return start - (steady / alpha - start) * math.expm1(-alpha * path / steady)


def _alpha(deflection: float, steady: float, elastic: float) -> float:
    """Share of plastic motion at a deflection [m] along the motion."""
    if deflection <= elastic:
        return 0.0
    if deflection >= steady:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (deflection - 0.5 * (steady + elastic)) / (steady - elastic))
