"""A sinusoidal displacement that drives a friction model directly."""

from typing import ClassVar

import numpy as np

from fraexp.api import Excitation, ParameterError, Period, Schedule, param

LEAST = 16
"""Samples per period that make a loop."""


class DisplacementSine(Excitation, name="displacement_sine", version=1):
    """y = A sin(2πft): the motion under which friction is recorded over displacement (paper, Fig 2)."""

    quantity: ClassVar[str] = "displacement"

    amplitude: float = param("m", "amplitude A", above=0)
    frequency: float = param("Hz", "frequency f", 1.0, above=0)

    def check(self, sample_time: float) -> None:
        """Refuse a frequency with too few samples per period."""
        if self._samples(sample_time) < LEAST:
            raise ParameterError(
                f"displacement_sine has {self._samples(sample_time)} samples per period at {self.frequency:g} Hz and a "
                f"sample time of {sample_time:g} s; expected {LEAST} at least: lower 'frequency', or shorten "
                "loop.sample_time"
            )

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = self._samples(sample_time)
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples), np.array([1])),)

    def _samples(self, sample_time: float) -> int:
        return round(1 / (self.frequency * sample_time))

    @property
    def schedule(self) -> Schedule:
        """A friction model is driven until periodic without a schedule."""
        return Schedule()
