"""Stepped sine: one frequency after another, each in its periodic state."""

from functools import cache, cached_property, lru_cache
from math import gcd

import numpy as np

from fraexp.api import Excitation, ParameterError, Period, Schedule, param

NEAR = 1e-3
"""Relative distance at which a frequency counts as met by whole periods in whole samples."""
LEAST, MOST = 400, 1 << 16
"""Samples of a block of whole periods, at least and at most."""
LONGEST = 2_000_000
"""Samples of a period, at most: half a gigabyte of channels."""
EXACT = 1e-9
"""Relative distance at which a frequency is the one asked for."""
LITTLE_LONGER = 1.2
"""How much longer a block may be, if its number of samples has small prime factors only."""
PHASES = 20
"""Different phases at which a sine is sampled, at least."""


class SteppedSine(Excitation, name="stepped_sine", version=1):
    """u_sin = A sin(2πft), frequency by frequency on a logarithmic grid (paper, section II-C).

    Each frequency is moved, by 0.1 % at most where the sample time allows it, to the nearest one of which whole
    periods fit into whole samples: then the Fourier sums have no leakage and the response can repeat itself.
    """

    amplitude: float = param("N", "amplitude A", above=0)
    lowest: float = param("Hz", "lowest frequency", 1.0, above=0)
    highest: float = param("Hz", "highest frequency", 200.0, above=0)
    points: int = param("1", "number of frequencies, spaced logarithmically", 100, at_least=1, at_most=100_000)
    frequencies: tuple[float, ...] = param("Hz", "frequencies in place of lowest, highest and points", ())
    ramp: float = param("s", "time over which the amplitude rises", 0.1, at_least=0, at_most=1000)
    tolerance: float = param("1", "relative difference of successive periods that counts as settled", 1e-5, above=0)
    settle_limit: float = param("s", "time after which settling is given up", 30.0, above=0, at_most=10_000)
    whole_periods: int = param("1", "whole periods recorded at least", 1, at_least=1, at_most=100_000)
    record_time: float = param("s", "time recorded at least", 0.0, at_least=0, at_most=10_000)

    def model_post_init(self, context: object) -> None:
        """Check the grid."""
        if not self.frequencies and self.lowest > self.highest:
            raise ParameterError(
                f"stepped_sine.lowest is {self.lowest:g} Hz; expected at most highest, {self.highest:g} Hz"
            )
        if min(self.frequencies, default=1.0) <= 0:
            raise ParameterError("stepped_sine.frequencies must be above 0 Hz")

    @cached_property
    def grid(self) -> np.ndarray:
        """The frequencies asked for [Hz], shape (n,)."""
        if self.frequencies:
            return np.array(self.frequencies)
        return np.geomspace(self.lowest, self.highest, self.points)

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on."""
        longest = 1 / (self.grid.min() * sample_time)
        if longest > LONGEST:
            raise ParameterError(
                f"stepped_sine has {longest:.3g} samples per period at {self.grid.min():g} Hz and a sample time of "
                f"{sample_time:g} s; expected {LONGEST:,} at most: raise 'lowest', or lengthen loop.sample_time"
            )
        if self.grid.max() * sample_time >= 0.5:
            raise ParameterError(
                f"stepped_sine reaches {self.grid.max():g} Hz; at a sample time of {sample_time:g} s "
                f"the Nyquist frequency is {0.5 / sample_time:g} Hz: lower 'highest', or shorten loop.sample_time"
            )

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one block of whole periods per frequency."""
        return tuple(self._period(frequency, sample_time) for frequency in self.grid)

    def _period(self, frequency: float, sample_time: float) -> Period:
        cycles, samples = coherent(frequency * sample_time)
        return Period(self.amplitude * _sine(cycles, samples), np.array([cycles]))

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(self.ramp, self.tolerance, self.settle_limit, self.whole_periods, self.record_time)


@cache
def coherent(cycles_per_sample: float) -> tuple[int, int]:
    """Return whole cycles and whole samples whose ratio is near `cycles_per_sample`.

    The samples meet the sine at `PHASES` different phases at least: what the resolution of a scale hides from one
    of them the others show. Of numbers of samples that are alike one is taken whose Fourier transform is fast.
    """
    fitting: list[tuple[int, int]] = []
    for cycles in range(1, max(2, int(cycles_per_sample * MOST))):
        least = max(int(np.ceil(cycles / cycles_per_sample / (1 + NEAR))), LEAST)
        if fitting and least > LITTLE_LONGER * fitting[0][1]:
            break
        most = int(np.floor(cycles / cycles_per_sample / (1 - NEAR)))
        fitting += [(cycles, samples) for samples in range(least, most + 1) if samples >= PHASES * gcd(cycles, samples)]
    if fitting:
        exact = [pair for pair in fitting if abs(pair[0] / (pair[1] * cycles_per_sample) - 1) < EXACT]
        return min(exact or fitting, key=lambda pair: (_transform_cost(pair[1]), pair[1]))
    samples = max(round(1 / cycles_per_sample), PHASES)
    return 1, samples


@cache
def _transform_cost(samples: int) -> int:
    """Return the sum of the prime factors: a Fourier transform takes about so many operations per sample."""
    total, factor = 0, 2
    while samples > 1:
        while samples % factor == 0:
            total, samples = total + factor, samples // factor
        factor += 1 if factor * factor <= samples else samples - factor
    return total


@lru_cache(1024)
def _sine(cycles: int, samples: int) -> np.ndarray:
    """Return whole cycles of a sine; many sweeps have the same frequencies."""
    return np.sin(2 * np.pi * (cycles * np.arange(samples) % samples) / samples)
