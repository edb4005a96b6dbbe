"""Stepped sine: one frequency after another, each in its periodic state."""

import numpy as np

from fraexp.api import Period, param
from fraexp_plugins.excitations._shared.sampling import PROFILE_MEANING, AmplitudeProfile, relative_amplitude, sine_wave
from fraexp_plugins.excitations._shared.settled_excitation import SteppedExcitation


class SteppedSine(SteppedExcitation, name="stepped_sine", version=1):
    """u_sin = A s(f) sin(2πft), frequency by frequency on a logarithmic grid (paper, section II-C).

    Each frequency is moved, by up to 0.1 % where the sample time allows it, to the nearest one at which whole
    periods fit into whole samples: then the Fourier sums have no leakage and the response can repeat itself.
    `amplitude_profile` is s(f), 1 by default. It gives the most accurate response per frequency, and is the slowest:
    a sweep of a hundred frequencies takes minutes on a machine, a multisine seconds.
    """

    amplitude: float = param("N", "amplitude A", above=0)
    amplitude_profile: AmplitudeProfile = param("Hz", PROFILE_MEANING, ())

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one block of whole periods per frequency."""
        amplitudes = self.amplitude * relative_amplitude(self.amplitude_profile, self.grid)
        blocks = [self.block(frequency, sample_time) for frequency in self.grid]
        return tuple(
            Period(amplitude * sine_wave(block), np.array([block.cycles]))
            for amplitude, block in zip(amplitudes, blocks, strict=True)
        )
