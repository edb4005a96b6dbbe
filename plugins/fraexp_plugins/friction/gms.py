"""Generalized Maxwell slip friction."""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrictionModel, ParameterError, param, where
from fraexp_plugins.friction._shared.bristle_model import check_static_force


class GeneralizedMaxwellSlip(FrictionModel, name="gms", version=1):
    """Generalized Maxwell slip: N elements that stick as springs and slip towards their fraction of S(v).

    Stick: Ḟ_i = k_i v until |F_i| = α_i S(v). Slip: Ḟ_i = -(C/S)(F_i - sgn(v) α_i S) until v crosses zero, with
    S(v) = Fc + (Fs - Fc) exp(-|v/vs|^δ) unsigned. F. Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic
    Control 50(11), 2005, doi:10.1109/TAC.2005.858676. The slip's exponential is exact for a constant velocity. With
    Fs = Fc it is the rolling model.
    """

    stiffness: tuple[float, ...] = param("N/m", "stiffness k_i of the elements")
    force_fractions: tuple[float, ...] = param("1", "fractions α_i of the friction force by element; their sum is 1")
    coulomb_force: float = param("N", "Coulomb friction force Fc", above=0)
    static_force: float = param("N", "static friction force Fs", above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)
    stribeck_exponent: float = param("1", "Stribeck exponent δ", 2.0, at_least=0.5, at_most=10)
    attraction_rate: float = param("N/s", "rate of attraction C towards the Stribeck curve", above=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "reference": {
            "stiffness": [0.1 / (3e-6 * i) for i in range(1, 11)],
            "force_fractions": [0.1] * 10,
            "coulomb_force": 1.0,
            "static_force": 1.5,
            "stribeck_velocity": 1e-3,
            "attraction_rate": 20.0,
        },
        "linear_motor_table": {  # the rolling guide of the paper's machine, with a Stribeck effect added
            "stiffness": [14549, 12600, 18710, 27196, 38254, 51166, 63357, 69763, 64327, 73982],
            "force_fractions": [
                0.00163, 0.00217, 0.00499, 0.01119, 0.02432, 0.05024, 0.09608, 0.16339, 0.23268, 0.41331,
            ],
            "coulomb_force": 17.9,
            "static_force": 22.0,
            "stribeck_velocity": 1e-3,
            "attraction_rate": 500.0,
            "viscous_coefficient": 4.69,
        },
    }  # fmt: skip

    def model_post_init(self, context: object) -> None:
        """Check that the elements belong together."""
        if not self.stiffness or len(self.stiffness) != len(self.force_fractions):
            found = f"{len(self.stiffness)} stiffness and {len(self.force_fractions)} force_fractions values"
            raise ParameterError(f"gms has {found}; expected one of each per element")
        total = sum(self.force_fractions)
        if min(self.stiffness) <= 0 or min(self.force_fractions) <= 0 or abs(total - 1) > 1e-6:
            raise ParameterError(
                f"gms needs stiffness and force_fractions above 0; the force_fractions add up to {total:g}, not 1"
            )
        check_static_force(self.name, self.static_force, self.coulomb_force)

    @property
    def state_size(self) -> int:
        """Force [N] and slip flag of each element, and the sign of the last motion."""
        return 2 * len(self.stiffness) + 1

    @property
    def force_bound(self) -> float:
        """Fs [N]."""
        return self.static_force

    @property
    def max_stiffness(self) -> float:
        """Σk_i [N/m]: all elements stick after a reversal."""
        return float(sum(self.stiffness))

    @cached_property
    def normalised_fractions(self) -> NDArray[np.float64]:
        """α_i scaled so that they add up to 1 exactly, shape (N,)."""
        return np.array(self.force_fractions) / sum(self.force_fractions)

    @staticmethod
    def advance(
        z: NDArray[np.float64],
        dy: float,
        dt: float,
        z_next: NDArray[np.float64],
        stiffness: NDArray[np.float64],
        normalised_fractions: NDArray[np.float64],
        coulomb_force: float,
        static_force: float,
        stribeck_velocity: float,
        stribeck_exponent: float,
        attraction_rate: float,
    ) -> float:
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s].

        It chooses by `where` in place of branches, so that several machines are computed at once.
        """
        n = stiffness.size
        moving = dy != 0.0
        sign = where(moving, math.copysign(1.0, dy), z[2 * n])
        onward = moving & (sign == z[2 * n])
        z_next[2 * n] = sign
        speed = (abs(dy) / dt / stribeck_velocity) ** stribeck_exponent
        steady = coulomb_force + (static_force - coulomb_force) * math.exp(-speed)
        decay = math.exp(-attraction_rate * dt / steady)
        force = 0.0
        for i in range(n):
            limit = sign * normalised_fractions[i] * steady
            slipping = limit + (z[i] - limit) * decay
            sticking = z[i] + stiffness[i] * dy
            excess = max(sign * (z[i] - limit), 0.0)  # above a limit that has sunk below it, the force relaxes
            broken_away = limit + sign * excess * decay
            slips = onward & (z[n + i] > 0.0)
            breaks_away = moving & (sign * (sticking - limit) >= 0.0)
            z_next[i] = where(slips, slipping, where(breaks_away, broken_away, sticking))
            z_next[n + i] = where(slips | breaks_away, 1.0, 0.0)
            force += z_next[i]
        return force
