"""Pseudo-random binary sequence: a force that jumps between two values."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from fraexp.api import Period, param
from fraexp_plugins.excitations.broadband import BroadbandExcitation


class Prbs(BroadbandExcitation, name="prbs", version=1):
    """u = ±A, a maximum length sequence of 2ⁿ - 1 bits, each held over `clock` samples.

    K. Godfrey (ed.), Perturbation Signals for System Identification, Prentice Hall 1993, chapter 1; S. W. Golomb,
    Shift Register Sequences, Holden-Day 1967. Its lines have the amplitude 2A √(N + 1)/N, N = 2ⁿ - 1, times the
    bit's |sinc(f clock Ts)/sinc(f Ts)|; the mean is A/N. With `inverse_repeat` the sequence is run twice with every
    other bit inverted: then the second half of the period is the first one with its sign changed and odd lines alone
    are excited.

    To be used where the peak force is what is limited: no wave of this peak has a greater root mean square value (the
    crest factor is 1). Lines are those from `lowest` to `highest` that have power; beyond them it excites the machine
    too, which a multisine does not. Not to be used for a best linear approximation over realisations: its phases
    cannot be drawn, and the jumps excite what is not asked for.
    """

    expected_failures: ClassVar[Mapping[str, str]] = {
        "whole-periods": "a binary wave has energy beyond the band of interest as well"
    }

    amplitude: float = param("N", "amplitude A", above=0)
    order: int = param("1", "order n of the shift register", 12, at_least=3, at_most=20)
    clock: int = param("1", "samples of a bit", 1, at_least=1, at_most=10_000)
    inverse_repeat: bool = param("", "whether odd lines alone are excited", True)

    @property
    def _bits(self) -> int:
        """Bits of a period."""
        return (2 if self.inverse_repeat else 1) * (2**self.order - 1)

    def check(self, sample_time: float) -> None:
        """Refuse a band without lines, lines from the Nyquist frequency on, and what does not fit into memory."""
        samples = self._bits * self.clock
        self.check_size(samples, sample_time)
        self.check_lines(self._lines(sample_time), samples, sample_time)

    def _lines(self, sample_time: float) -> np.ndarray:
        """Return the harmonics in the band that have power, ascending, shape (lines,)."""
        least, most = self.band(self._bits * self.clock * sample_time)
        lines = np.arange(least, most + 1)
        if self.inverse_repeat:
            lines = lines[lines % 2 == 1]
            return lines[lines % (self._bits // 2) != 0]  # the mean of the sequence, turned to half the clock
        return lines[lines % self._bits != 0]  # a bit has no power at multiples of the clock

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return the one period."""
        from scipy.signal import max_len_seq

        sequence = 2.0 * max_len_seq(self.order)[0] - 1
        if self.inverse_repeat:
            sequence = np.concatenate([sequence, sequence]) * (1 - 2 * (np.arange(self._bits) % 2))
        return (Period(self.amplitude * np.repeat(sequence, self.clock), self._lines(sample_time)),)
