"""No friction: the linear machine, to compare with."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, param


class Frictionless(FrictionModel, name="none", version=1):
    """No friction apart from an optional linear viscous one (paper, eq 12)."""

    viscous_coefficient: float = param("N s/m", "viscous coefficient D_v of the guide", 0.0, at_least=0)

    @property
    def has_unique_periodic_force(self) -> bool:
        """True: there is no memory."""
        return True

    @property
    def force_bound(self) -> float:
        """0 N: the viscous force is not part of the law."""
        return 0.0

    @property
    def max_stiffness(self) -> float:
        """0 N/m: there is no presliding stiffness."""
        return 0.0

    @staticmethod
    def advance(z: NDArray[np.float64], dy: float, dt: float, z_next: NDArray[np.float64]) -> float:
        """Friction force [N]: zero."""
        return 0.0
