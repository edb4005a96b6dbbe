"""The two-mass drive: a motor that moves a load through a compliant shaft, belt or coupling."""

from typing import ClassVar

import numpy as np

from fraexp.api import param
from fraexp_plugins.plants._shared.coupled_bodies import Bodies, CoupledBodies, spring


class TwoMass(CoupledBodies, name="two_mass", version=1):
    """Motor and load, coupled by a spring and a damper (Schröder 2009, two-mass system).

    The thrust is `motor`; contacts and positions are `motor` and `load`. Of a rotary drive, inertias and torques enter
    as masses and forces at a radius, such as the pitch radius of its pulley.
    """

    motor_mass: float = param("kg", "mass of the motor", above=0)
    load_mass: float = param("kg", "mass of the load", above=0)
    stiffness: float = param("N/m", "stiffness of the coupling", above=0)
    damping: float = param("N s/m", "damping of the coupling", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, float]]] = {
        "belt_drive": {"motor_mass": 3.0, "load_mass": 5.0, "stiffness": 2e5, "damping": 20.0}
    }

    @property
    def bodies(self) -> Bodies:
        """Motor and load."""
        motor, load = np.eye(2)
        return Bodies(
            mass=np.diag([self.motor_mass, self.load_mass]),
            damping=spring(motor, load, self.damping),
            stiffness=spring(motor, load, self.stiffness),
            thrusts={"motor": motor},
            contacts={"motor": motor, "load": load},
            positions={"motor": motor, "load": load},
        )
