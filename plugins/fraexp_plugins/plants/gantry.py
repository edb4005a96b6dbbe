"""The gantry: two parallel motors that move one beam, which can also turn a little."""

from typing import ClassVar

import numpy as np

from fraexp.api import param
from fraexp_plugins.plants._shared.coupled_bodies import Bodies, CoupledBodies, spring


class Gantry(CoupledBodies, name="gantry", version=1):
    """A beam on two guides, with a motor and an encoder at each end (Giam, Tan and Huang 2007, H-type gantry).

    The coordinates are the positions of both ends. A head rests on the beam, off its middle towards the right end. The
    beam's joints resist turning. Thrusts, contacts and positions are `left` and `right`.
    """

    beam_mass: float = param("kg", "mass of the beam", above=0)
    head_mass: float = param("kg", "mass of the head on the beam", at_least=0)
    carriage_mass: float = param("kg", "mass of each carriage with its motor", above=0)
    beam_length: float = param("m", "distance between both guides", above=0)
    head_position: float = param("m", "position of the head, from the beam's middle to the right", 0.0)
    joint_stiffness: float = param("N m/rad", "stiffness of guides and joints against turning", above=0)
    joint_damping: float = param("N m s/rad", "damping of guides and joints against turning", 0.0, at_least=0)

    presets: ClassVar[dict[str, dict[str, float]]] = {
        "short_beam": {
            "beam_mass": 12.0,
            "head_mass": 6.0,
            "carriage_mass": 4.0,
            "beam_length": 0.8,
            "head_position": 0.2,
            "joint_stiffness": 4e4,
            "joint_damping": 20.0,
        }
    }

    @property
    def bodies(self) -> Bodies:
        """The beam by the positions of both ends: those of its points follow by linear interpolation."""
        left, right = np.eye(2)
        middle, turn = (left + right) / 2, (right - left) / self.beam_length
        head = middle + self.head_position * turn
        beam_inertia = self.beam_mass * self.beam_length**2 / 12
        ends = {"left": left, "right": right}
        return Bodies(
            mass=self.carriage_mass * np.eye(2)
            + self.beam_mass * np.outer(middle, middle)
            + beam_inertia * np.outer(turn, turn)
            + self.head_mass * np.outer(head, head),
            damping=spring(turn, 0 * turn, self.joint_damping),
            stiffness=spring(turn, 0 * turn, self.joint_stiffness),
            thrusts=ends,
            contacts=ends,
            positions=ends,
        )
