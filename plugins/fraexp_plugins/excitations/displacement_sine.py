"""A sinusoidal displacement that drives a friction model directly."""

import numpy as np

from fraexp.api import Period
from fraexp_plugins.excitations._shared.displacement_wave import DisplacementWave
from fraexp_plugins.excitations._shared.sampling import samples_per_period


class DisplacementSine(DisplacementWave, name="displacement_sine", version=1):
    """y = A sin(2πft): the motion under which friction is recorded over displacement (paper, Fig 2)."""

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period, of the whole number of samples that is nearest to 1/(f Ts)."""
        samples = samples_per_period(self.name, self.frequency, sample_time)
        return (Period(self.amplitude * np.sin(2 * np.pi * np.arange(samples) / samples), np.array([1])),)
