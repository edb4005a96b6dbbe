"""A sine while the axis moves: no reversal of the velocity, so that friction is nearly constant."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations._shared.sampling import (
    MAX_SAMPLES_PER_PERIOD,
    PROFILE_MEANING,
    AmplitudeProfile,
    CoherentBlock,
    coherent_half_period,
    relative_amplitude,
    sine_wave,
)
from fraexp_plugins.excitations._shared.settled_excitation import MAX_SETTLING_TOLERANCE, SteppedExcitation


class MovingSine(SteppedExcitation, name="moving_sine", version=1):
    """u_sin = A s(f) sin(2πft), while the position reference goes back and forth at the velocity V.

    The usage of drive makers: an offset of the velocity, so great that it never crosses zero (SINUMERIK 840Di sl
    Manual, section 14.4, Siemens 2007); Beckhoff's TE5960 uses a slow sine (`base` = "sine", of which V is the peak
    velocity). The triangle's corners are rounded by `acceleration` a: half a base period T/2 lasts at least 2V/a +
    `reversal_settling_time` + `whole_cycles`/f. The stroke is V (T/2 - V/a), or V T/π for the sine; it begins at the
    loop's reference.

    The sine is an even harmonic of the base, of which friction makes odd harmonics: both halves of a period, added,
    leave the sine alone. Between the reversals a friction that depends on the displacement is constant if the
    sine's own velocity stays below V; the response is then that of P with the viscous friction, at any amplitude,
    without a friction model. Each reversal disturbs the sine as well, until the lightest mode has decayed:
    `reversal_settling_time` should be 5/(ζω) of it. On the paper's machine, 4 to 12 N at 50 mm/s, the segments after
    0.5 s are off by up to 0.04 dB, those after 1 s by up to 0.001 dB; over whole periods, reversals included, it is up
    to 2 dB. A record begins anywhere in the period: the channel `reference` shows where.

    It needs stroke, and frequencies at which ω|y| stays below V; Stribeck friction adds its slope dF/dv at V, and what
    depends on the position (cogging, pitch errors, ball passage) appears as a disturbance.
    """

    amplitude: float = param("N", "amplitude A of the sine", above=0)
    amplitude_profile: AmplitudeProfile = param("Hz", PROFILE_MEANING, ())
    velocity: float = param("m/s", "velocity V of the base motion", 0.05, above=0)
    acceleration: float = param("m/s^2", "acceleration at its reversals", 1.0, above=0)
    base: Literal["triangle", "sine"] = param("", "base motion: triangle or sine", "triangle")
    reversal_settling_time: float = param(
        "s", "settling time after a reversal before the response counts", 0.5, at_least=0, at_most=100
    )
    whole_cycles: int = param(
        "1", "minimum number of periods of the sine between reversals", 2, at_least=1, at_most=10_000
    )
    base_period: float = param("s", "minimum period of the base motion", 2.0, at_least=0, at_most=10_000)
    settling_tolerance: float = param(
        "1",
        "relative difference of successive periods that counts as settled",
        1e-7,
        above=0,
        at_most=MAX_SETTLING_TOLERANCE,
    )

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on, and base periods that do not fit into memory."""
        super().check(sample_time)
        longest = max(2 * self._min_half_period(frequency) for frequency in self.grid)
        if longest / sample_time > MAX_SAMPLES_PER_PERIOD:
            raise ParameterError(
                f"moving_sine has a base period of {longest:.3g} s; at a sample time of {sample_time:g} s expected "
                f"{MAX_SAMPLES_PER_PERIOD * sample_time:g} s or less: raise 'min_frequency', or lower 'whole_cycles' "
                "or 'base_period'"
            )

    def _min_half_period(self, frequency: float) -> float:
        """Return the minimum time from one reversal to the next [s]."""
        corner = 2 * self.velocity / self.acceleration if self.base == "triangle" else 0.0
        return max(self.base_period / 2, corner + self.reversal_settling_time + self.whole_cycles / frequency)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of the base motion per frequency."""
        amplitudes = self.amplitude * relative_amplitude(self.amplitude_profile, self.grid)
        return tuple(self._period(*pair, sample_time) for pair in zip(self.grid, amplitudes, strict=True))

    def block(self, frequency: float, sample_time: float) -> CoherentBlock:
        """Return the cycles of the sine, and the samples, of one period of the base motion."""
        half = coherent_half_period(self._min_half_period(frequency) / sample_time, frequency * sample_time)
        return CoherentBlock(2 * half.cycles, 2 * half.samples)

    def _period(self, frequency: float, amplitude: float, sample_time: float) -> Period:
        whole = self.block(frequency, sample_time)
        forth = self._base_motion(sample_time * np.arange(whole.samples // 2 + 1, dtype=np.float64))
        reference = np.concatenate([forth[:-1], forth[-1] - forth[:-1]])
        return Period(amplitude * sine_wave(whole), np.array([whole.cycles]), reference)

    def _base_motion(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the base motion [m] at times [s] from one reversal to the next, shape (n,)."""
        end = time[-1]
        if self.base == "sine":
            return self.velocity * end / np.pi * (1 - np.cos(np.pi * time / end))
        corner = self.velocity / self.acceleration
        rising, falling = np.maximum(corner - time, 0), np.maximum(time - (end - corner), 0)
        return self.velocity * (time - corner / 2) + self.acceleration / 2 * (rising**2 - falling**2)
