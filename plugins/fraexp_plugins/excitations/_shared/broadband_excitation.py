"""Base class of the excitations that excite a whole frequency range at once."""

from abc import ABC

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, Schedule, param
from fraexp_plugins.excitations._shared.sampling import MAX_RECORDED_SAMPLES, MAX_SAMPLES_PER_PERIOD
from fraexp_plugins.excitations._shared.settled_excitation import SettledExcitation

EDGE_TOLERANCE = 1e-9
"""Relative distance beyond an end of the frequency range at which a line still counts as within it."""


class BroadbandExcitation(SettledExcitation, ABC):
    """Lines over a frequency range in one period; settled, or with the transient from rest."""

    min_frequency: float = param("Hz", "lowest frequency", 1.0, above=0)
    max_frequency: float = param("Hz", "highest frequency", 200.0, above=0)
    settling_timeout: float = param("s", "time after which settling is given up", 60.0, above=0, at_most=10_000)
    transient: bool = param("", "whether to record from rest, transient included", False)
    recorded_periods: int = param("1", "whole periods recorded", 2, at_least=1, at_most=100_000)

    def model_post_init(self, context: object) -> None:
        """Check the frequency range."""
        if self.min_frequency > self.max_frequency:
            raise ParameterError(
                f"{self.name}.min_frequency is {self.min_frequency:g} Hz; "
                f"it must not be above max_frequency, {self.max_frequency:g} Hz"
            )

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic, or record from rest."""
        if self.transient:
            return Schedule(settling_timeout=0.0, recorded_periods=self.recorded_periods)
        return super().schedule

    def harmonic_range(self, period: float) -> tuple[int, int]:
        """Return the lowest and the highest harmonic of a period [s] that lie in the frequency range."""
        lowest = self.min_frequency * period * (1 - EDGE_TOLERANCE)
        highest = self.max_frequency * period * (1 + EDGE_TOLERANCE)
        return max(int(np.ceil(lowest)), 1), int(np.floor(highest))

    def check_size(self, samples: float, sample_time: float, realisations: int = 1) -> None:
        """Refuse a range that reaches the Nyquist frequency, and more samples than fit into memory."""
        if self.max_frequency * sample_time >= 0.5:
            raise ParameterError(
                f"{self.name} reaches {self.max_frequency:g} Hz; at a sample time of {sample_time:g} s the Nyquist "
                f"frequency is {0.5 / sample_time:g} Hz: lower 'max_frequency', or shorten loop.sample_time"
            )
        if samples > MAX_SAMPLES_PER_PERIOD:
            raise ParameterError(
                f"{self.name} has {samples:,.0f} samples per period at a sample time of {sample_time:g} s; "
                f"expected {MAX_SAMPLES_PER_PERIOD:,} or fewer: shorten the period, or lengthen loop.sample_time"
            )
        recorded = samples * self.recorded_periods * realisations
        if recorded > MAX_RECORDED_SAMPLES:
            raise ParameterError(
                f"{self.name} records {recorded:,.0f} samples in all; expected {MAX_RECORDED_SAMPLES:,} or fewer: "
                "lower 'recorded_periods', or shorten the period"
            )

    def check_lines(self, lines: NDArray[np.int64], samples: int, sample_time: float) -> None:
        """Refuse a range without lines, and a line that rounding has moved to the Nyquist frequency."""
        if not lines.size:
            raise ParameterError(
                f"{self.name} has no line between {self.min_frequency:g} and {self.max_frequency:g} Hz; "
                "widen the frequency range, or lengthen the period"
            )
        if 2 * lines[-1] >= samples:
            raise ParameterError(
                f"{self.name} has a line at {lines[-1] / (samples * sample_time):g} Hz, the Nyquist frequency at a "
                f"sample time of {sample_time:g} s: lower 'max_frequency', or shorten loop.sample_time"
            )
