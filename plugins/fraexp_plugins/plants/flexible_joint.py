"""The flexible robot joint: a motor that turns a link through a gear with compliance and hysteresis."""

from typing import ClassVar

import numpy as np

from fraexp.api import param
from fraexp_plugins.plants._shared.coupled_bodies import Bodies, CoupledBodies, spring


class FlexibleJoint(CoupledBodies, name="flexible_joint", version=1):
    """Motor and link, coupled by a gear (Spong 1987), with friction between both in the gear.

    Masses and forces are those at the link's end: inertia and torque over the link's length and its square, the motor's
    behind its gear. The thrust is `motor`. The contacts are `motor` (its bearings and seals), `gear` (between motor and
    link: it makes the gear's hysteresis) and `link`; the positions are `motor` and `link`.
    """

    motor_mass: float = param("kg", "mass of the motor, behind the gear", above=0)
    link_mass: float = param("kg", "mass of the link", above=0)
    gear_stiffness: float = param("N/m", "stiffness of the gear without its hysteresis", above=0)
    gear_damping: float = param("N s/m", "damping of the gear", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, float]]] = {
        "elbow": {"motor_mass": 12.0, "link_mass": 6.0, "gear_stiffness": 6e4, "gear_damping": 40.0}
    }

    @property
    def bodies(self) -> Bodies:
        """Motor and link."""
        motor, link = np.eye(2)
        return Bodies(
            mass=np.diag([self.motor_mass, self.link_mass]),
            damping=spring(motor, link, self.gear_damping),
            stiffness=spring(motor, link, self.gear_stiffness),
            thrusts={"motor": motor},
            contacts={"motor": motor, "gear": motor - link, "link": link},
            positions={"motor": motor, "link": link},
        )
