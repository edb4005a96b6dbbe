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

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = round(1 / (self.frequency * sample_time))
        if samples < LEAST:
            raise ParameterError(
                f"displacement_sine has {samples} samples per period at {self.frequency:g} Hz and a sample time of "
                f"{sample_time:g} s; expected {LEAST} at least: lower 'frequency', or shorten loop.sample_time"
            )
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples), np.array([1])),)

    @property
    def schedule(self) -> Schedule:
        """A friction model is driven until periodic without a schedule."""
        return Schedule()
