"""A triangular displacement that drives a friction model directly."""

import numpy as np

from fraexp.api import Period
from fraexp_plugins.excitations._shared.displacement_wave import DisplacementWave
from fraexp_plugins.excitations._shared.sampling import samples_per_period


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
