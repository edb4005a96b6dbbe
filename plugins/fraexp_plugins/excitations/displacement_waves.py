"""A displacement, sinusoidal or triangular, that drives a friction model directly."""

from abc import ABC
from typing import ClassVar

import numpy as np

from fraexp.api import Excitation, Period, Schedule, param
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


class DisplacementSine(DisplacementWave, name="displacement_sine", version=1):
    """y = A sin(2πft): the motion under which friction is recorded over displacement (paper, Fig 2)."""

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = samples_per_period(self.name, self.frequency, sample_time)
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples), np.array([1])),)


class DisplacementTriangle(DisplacementWave, name="displacement_triangle", version=1):
    """A displacement back and forth at constant velocity, as in friction rigs (paper, Fig 2).

    Rate effects then show at one velocity, 4 A f.
    """

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of four times a whole number of samples, so that both peaks are samples."""
        quarter = round(samples_per_period(self.name, self.frequency, sample_time) / 4)
        rise = np.arange(-quarter, quarter) / quarter
        waveform = np.roll(np.concatenate([rise, -rise]), -quarter)
        return (Period(self.amplitude * waveform, np.array([1])),)
