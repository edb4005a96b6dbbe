"""The ball screw drive: motor, screw and table, with friction at the motor, in the nut and on the guide."""

from typing import ClassVar

import numpy as np

from fraexp.api import param
from fraexp_plugins.plants._shared.coupled_bodies import Bodies, CoupledBodies, spring


class BallScrew(CoupledBodies, name="ball_screw", version=1):
    """Motor, screw and table: torsion of coupling and screw, then axial compliance of screw, nut and bearing.

    The model of Varanasi and Nayfeh 2004, with three inertias. Angles are displacements by the
    lead: one turn is one lead. The thrust is `motor`. The contacts are `motor` (its bearings), `nut` (balls that roll
    as the screw turns) and `guide`; the positions are `motor` and `table`.
    """

    lead: float = param("m", "lead of the screw", above=0)
    motor_inertia: float = param("kg m**2", "inertia of motor and coupling", above=0)
    screw_inertia: float = param("kg m**2", "inertia of the screw", above=0)
    table_mass: float = param("kg", "mass of the table", above=0)
    torsional_stiffness: float = param("N m/rad", "torsional stiffness of coupling and screw", above=0)
    axial_stiffness: float = param("N/m", "axial stiffness of screw, nut and bearing", above=0)
    torsional_damping: float = param("N m s/rad", "torsional damping of coupling and screw", 0.0, at_least=0)
    axial_damping: float = param("N s/m", "axial damping of nut and bearing", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, float]]] = {
        "lead_10mm": {
            "lead": 0.01,
            "motor_inertia": 2e-4,
            "screw_inertia": 1.5e-4,
            "table_mass": 30.0,
            "torsional_stiffness": 900.0,
            "axial_stiffness": 5e7,
            "torsional_damping": 0.02,
            "axial_damping": 3e3,
        }
    }

    @property
    def bodies(self) -> Bodies:
        """Motor, screw and table, all as displacements of the table."""
        motor, screw, table = np.eye(3)
        per_radian = self.lead / (2 * np.pi)  # a torque is a force times this; so is an angle a displacement
        rotary = 1 / per_radian**2
        return Bodies(
            mass=np.diag([self.motor_inertia * rotary, self.screw_inertia * rotary, self.table_mass]),
            damping=spring(motor, screw, self.torsional_damping * rotary) + spring(screw, table, self.axial_damping),
            stiffness=spring(motor, screw, self.torsional_stiffness * rotary)
            + spring(screw, table, self.axial_stiffness),
            thrusts={"motor": motor},
            contacts={"motor": motor, "nut": screw, "guide": table},
            positions={"motor": motor, "table": table},
        )
