"""Swept sine: the frequency glides through the band once a period."""

from typing import Literal

import numpy as np

from fraexp.api import Period, param
from fraexp_plugins.excitations.broadband import BroadbandExcitation
from fraexp_plugins.excitations.sampling import even_samples
from fraexp_plugins.excitations.shaping import MEANING, Shape, check_shape, shaped


class Chirp(BroadbandExcitation, name="chirp", version=1):
    """u = A s(f(t)) w(t) sin φ(t), dφ/dt = 2πf(t), repeated: f goes from f1 to f2 as f1 (f2/f1)^τ, or f1 + (f2 - f1) τ.

    The logarithmic sweep after A. Farina, Simultaneous Measurement of Impulse Response and Distortion with a
    Swept-Sine Technique (Farina 2000, 108th AES Convention, preprint 5093); repeated as in R. Pintelon and J.
    Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, section 5.3. s is `shape`; w
    raises and lowers the amplitude by half a cosine at the ends of the period, so that it closes, while f stays at f1
    and at f2. All harmonics in the band are lines.

    To be used where the force must not exceed A at any time, and where the machine shall be watched or listened to
    while it is excited: one frequency at a time, with a crest factor of about 1.45. Logarithmic it has as much energy
    in each octave, linear in each hertz. Not to be used to tell nonlinear distortions from noise: it leaves no
    harmonic empty, and has one realisation; a multisine does. Nor where the response at one amplitude of one sine is
    asked for: friction has not become periodic at a frequency when it is left.
    """

    amplitude: float = param("N", "amplitude A", above=0)
    period: float = param("s", "period T: time of one sweep", 10.0, above=0, at_most=10_000)
    sweep: Literal["logarithmic", "linear"] = param("", "how the frequency rises: logarithmic or linear", "logarithmic")
    fade: float = param(
        "1", "share of the period over which the amplitude rises, and falls", 0.01, above=0, at_most=0.02
    )
    shape: Shape = param("Hz", MEANING, ())

    def model_post_init(self, context: object) -> None:
        """Check band and shape."""
        super().model_post_init(context)
        check_shape(self.name, self.shape)

    def check(self, sample_time: float) -> None:
        """Refuse a band without lines, lines from the Nyquist frequency on, and what does not fit into memory."""
        self.check_size(self.period / sample_time, sample_time)
        self.check_lines(self.lines(), even_samples(self.period, sample_time), sample_time)

    def lines(self) -> np.ndarray:
        """Return the harmonics in the band, ascending, shape (lines,)."""
        least, most = self.band(self.period)
        return np.arange(least, most + 1)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the one period."""
        samples = even_samples(self.period, sample_time)
        along = np.arange(samples) / samples
        cycles, frequency = self._swept(along)
        wave = self.amplitude * shaped(self.shape, frequency) * self._window(along) * np.sin(2 * np.pi * cycles)
        return (Period(wave, self.lines()),)

    def _swept(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return φ/2π and f [Hz] at parts of the period, each of shape (n,)."""
        sweep = 1 - 2 * self.fade
        tau = np.clip((along - self.fade) / sweep, 0, 1)
        if self.sweep == "linear" or self.lowest == self.highest:
            rise = self.highest - self.lowest
            frequency, swept = self.lowest + rise * tau, (self.lowest + rise * tau / 2) * tau
        else:
            nepers = np.log(self.highest / self.lowest)
            frequency = self.lowest * np.exp(nepers * tau)
            swept = (frequency - self.lowest) / nepers
        held = self.lowest * np.minimum(along, self.fade) + self.highest * np.maximum(along - (1 - self.fade), 0)
        return self.period * (held + sweep * swept), frequency

    def _window(self, along: np.ndarray) -> np.ndarray:
        """Return w at parts of the period, shape (n,): 0 at its ends."""
        near = np.minimum(np.minimum(along, 1 - along) / self.fade, 1)
        return np.sin(np.pi / 2 * near) ** 2
