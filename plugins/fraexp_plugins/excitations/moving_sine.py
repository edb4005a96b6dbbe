"""A sine while the axis moves: no reversal of the velocity, so that friction is nearly constant."""

from typing import Literal

import numpy as np

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations.sampling import MOST, coherent_half, sine
from fraexp_plugins.excitations.shaping import MEANING, Shape, check_shape, shaped
from fraexp_plugins.excitations.stepped import SteppedExcitation


class MovingSine(SteppedExcitation, name="moving_sine", version=1):
    """u_sin = A s(f) sin(2πft), while the position reference goes to and fro at the velocity V.

    The usage of drive makers: an offset of the velocity, so great that it never crosses zero (SINUMERIK 840Di sl
    Manual, section 14.4, Siemens 2007); Beckhoff's TE5960 uses a slow sine (`base` = "sine", of which V is the peak
    velocity). The triangle's corners are rounded by `acceleration` a: half a base period T/2 lasts 2V/a + `run_in` +
    `whole_cycles`/f at least. The stroke is V (T/2 - V/a), or V T/π for the sine; it begins at the loop's reference.

    The sine is an even harmonic of the base, of which friction makes odd harmonics: both halves of a period, added,
    leave the sine alone. Between the reversals a friction that depends on the displacement is constant as long as the
    sine's own velocity stays below V; the response is then that of P with the viscous friction, at any amplitude,
    without a friction model. Each reversal disturbs the sine as well, until the lightest mode has decayed: `run_in`
    should be 5/(ζω) of it. On the paper's machine, 4 to 12 N at 50 mm/s, the stretches after 0.5 s are off by 0.04 dB
    at most, those after 1 s by 0.001 dB; over whole periods, reversals included, it is up to 2 dB. A record begins
    anywhere in the period: the channel `reference` tells where.

    Not to be used without stroke, nor at so low frequencies that ω|y| reaches V; Stribeck friction adds its slope
    dF/dv at V, and what depends on the position (cogging, pitch errors, ball passage) appears as a disturbance.
    """

    amplitude: float = param("N", "amplitude A of the sine", above=0)
    shape: Shape = param("Hz", MEANING, ())
    velocity: float = param("m/s", "velocity V of the base motion", 0.05, above=0)
    acceleration: float = param("m/s^2", "acceleration at its reversals", 1.0, above=0)
    base: Literal["triangle", "sine"] = param("", "base motion: triangle or sine", "triangle")
    run_in: float = param("s", "time after a reversal before the response counts", 0.5, at_least=0, at_most=100)
    whole_cycles: int = param("1", "periods of the sine between reversals at least", 2, at_least=1, at_most=10_000)
    base_period: float = param("s", "period of the base motion at least", 2.0, at_least=0, at_most=10_000)
    tolerance: float = param("1", "relative difference of successive periods that counts as settled", 1e-7, above=0)

    def model_post_init(self, context: object) -> None:
        """Check grid and shape."""
        super().model_post_init(context)
        check_shape(self.name, self.shape)

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on, and base periods that do not fit into memory."""
        super().check(sample_time)
        longest = max(2 * self._half(frequency) for frequency in self.grid)
        if longest / sample_time > MOST:
            raise ParameterError(
                f"moving_sine has a base period of {longest:.3g} s; at a sample time of {sample_time:g} s expected "
                f"{MOST * sample_time:g} s at most: raise 'lowest', or lower 'whole_cycles' or 'base_period'"
            )

    def _half(self, frequency: float) -> float:
        """Return the time from one reversal to the next at least [s]."""
        corner = 2 * self.velocity / self.acceleration if self.base == "triangle" else 0.0
        return max(self.base_period / 2, corner + self.run_in + self.whole_cycles / frequency)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of the base motion per frequency."""
        amplitudes = self.amplitude * shaped(self.shape, self.grid)
        return tuple(self._period(*pair, sample_time) for pair in zip(self.grid, amplitudes, strict=True))

    def _period(self, frequency: float, amplitude: float, sample_time: float) -> Period:
        cycles, half = coherent_half(self._half(frequency) / sample_time, frequency * sample_time)
        way = self._way(sample_time * np.arange(half + 1))
        reference = np.concatenate([way[:-1], way[-1] - way[:-1]])
        return Period(amplitude * sine(2 * cycles, 2 * half), np.array([2 * cycles]), reference)

    def _way(self, time: np.ndarray) -> np.ndarray:
        """Return the base motion [m] at times [s] from one reversal to the next, shape (n,)."""
        end = time[-1]
        if self.base == "sine":
            return self.velocity * end / np.pi * (1 - np.cos(np.pi * time / end))
        corner = self.velocity / self.acceleration
        into, out = np.maximum(corner - time, 0), np.maximum(time - (end - corner), 0)
        return self.velocity * (time - corner / 2) + self.acceleration / 2 * (into**2 - out**2)
