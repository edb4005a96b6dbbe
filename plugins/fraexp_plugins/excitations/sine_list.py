"""Sines of which each has an amplitude, and a number of recorded periods, of its own."""

from typing import ClassVar

import numpy as np

from fraexp.api import ParameterError, Period, param
from fraexp_plugins.excitations._shared import sampling
from fraexp_plugins.excitations._shared.settled_excitation import SettledExcitation


class SineList(SettledExcitation, name="sine_list", version=1):
    """One sine after another, each at its own frequency and amplitude, and recorded as often as it needs.

    It is what `excitation_design` returns: a stepped sine spends as much on every frequency. Frequencies are moved as
    those of `stepped_sine` are, so that whole cycles fit into whole samples.

    With `interleaved_cycles` = c a period consists of c cycles in a number of samples that has no factor in common with
    c, as tests of digitizers do (IEEE Std 1057, 2007). All samples then meet the sine at different phases, where c
    equal periods meet it c times at the same ones. An encoder without noise tells nothing new when a motion repeats
    itself: it rounds it in the same way. Where noise covers the encoder's steps repeated periods tell as much, settle
    sooner, and show their scatter.
    """

    frequencies: tuple[float, ...] = param("Hz", "frequencies, in the order in which they are run")
    amplitudes: tuple[float, ...] = param("N", "amplitude at each of them, or one for all")
    period_counts: tuple[int, ...] = param(
        "1", "number of whole periods recorded at each of them; recorded_periods for all if it is not given", ()
    )
    interleaved_cycles: int = param(
        "1", "cycles of a period that interleave the sampling instants; 1 for the shortest period", 1, at_least=1
    )

    presets: ClassVar[dict[str, dict[str, object]]] = {
        "three_sines": {
            "frequencies": [2.0, 20.0, 100.0], "amplitudes": [12.0, 24.0, 24.0], "period_counts": [8, 4, 1],
        }
    }  # fmt: skip

    def model_post_init(self, context: object) -> None:
        """Check that there is an amplitude, and a number of periods, for each frequency."""
        count = len(self.frequencies)
        if not count:
            raise ParameterError("sine_list has no frequencies; expected one or more")
        for name in ("frequencies", "amplitudes", "period_counts"):
            if min(getattr(self, name), default=1) <= 0:
                raise ParameterError(f"sine_list.{name} has a number of 0 or less; expected numbers above 0")
        if len(self.amplitudes) not in (1, count):
            raise ParameterError(
                f"sine_list has {count} frequencies and {len(self.amplitudes)} amplitudes; expected {count}, or one"
            )
        if len(self.period_counts) not in (0, count):
            raise ParameterError(
                f"sine_list has {count} frequencies and {len(self.period_counts)} period_counts; expected {count}, or "
                "none"
            )

    def block(self, frequency: float, sample_time: float) -> sampling.CoherentBlock:
        """Return the whole cycles in whole samples of one period of a frequency [Hz]."""
        if self.interleaved_cycles == 1:
            return sampling.coherent_block(frequency * sample_time)
        return sampling.interleaved_block(frequency * sample_time, self.interleaved_cycles)

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on, and periods and records beyond the memory."""
        sampling.check_nyquist(self.name, max(self.frequencies), sample_time, "lower it")
        longest = self.interleaved_cycles / (min(self.frequencies) * sample_time)
        remedy = "leave the frequency out, or lower interleaved_cycles"
        sampling.check_period(self.name, longest, sample_time, remedy, min(self.frequencies))
        recorded = sum(
            count * self.block(frequency, sample_time).samples
            for frequency, count in zip(self.frequencies, self._counts, strict=True)
        )
        sampling.check_recorded(self.name, recorded, "lower period_counts or recorded_periods")

    @property
    def _counts(self) -> tuple[int, ...]:
        return self.period_counts or (self.recorded_periods,) * len(self.frequencies)

    def periods(self, sample_time: float) -> tuple[Period, ...]:
        """Return one period of each sine, and how often it is recorded."""
        amplitudes = np.broadcast_to(np.array(self.amplitudes), (len(self.frequencies),)).tolist()
        found = []
        for frequency, amplitude, count in zip(self.frequencies, amplitudes, self._counts, strict=True):
            block = self.block(frequency, sample_time)
            found.append(
                Period(amplitude * sampling.sine_wave(block), np.array([block.cycles]), recorded_periods=count)
            )
        return tuple(found)
