"""Rolling friction whose elements slip at a limit force."""

import math

from fraexp_plugins.friction.elements import ElementModel


class RollingForceSlider(ElementModel, name="rolling_force_slider", version=1):
    """Rolling friction by N viscoelastic elements behind Coulomb sliders: eqs (6)-(11) with eq (10) as the slider.

    An element is a spring and a dashpot side by side, in series with a slider of limit force F_mi: it sticks while
    |K_i y_i + D_i v| ≤ F_mi, and slips with D_i ẏ_i = F_mi sgn(v) - K_i y_i, whose step is exact. Passive by
    construction. `rolling` takes eq (9) for the slider; without D_i both are the same.
    """

    @staticmethod
    def advance(z, dy, dt, z_next, element_stiffness, damping, limit_deflection):  # type: ignore[no-untyped-def]
        """Friction force [N] after the displacement moved by dy [m] in dt [s]; z holds the deflections [m]."""
        force, n, sign = 0.0, element_stiffness.size, math.copysign(1.0, dy)
        for i in range(n):
            k, d = element_stiffness[i], damping[i] if damping.size else 0.0
            rest = sign * limit_deflection[i]  # the deflection at which a slipping element comes to rest
            viscous = d * dy / dt / k
            if sign * (z[i] + dy + viscous - rest) <= 0.0:
                z_next[i] = z[i] + dy
                force += k * (z_next[i] + viscous)
            else:
                stuck = min(max((rest - viscous - z[i]) / dy, 0.0), 1.0) if dy != 0.0 else 0.0
                begin = z[i] + stuck * dy
                left = math.exp(-k * (1.0 - stuck) * dt / d) if d > 0.0 else 0.0
                z_next[i] = rest + (begin - rest) * left
                force += k * rest
            if damping.size:
                z_next[n + i] = z_next[i] - z[i]
        return force
