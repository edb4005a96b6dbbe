"""Rolling friction whose elements slip at a limit force."""

import math

import numpy as np
from numpy.typing import NDArray

from fraexp.api import where
from fraexp_plugins.friction._shared.element_model import ElementModel


class RollingForceSlider(ElementModel, name="rolling_force_slider", version=2):
    """Rolling friction by N viscoelastic elements behind Coulomb sliders: eqs (6)-(11) with eq (10) as the slider.

    An element is a spring and a dashpot side by side, in series with a slider of limit force F_mi: it sticks while
    |K_i y_i + D_i v| ≤ F_mi, and slips with D_i ẏ_i = F_mi sgn(v) - K_i y_i, whose step is exact. `rolling` takes eq
    (9) for the slider; without D_i both are the same.
    """

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        element_stiffness: NDArray[np.float64],
        damping: NDArray[np.float64],
        limit_deflection: NDArray[np.float64],
    ) -> float:
        """Friction force [N] after the displacement moved by dy [m] in dt [s]; z holds the deflections [m].

        It chooses by `where` in place of branches, so that several machines are computed at once.
        """
        force, n = 0.0, element_stiffness.size
        mean_velocity = dy / dt
        begin_velocity = 0.5 * (mean_velocity + z[n])
        end_velocity = 1.5 * mean_velocity - 0.5 * z[n]  # both to second order
        z_next[n] = mean_velocity
        for i in range(n):
            k, d = element_stiffness[i], damping[i]
            # The element's force over its stiffness, if it stuck during the whole step.
            begin = z[i] + d * begin_velocity / k
            end = z[i] + dy + d * end_velocity / k
            rest = math.copysign(limit_deflection[i], end)  # the deflection at which a slipping element comes to rest
            slips = abs(end) > limit_deflection[i]
            has_stuck = slips & (math.copysign(1.0, end) * (rest - begin) > 0.0)
            sticking_fraction = where(has_stuck, (rest - begin) / where(has_stuck, end - begin, 1.0), 0.0)
            onset = z[i] + sticking_fraction * dy
            sliding_time = (1.0 - sticking_fraction) * dt
            exponent = where(slips & (d > 0.0), -k * sliding_time / where(d > 0.0, d, 1.0), 0.0)
            decay = where(d > 0.0, math.exp(exponent), 0.0)
            z_next[i] = where(slips, rest + (onset - rest) * decay, z[i] + dy)
            force += k * where(slips, rest, end)
        return force
