"""A sinusoidal displacement that drives a friction model directly."""

from typing import ClassVar

import numpy as np

from fraexp.api import Excitation, Period, Schedule, param
from fraexp_plugins.excitations._shared.sampling import samples_per_period


class DisplacementSine(Excitation, name="displacement_sine", version=1):
    """y = A sin(2πft): the motion under which friction is recorded over displacement (paper, Fig 2)."""

    quantity: ClassVar[str] = "displacement"

    amplitude: float = param("m", "amplitude A", above=0)
    frequency: float = param("Hz", "frequency f", 1.0, above=0)

    def check(self, sample_time: float) -> None:
        """Refuse a frequency with too few samples per period."""
        samples_per_period(self.name, self.frequency, sample_time)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = samples_per_period(self.name, self.frequency, sample_time)
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples), np.array([1])),)

    @property
    def schedule(self) -> Schedule:
        """The default: a friction model is driven until periodic whatever the schedule."""
        return Schedule()
