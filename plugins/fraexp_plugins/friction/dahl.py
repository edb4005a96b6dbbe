"""Dahl friction."""

import math
from typing import ClassVar

from fraexp.api import FrictionModel, param


class Dahl(FrictionModel, name="dahl", version=1):
    """Dahl friction: a spring that yields asymptotically to the Coulomb force, dF/dx = σ(1 - F/Fc sgn v).

    P. R. Dahl, A solid friction model, The Aerospace Corporation, TOR-0158(3107-18)-1, 1968. The step is exact: the
    force depends on the path alone. It has no nonlocal memory: minor loops drift.
    """

    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    stiffness: float = param("N/m", "presliding stiffness σ", above=0)
    coulomb: float = param("N", "Coulomb friction force Fc", above=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    @property
    def viscous(self) -> float:
        """σ2 [N s/m]."""
        return self.viscous_coefficient

    @property
    def force_bound(self) -> float:
        """Fc [N]."""
        return self.coulomb

    @property
    def greatest_stiffness(self) -> float:
        """2σ [N/m]: at a reversal from full slip."""
        return 2 * self.stiffness

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, coulomb):  # type: ignore[no-untyped-def]
        """Friction force [N] after the displacement moved by dy [m]; z holds the force [N]."""
        limit = math.copysign(coulomb, dy)
        z_next[0] = limit + (z[0] - limit) * math.exp(-stiffness * abs(dy) / coulomb)
        return z_next[0]
