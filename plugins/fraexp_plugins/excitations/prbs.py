"""Pseudo-random binary sequence: a force that jumps between two values."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Period, param
from fraexp_plugins.excitations._shared.settled_excitation import BroadbandExcitation


class Prbs(BroadbandExcitation, name="prbs", version=1):
    """u = ±A, a maximum length sequence of 2ⁿ - 1 bits, each held over c = `samples_per_bit` samples.

    K. Godfrey (ed.), Perturbation Signals for System Identification, Prentice Hall 1993, chapter 1; S. W. Golomb,
    Shift Register Sequences, Holden-Day 1967. Its lines have the amplitude 2A √(N + 1)/N, N = 2ⁿ - 1, times the
    bit's |sinc(f c Ts)/sinc(f Ts)|; the mean is A/N. With `inverse_repeat` the sequence is run twice with every
    other bit inverted: then the second half of the period is the first one with its sign changed and only odd lines
    are excited.

    Use it where the peak force is limited: no wave of this peak has a greater root mean square value (the crest
    factor is 1). Its lines are those from `min_frequency` to `max_frequency` that have power; it excites the machine
    beyond them too, which a multisine does not. It does not suit a best linear approximation over realisations: its
    phases cannot be drawn.
    """

    expected_failures: ClassVar[Mapping[str, str]] = {
        "whole-periods": "a binary wave has energy beyond the frequency range of interest as well"
    }

    amplitude: float = param("N", "amplitude A", above=0)
    order: int = param("1", "order n of the shift register", 12, at_least=3, at_most=20)
    samples_per_bit: int = param("1", "samples per bit", 1, at_least=1, at_most=10_000)
    inverse_repeat: bool = param("", "whether only odd lines are excited", True)

    @property
    def _bits(self) -> int:
        """Bits of a period."""
        return (2 if self.inverse_repeat else 1) * (2**self.order - 1)

    def check(self, sample_time: float) -> None:
        """Refuse a range without lines, lines from the Nyquist frequency on, and what does not fit into memory."""
        samples = self._bits * self.samples_per_bit
        self.check_size(samples, sample_time)
        self.check_lines(self._lines(sample_time), samples, sample_time)

    def _lines(self, sample_time: float) -> NDArray[np.int64]:
        """Return the harmonics in the frequency range that have power, ascending, shape (lines,)."""
        lowest, highest = self.harmonic_range(self._bits * self.samples_per_bit * sample_time)
        lines = np.arange(lowest, highest + 1)
        if self.inverse_repeat:
            lines = lines[lines % 2 == 1]
            return lines[lines % (self._bits // 2) != 0]  # the sequence's mean, shifted to half the bit rate
        return lines[lines % self._bits != 0]  # a bit has no power at multiples of the bit rate

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the one period."""
        from scipy.signal import max_len_seq

        sequence = 2.0 * max_len_seq(self.order)[0] - 1
        if self.inverse_repeat:
            sequence = np.concatenate([sequence, sequence]) * (1 - 2 * (np.arange(self._bits) % 2))
        return (Period(self.amplitude * np.repeat(sequence, self.samples_per_bit), self._lines(sample_time)),)
