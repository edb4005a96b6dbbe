"""Coulomb friction with Stribeck effect."""

import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, param, where
from fraexp_plugins.friction._shared.bristle_model import check_static_force

STOP_DEFLECTION_M = 1e-9
"""Deflection of the stop where one is needed and none is given: in observers, in compensation, and in a composite."""


class Coulomb(FrictionModel, name="coulomb", version=4):
    """Coulomb, Stribeck and viscous friction, sgn(v)(Fc + (Fs - Fc) exp(-|v/vs|^δ)) + σ2 v, set-valued at rest.

    B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30(7), 1994, doi:10.1016/0005-1098(94)90209-7.
    At rest the force takes whatever value within ±Fs holds the machine: the loop locates stick and slip within its
    steps, without regularising sgn(v). Where a displacement is prescribed, in an observer or a compensation, and as a
    part of a composite, the law is a stop operator with a deflection of 1 nm.

    `stiction_displacement` states the deflection of that stop and makes the loop use it too. Friction is then a spring
    at rest, and the steps must resolve its resonance. On the paper's machine at 25 N and 206 Hz, where it moves by
    0.7 µm, a stop of 0.1 µm changes y/u by 7 dB, one of 1 nm by 0.3 dB. In the negative direction the force is
    `negative_ratio` times as large.
    """

    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    coulomb_force: float = param("N", "Coulomb friction force Fc", above=0)
    static_force: float | None = param("N", "static friction force Fs; Fc if not given", None, above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)
    stribeck_exponent: float = param("1", "Stribeck exponent δ", 2.0, at_least=0.5, at_most=10)
    negative_ratio: float = param("1", "friction in the negative direction over that in the positive one", 1.0, above=0)
    stiction_displacement: float | None = param(
        "m", "deflection at which stiction ends; set-valued in the loop if it is not given", None, above=0
    )
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    expected_failures: ClassVar[dict[str, str]] = {
        "odd": "the friction force of each direction is a parameter",
        "observer": "while it sticks, its force is not in the motion, which effective_input states",
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {
        "unit": {"coulomb_force": 1.0, "static_force": 1.5, "stribeck_velocity": 1e-3}
    }

    def model_post_init(self, context: object) -> None:
        """Check that friction does not rise with the velocity."""
        check_static_force(self.name, self.effective_static_force, self.coulomb_force)

    @property
    def effective_static_force(self) -> float:
        """Fs [N]: Fc where no `static_force` is given."""
        return self.coulomb_force if self.static_force is None else self.static_force

    @property
    def force_bound(self) -> float:
        """Fs [N], in the direction in which it is greater."""
        return self.effective_static_force * max(1.0, self.negative_ratio)

    @property
    def velocity_law(self) -> Callable[..., float] | None:
        """Force at a velocity, where no deflection of the stop is given."""
        return _sliding_force if self.stiction_displacement is None else None

    @property
    def max_stiffness(self) -> float:
        """Fs over the deflection at which stiction ends [N/m], in the direction in which it is greater."""
        return self.force_bound / (self.stiction_displacement or STOP_DEFLECTION_M)

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        coulomb_force: float,
        effective_static_force: float,
        stribeck_velocity: float,
        stribeck_exponent: float,
        negative_ratio: float,
        max_stiffness: float,
    ) -> float:
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        speed = (abs(dy) / dt / stribeck_velocity) ** stribeck_exponent
        limit = coulomb_force + (effective_static_force - coulomb_force) * math.exp(-speed)
        # at rest the stiffness does not depend on the velocity: otherwise a closed path could give energy
        z_next[0] = min(max(z[0] + max_stiffness * dy, -limit * negative_ratio), limit)
        return z_next[0]


def _sliding_force(
    z: NDArray[np.float64],
    dy: float,
    dt: float,
    z_next: NDArray[np.float64],
    coulomb_force: float,
    effective_static_force: float,
    stribeck_velocity: float,
    stribeck_exponent: float,
    negative_ratio: float,
    max_stiffness: float,
) -> float:
    """Friction force [N] without σ2 v at the velocity dy/dt."""
    speed = (abs(dy) / dt / stribeck_velocity) ** stribeck_exponent
    limit = coulomb_force + (effective_static_force - coulomb_force) * math.exp(-speed)
    z_next[0] = where(dy > 0.0, limit, -limit * negative_ratio)
    return z_next[0]
