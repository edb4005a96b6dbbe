"""What models of a bristle's mean deflection have in common: their parameters."""

from abc import ABC
from typing import ClassVar

from fraexp.api import FrictionModel, ParameterError, param


class BristleModel(FrictionModel, ABC):
    """Bristles of mean deflection z: F = σ0 z + σ1 ż + σ2 v, between Fc and Fs by Stribeck's curve."""

    states: ClassVar[tuple[str, ...]] = ("deflection [m]", "its last change [m]")

    sigma0: float = param("N/m", "bristle stiffness σ0", above=0)
    sigma1: float = param("N s/m", "bristle damping σ1", 0.0, at_least=0)
    sigma2: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)
    coulomb: float = param("N", "Coulomb friction force Fc", above=0)
    breakaway: float = param("N", "static friction force Fs", above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)

    def model_post_init(self, context: object) -> None:
        """Check that friction does not rise with the velocity."""
        if self.breakaway < self.coulomb:
            raise ParameterError(
                f"{self.name}.breakaway is {self.breakaway:g} N; it must be at least coulomb, {self.coulomb:g} N"
            )

    @property
    def viscous(self) -> float:
        """σ2 [N s/m]."""
        return self.sigma2

    @property
    def force_bound(self) -> float | None:
        """Fs [N] without σ1; with it the force has no bound."""
        return None if self.sigma1 else self.breakaway
