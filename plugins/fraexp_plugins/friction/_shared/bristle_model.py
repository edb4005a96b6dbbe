"""Base class of the models of a bristle's mean deflection."""

from abc import ABC
from typing import ClassVar

from fraexp.api import FrictionModel, ParameterError, Quantity, param

PUBLISHED = {
    "bristle_stiffness": 1e5,
    "bristle_damping": 316.22776601683796,
    "viscous_coefficient": 0.4,
    "coulomb_force": 1.0,
    "static_force": 1.5,
    "stribeck_velocity": 1e-3,
}
"""Parameters of LuGre's publication of 1995, which the one of elastoplastic friction took over."""
GUIDE = {
    "bristle_stiffness": 3.9e5,
    "bristle_damping": 400.0,
    "viscous_coefficient": 4.69,
    "coulomb_force": 17.9,
    "static_force": 22.0,
    "stribeck_velocity": 1e-3,
}
"""The guide of the paper's machine, with a Stribeck effect and micro-damping added."""


class BristleModel(FrictionModel, ABC):
    """Bristles of mean deflection z: F = σ0 z + σ1 ż + σ2 v, with Stribeck's curve from Fs at rest down to Fc."""

    states: ClassVar[tuple[str, ...]] = ("deflection [m]", "its last change [m]")

    bristle_stiffness: float = param("N/m", "bristle stiffness σ0", above=0)
    bristle_damping: float = param("N s/m", "bristle damping σ1", 0.0, at_least=0)
    viscous_coefficient: float = param("N s/m", "viscous coefficient σ2", 0.0, at_least=0)
    coulomb_force: float = param("N", "Coulomb friction force Fc", above=0)
    static_force: float = param("N", "static friction force Fs", above=0)
    stribeck_velocity: float = param("m/s", "Stribeck velocity vs", 1e-3, above=0)

    def model_post_init(self, context: object) -> None:
        """Check that friction does not rise with the velocity."""
        check_static_force(self.name, self.static_force, self.coulomb_force)

    @property
    def force_bound(self) -> float | None:
        """Fs [N] without σ1; with it the force has no bound."""
        return None if self.bristle_damping else self.static_force


def check_static_force(name: str, static_force: float, coulomb_force: float) -> None:
    """Refuse friction that rises with the velocity: forces in N."""
    if static_force < coulomb_force:
        raise ParameterError(
            f"{name}.static_force is ",
            Quantity(static_force, "N"),
            "; it must be at least coulomb_force, ",
            Quantity(coulomb_force, "N"),
        )
