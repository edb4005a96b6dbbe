"""No friction: the linear machine, to compare with."""

from fraexp.api import FrictionModel, param


class Frictionless(FrictionModel, name="none", version=1):
    """No friction but, if wanted, a linear viscous one (paper, eq 12)."""

    viscous_coefficient: float = param("N s/m", "viscous coefficient D_v of the guide", 0.0, at_least=0)
    force_bound = property(lambda self: 0.0, doc="0 N: all of it is viscous.")
    greatest_stiffness = property(lambda self: 0.0, doc="0 N/m: there is no presliding stiffness.")

    forgets = property(lambda self: True, doc="True: there is nothing to remember.")

    @property
    def viscous(self) -> float:
        """D_v of eq (12) [N s/m]."""
        return self.viscous_coefficient

    @staticmethod
    def advance(z, dy, dt, z_next):  # type: ignore[no-untyped-def]
        """Friction force [N]: zero."""
        return 0.0
