"""Swept sine: the frequency glides through the frequency range once a period."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Period, param
from fraexp_plugins.excitations._shared.sampling import (
    PROFILE_MEANING,
    AmplitudeProfile,
    even_samples,
    relative_amplitude,
)
from fraexp_plugins.excitations._shared.settled_excitation import BroadbandExcitation


class Chirp(BroadbandExcitation, name="chirp", version=1):
    """u = A s(f(t)) w(t) sin φ(t), dφ/dt = 2πf(t), repeated: f goes from f1 to f2 as f1 (f2/f1)^τ, or f1 + (f2 - f1) τ.

    The logarithmic sweep after A. Farina, Simultaneous Measurement of Impulse Response and Distortion with a
    Swept-Sine Technique (Farina 2000, 108th AES Convention, preprint 5093); repeated as in R. Pintelon and J.
    Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, section 5.3. s is
    `amplitude_profile`; w raises and lowers the amplitude by half a cosine at the ends of the period, so that it
    closes, while f stays at f1 and at f2. All harmonics in the frequency range are lines.

    Use it where the force must not exceed A at any time, and where someone watches or listens to the machine: it
    excites one frequency at a time, with a crest factor of about 1.45. Logarithmic it has as much energy in each
    octave, linear in each hertz. It does not separate nonlinear distortions from noise: it leaves no harmonic empty,
    and has one realisation; a multisine does. Nor does it give the response at one amplitude of one sine: it leaves a
    frequency before the friction force has become periodic there.
    """

    amplitude: float = param("N", "amplitude A", above=0)
    period: float = param("s", "period T: time of one sweep", 10.0, above=0, at_most=10_000)
    spacing: Literal["logarithmic", "linear"] = param(
        "", "how the frequency rises: logarithmic or linear", "logarithmic"
    )
    taper: float = param(
        "1", "fraction of the period over which the amplitude rises, and falls", 0.01, above=0, at_most=0.02
    )
    amplitude_profile: AmplitudeProfile = param("Hz", PROFILE_MEANING, ())

    def check(self, sample_time: float) -> None:
        """Refuse a range without lines, lines from the Nyquist frequency on, and what does not fit into memory."""
        self.check_size(self.period / sample_time, sample_time)
        self.check_lines(self.lines(), even_samples(self.period, sample_time), sample_time)

    def lines(self) -> NDArray[np.int64]:
        """Return the harmonics in the frequency range, ascending, shape (lines,)."""
        lowest, highest = self.harmonic_range(self.period)
        return np.arange(lowest, highest + 1)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the one period."""
        samples = even_samples(self.period, sample_time)
        position = np.arange(samples) / samples
        cycles, frequency = self._cycles_and_frequency(position)
        profile = relative_amplitude(self.amplitude_profile, frequency)
        wave = self.amplitude * profile * self._window(position) * np.sin(2 * np.pi * cycles)
        return (Period(wave, self.lines()),)

    def _cycles_and_frequency(self, position: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return φ/2π and f [Hz] at positions in the period, from 0 to 1, each of shape (n,)."""
        sweep = 1 - 2 * self.taper
        tau = np.clip((position - self.taper) / sweep, 0, 1)
        if self.spacing == "linear" or self.min_frequency == self.max_frequency:
            rise = self.max_frequency - self.min_frequency
            frequency, swept = self.min_frequency + rise * tau, (self.min_frequency + rise * tau / 2) * tau
        else:
            nepers = np.log(self.max_frequency / self.min_frequency)
            frequency = self.min_frequency * np.exp(nepers * tau)
            swept = (frequency - self.min_frequency) / nepers
        rising = self.min_frequency * np.minimum(position, self.taper)
        falling = self.max_frequency * np.maximum(position - (1 - self.taper), 0)
        return self.period * (rising + falling + sweep * swept), frequency

    def _window(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return w at positions in the period, shape (n,): 0 at its ends."""
        tapered = np.minimum(np.minimum(position, 1 - position) / self.taper, 1)
        return np.sin(np.pi / 2 * tapered) ** 2
