"""Base class of the displacements that drive a friction model directly."""

from abc import ABC
from typing import ClassVar

from fraexp.api import Excitation, Schedule, param
from fraexp_plugins.excitations._shared.sampling import samples_per_period


class DisplacementWave(Excitation, ABC):
    """A displacement back and forth: the motion under which friction is recorded over displacement (paper, Fig 2)."""

    quantity: ClassVar[str] = "displacement"

    amplitude: float = param("m", "amplitude A", above=0)
    frequency: float = param("Hz", "frequency f", 1.0, above=0)

    def check(self, sample_time: float) -> None:
        """Refuse a frequency with too few samples per period."""
        samples_per_period(self.name, self.frequency, sample_time)

    @property
    def schedule(self) -> Schedule:
        """The default: a friction model is driven until periodic whatever the schedule."""
        return Schedule()
