"""What excitations have in common that go from one frequency to the next."""

from abc import ABC
from collections import Counter
from functools import cached_property
from operator import itemgetter

import numpy as np

from fraexp.api import ParameterError, Schedule, param
from fraexp_plugins.excitations.sampling import LEAST_CYCLES, MOST, MOST_RECORDED
from fraexp_plugins.excitations.settled import SettledExcitation


class SteppedExcitation(SettledExcitation, ABC):
    """One frequency after another on a logarithmic grid, each in its periodic state."""

    lowest: float = param("Hz", "lowest frequency", 1.0, above=0)
    highest: float = param("Hz", "highest frequency", 200.0, above=0)
    points: int = param("1", "number of frequencies, spaced logarithmically", 100, at_least=1, at_most=100_000)
    frequencies: tuple[float, ...] = param("Hz", "frequencies in place of lowest, highest and points", ())
    record_time: float = param("s", "time recorded at least", 0.0, at_least=0, at_most=10_000)

    def model_post_init(self, context: object) -> None:
        """Check the grid."""
        if not self.frequencies and self.lowest > self.highest:
            raise ParameterError(
                f"{self.name}.lowest is {self.lowest:g} Hz; expected at most highest, {self.highest:g} Hz"
            )
        if min(self.frequencies, default=1.0) <= 0:
            raise ParameterError(f"{self.name}.frequencies must be above 0 Hz")
        frequency, count = max(Counter(self.frequencies).items(), key=itemgetter(1), default=(0.0, 0))
        if count > 1:
            raise ParameterError(
                f"{self.name}.frequencies has {frequency:.10g} Hz {count} times; expected each once: "
                "for more periods raise 'whole_periods'"
            )

    @cached_property
    def grid(self) -> np.ndarray:
        """The frequencies asked for [Hz], shape (n,)."""
        if self.frequencies:
            return np.array(self.frequencies)
        return np.geomspace(self.lowest, self.highest, self.points)

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on, and periods that do not fit into memory."""
        longest = 1 / max(self.grid.min() * sample_time, LEAST_CYCLES)
        if longest > MOST:
            raise ParameterError(
                f"{self.name} has {longest:.3g} samples per period at {self.grid.min():g} Hz and a sample time of "
                f"{sample_time:g} s; expected {MOST:,} at most: raise 'lowest', or lengthen loop.sample_time"
            )
        recorded = np.maximum(self.whole_periods / self.grid, self.record_time).sum() / sample_time
        if recorded > MOST_RECORDED:
            raise ParameterError(
                f"{self.name} records {recorded:.3g} samples at {self.grid.size:,} frequencies; expected "
                f"{MOST_RECORDED:,} at most: lower 'points', 'whole_periods' or 'record_time', or raise 'lowest'"
            )
        if self.grid.max() * sample_time >= 0.5:
            raise ParameterError(
                f"{self.name} reaches {self.grid.max():g} Hz; at a sample time of {sample_time:g} s "
                f"the Nyquist frequency is {0.5 / sample_time:g} Hz: lower 'highest', or shorten loop.sample_time"
            )

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(self.ramp, self.tolerance, self.settle_limit, self.whole_periods, self.record_time)
