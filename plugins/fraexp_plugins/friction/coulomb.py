"""Coulomb friction with Stribeck effect."""

import math
from typing import ClassVar

from fraexp.api import FrictionModel, ParameterError, param


class Coulomb(FrictionModel, name="coulomb", version=2):
    """Coulomb, Stribeck and viscous friction, sgn(v)(Fc + (Fs - Fc) exp(-|v/vs|^δ)) + σ2 v, set-valued at rest.

    B. Armstrong-Hélouvry, P. Dupont and C. Canudas de Wit, Automatica 30(7), 1994, doi:10.1016/0005-1098(94)90209-7.
    At rest the force takes whatever value within ±Fs holds the machine: the law is a stop operator whose deflection
    (`sticking`) is a tenth of a micrometre, and the loop finds the force implicitly, without regularising sgn(v). A
    smaller one needs more steps per sample, or the machine rings at rest. A force of the other direction is
    `asymmetry` times as large.
    """

    states: ClassVar[tuple[str, ...]] = ("force [N]",)

    coulomb: float = param("N", "Coulomb friction force Fc", above=0)
    breakaway: float | None = param("N", "static friction force Fs; Fc if not given", None, above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)
    stribeck_shape: float = param("1", "Stribeck exponent δ", 2.0, at_least=0.5, at_most=10)
    asymmetry: float = param("1", "friction of the negative direction over that of the positive one", 1.0, above=0)
    sticking: float = param("m", "deflection at which rest ends", 1e-7, above=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)

    expected_failures: ClassVar[dict[str, str]] = {
        "odd": "the friction force of each direction is a parameter",
    }
    presets: ClassVar[dict[str, dict[str, float]]] = {
        "unit": {"coulomb": 1.0, "breakaway": 1.5, "stribeck_velocity": 1e-3},
    }

    def model_post_init(self, context: object) -> None:
        """Check that friction does not rise with the velocity."""
        if self.static < self.coulomb:
            raise ParameterError(
                f"coulomb.breakaway is {self.static:g} N; it must be at least coulomb, {self.coulomb:g} N"
            )

    @property
    def static(self) -> float:
        """Fs [N]."""
        return self.coulomb if self.breakaway is None else self.breakaway

    @property
    def viscous(self) -> float:
        """σ2 [N s/m]."""
        return self.viscous_coefficient

    @property
    def force_bound(self) -> float:
        """Fs [N], in the direction where it is greater."""
        return self.static * max(1.0, self.asymmetry)

    @property
    def greatest_stiffness(self) -> float:
        """Fs over the deflection at which rest ends [N/m], in the direction where it is greater."""
        return self.force_bound / self.sticking

    @staticmethod
    def advance(  # type: ignore[no-untyped-def]
        z, dy, dt, z_next, coulomb, static, stribeck_velocity, stribeck_shape, asymmetry, greatest_stiffness
    ):
        """Friction force [N] without σ2 v after the displacement moved by dy [m] in dt [s]."""
        speed = (abs(dy) / dt / stribeck_velocity) ** stribeck_shape
        limit = coulomb + (static - coulomb) * math.exp(-speed)
        # at rest the stiffness does not depend on the velocity: a loop there would give energy
        z_next[0] = min(max(z[0] + greatest_stiffness * dy, -limit * asymmetry), limit)
        return z_next[0]
