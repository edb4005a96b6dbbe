"""Dahl friction."""

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, param


class Dahl(FrictionModel, name="dahl", version=1):
    """Dahl friction: a spring that yields asymptotically to the Coulomb force, dF/dx = σ(1 - F/Fc sgn v).

    P. R. Dahl, A solid friction model, The Aerospace Corporation, TOR-0158(3107-18)-1, 1968. The step is exact: the
    force depends on the path alone. It has no nonlocal memory: minor loops drift.
    """

    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    stiffness: float = param("N/m", "presliding stiffness σ", above=0)
    coulomb_force: float = param("N", "Coulomb friction force Fc", above=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    @property
    def force_bound(self) -> float:
        """Fc [N]."""
        return self.coulomb_force

    @property
    def max_stiffness(self) -> float:
        """2σ [N/m]: at a reversal from gross sliding."""
        return 2 * self.stiffness

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        stiffness: float,
        coulomb_force: float,
    ) -> float:
        """Friction force [N] after the displacement moved by dy [m]; z holds the force [N]."""
        limit = math.copysign(coulomb_force, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-stiffness * abs(dy) / coulomb_force)
        return z_next[0]
