"""Generalized Maxwell slip friction."""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np

from fraexp.api import FrictionModel, ParameterError, param, where


class GeneralizedMaxwellSlip(FrictionModel, name="gms", version=1):
    """Generalized Maxwell slip: N elements that stick as springs and slip towards their share of S(v).

    Stick: Ḟ_i = k_i v until |F_i| = α_i S(v). Slip: Ḟ_i = -(C/S)(F_i - sgn(v) α_i S) until v crosses zero, with
    S(v) = Fc + (Fs - Fc) exp(-|v/vs|^δ) unsigned. F. Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic
    Control 50(11), 2005, doi:10.1109/TAC.2005.858676. The slip's exponential is exact for a constant velocity. With
    Fs = Fc it is the rolling model.
    """

    stiffness: tuple[float, ...] = param("N/m", "stiffness k_i of the elements")
    shares: tuple[float, ...] = param("1", "shares α_i of the elements in the friction force; their sum is 1")
    coulomb: float = param("N", "Coulomb friction force Fc", above=0)
    breakaway: float = param("N", "static friction force Fs", above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)
    stribeck_shape: float = param("1", "Stribeck exponent δ", 2.0, at_least=0.5, at_most=10)
    attraction: float = param("N/s", "attraction C towards the Stribeck curve", above=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "reference": {
            "stiffness": [0.1 / (3e-6 * i) for i in range(1, 11)],
            "shares": [0.1] * 10,
            "coulomb": 1.0,
            "breakaway": 1.5,
            "stribeck_velocity": 1e-3,
            "attraction": 20.0,
        },
        "linear_motor_table": {  # the rolling guide of the paper's machine, with a Stribeck effect added
            "stiffness": [14549, 12600, 18710, 27196, 38254, 51166, 63357, 69763, 64327, 73982],
            "shares": [0.00163, 0.00217, 0.00499, 0.01119, 0.02432, 0.05024, 0.09608, 0.16339, 0.23268, 0.41331],
            "coulomb": 17.9,
            "breakaway": 22.0,
            "stribeck_velocity": 1e-3,
            "attraction": 500.0,
            "viscous_coefficient": 4.69,
        },
    }

    def model_post_init(self, context: object) -> None:
        """Check that the elements belong together."""
        if not self.stiffness or len(self.stiffness) != len(self.shares):
            found = f"{len(self.stiffness)} stiffness and {len(self.shares)} shares"
            raise ParameterError(f"gms has {found}; expected one of each per element")
        if min(self.stiffness) <= 0 or min(self.shares) <= 0 or abs(sum(self.shares) - 1) > 1e-6:
            raise ParameterError(
                f"gms needs stiffness and shares above 0; the shares add up to {sum(self.shares):g}, not 1"
            )
        if self.breakaway < self.coulomb:
            raise ParameterError(
                f"gms.breakaway is {self.breakaway:g} N; it must be at least coulomb, {self.coulomb:g} N"
            )

    @property
    def state_size(self) -> int:
        """Force [N] and slip flag of each element, and the sign of the last motion."""
        return 2 * len(self.stiffness) + 1

    @property
    def viscous(self) -> float:
        """σ2 [N s/m]."""
        return self.viscous_coefficient

    @property
    def force_bound(self) -> float:
        """Fs [N]."""
        return self.breakaway

    @property
    def greatest_stiffness(self) -> float:
        """Σk_i [N/m]: all elements stick after a reversal."""
        return float(sum(self.stiffness))

    @cached_property
    def normal_shares(self) -> np.ndarray:
        """α_i scaled so that they add up to 1 exactly, shape (N,)."""
        return np.array(self.shares) / sum(self.shares)

    @staticmethod
    def advance(  # type: ignore[no-untyped-def]
        z, dy, dt, z_next, stiffness, normal_shares, coulomb, breakaway, stribeck_velocity, stribeck_shape, attraction
    ):
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        n = stiffness.size
        moving = dy != 0.0
        sign = where(moving, math.copysign(1.0, dy), z[2 * n])
        onward = moving & (sign == z[2 * n])
        z_next[2 * n] = sign
        speed = (abs(dy) / dt / stribeck_velocity) ** stribeck_shape
        steady = coulomb + (breakaway - coulomb) * math.exp(-speed)
        kept = math.exp(-attraction * dt / steady)
        force = 0.0
        for i in range(n):
            limit = sign * normal_shares[i] * steady
            slipping = limit + (z[i] - limit) * kept
            sticking = z[i] + stiffness[i] * dy
            beyond = max(sign * (z[i] - limit), 0.0)  # a limit that has sunk below the force lets it relax
            broken = limit + sign * beyond * kept
            slips = onward & (z[n + i] > 0.0)
            breaks = moving & (sign * (sticking - limit) >= 0.0)
            z_next[i] = where(slips, slipping, where(breaks, broken, sticking))
            z_next[n + i] = where(slips | breaks, 1.0, 0.0)
            force += z_next[i]
        return force
