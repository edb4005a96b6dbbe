"""Stepped sine: one frequency after another, each in its periodic state."""

import numpy as np

from fraexp.api import Period, param
from fraexp_plugins.excitations.sampling import coherent, sine
from fraexp_plugins.excitations.shaping import MEANING, Shape, check_shape, shaped
from fraexp_plugins.excitations.stepped import SteppedExcitation


class SteppedSine(SteppedExcitation, name="stepped_sine", version=1):
    """u_sin = A s(f) sin(2πft), frequency by frequency on a logarithmic grid (paper, section II-C).

    Each frequency is moved, by 0.1 % at most where the sample time allows it, to the nearest one of which whole
    periods fit into whole samples: then the Fourier sums have no leakage and the response can repeat itself. `shape`
    is s(f), 1 by default. The most accurate response per frequency, and the slowest: a band of a hundred frequencies
    takes minutes on a machine, where a multisine takes seconds.
    """

    amplitude: float = param("N", "amplitude A", above=0)
    shape: Shape = param("Hz", MEANING, ())

    def model_post_init(self, context: object) -> None:
        """Check grid and shape."""
        super().model_post_init(context)
        check_shape(self.name, self.shape)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one block of whole periods per frequency."""
        amplitudes = self.amplitude * shaped(self.shape, self.grid)
        return tuple(_period(*pair, sample_time) for pair in zip(self.grid, amplitudes, strict=True))


def _period(frequency: float, amplitude: float, sample_time: float) -> Period:
    cycles, samples = coherent(frequency * sample_time)
    return Period(amplitude * sine(cycles, samples), np.array([cycles]))
