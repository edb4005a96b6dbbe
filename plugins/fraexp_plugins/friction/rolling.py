"""Rolling friction of a linear guide: parallel elasto-slide elements (paper, section V-A)."""

from functools import cached_property

import numpy as np

from fraexp.api import FrictionModel, ParameterError, param


class Rolling(FrictionModel, name="rolling", version=1):
    """Rolling friction by N parallel viscoelastic elements that slip, eqs (6)-(11), with viscous friction, eq (12).

    Each element is a stop operator: its deflection follows the displacement up to ±F_mi/K_i (eq 9) and its force
    is K_i y_i + D_i dy_i/dt (eq 7), limited to ±F_mi (eq 10). Also known as Maxwell slip, Jenkins or Iwan model.
    """

    stiffness: tuple[float, ...] = param("N/m", "elastic coefficients K_i of the elements", above=None)
    limit_force: tuple[float, ...] = param("N", "maximum forces F_mi of the elements")
    damping: tuple[float, ...] = param("N s/m", "viscous coefficients D_i of the elements", ())
    viscous_coefficient: float = param("N s/m", "viscous coefficient D_v of the guide", 0.0, at_least=0)

    def model_post_init(self, context: object) -> None:
        """Check that the elements belong together."""
        count = len(self.stiffness)
        if not count or len(self.limit_force) != count or len(self.damping) not in (0, count):
            found = f"{count} stiffness, {len(self.limit_force)} limit_force and {len(self.damping)} damping values"
            raise ParameterError(f"rolling has {found}; expected one of each per element (damping may be left out)")
        if min(self.stiffness) <= 0 or min(self.limit_force) <= 0 or min(self.damping, default=0.0) < 0:
            raise ParameterError("rolling needs stiffness and limit_force above 0 and damping of at least 0")

    @property
    def state_size(self) -> int:
        """One deflection [m] per element."""
        return len(self.stiffness)

    @property
    def viscous(self) -> float:
        """D_v of eq (12) [N s/m]."""
        return self.viscous_coefficient

    @property
    def greatest_stiffness(self) -> float:
        """ΣK_i [N/m]: the stiffness after any reversal."""
        return float(sum(self.stiffness))

    @cached_property
    def limit_deflection(self) -> np.ndarray:
        """Y_mi = F_mi/K_i [m], eq (8), shape (N,)."""
        return np.array(self.limit_force) / np.array(self.stiffness)

    @staticmethod
    def advance(z, dy, dt, z_next, stiffness, damping, limit_deflection):  # type: ignore[no-untyped-def]
        """Friction force [N] after the displacement moved by dy [m] in dt [s]; z holds the deflections [m]."""
        force = 0.0
        for i in range(stiffness.size):
            limit = limit_deflection[i]
            z_next[i] = min(max(z[i] + dy, -limit), limit)
            if damping.size == 0:
                force += stiffness[i] * z_next[i]
            else:
                element = stiffness[i] * z_next[i] + damping[i] * ((z_next[i] - z[i]) / dt)
                force += min(max(element, -stiffness[i] * limit), stiffness[i] * limit)
        return force
