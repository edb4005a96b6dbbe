"""What excitations have in common that excite a whole band at once."""

from abc import ABC

import numpy as np

from fraexp.api import ParameterError, Schedule, param
from fraexp_plugins.excitations.sampling import MOST, MOST_RECORDED
from fraexp_plugins.excitations.settled import SettledExcitation

EDGE = 1e-9
"""Relative distance at which a line counts as within the band."""


class BroadbandExcitation(SettledExcitation, ABC):
    """A band of lines in one period; settled, or with the transient from rest."""

    lowest: float = param("Hz", "lowest frequency", 1.0, above=0)
    highest: float = param("Hz", "highest frequency", 200.0, above=0)
    settle_limit: float = param("s", "time after which settling is given up", 60.0, above=0, at_most=10_000)
    transient: bool = param("", "whether to record from rest, transient included", False)
    whole_periods: int = param("1", "whole periods recorded", 2, at_least=1, at_most=100_000)

    def model_post_init(self, context: object) -> None:
        """Check the band."""
        if self.lowest > self.highest:
            raise ParameterError(
                f"{self.name}.lowest is {self.lowest:g} Hz; expected at most highest, {self.highest:g} Hz"
            )

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic, or record from rest."""
        if self.transient:
            return Schedule(settle_limit=0.0, periods=self.whole_periods)
        return super().schedule

    def band(self, period: float) -> tuple[int, int]:
        """Return the lowest and the highest harmonic of a period [s] that lie in the band."""
        least, most = self.lowest * period * (1 - EDGE), self.highest * period * (1 + EDGE)
        return max(int(np.ceil(least)), 1), int(np.floor(most))

    def check_size(self, samples: float, sample_time: float, realisations: int = 1) -> None:
        """Refuse a band that reaches the Nyquist frequency, and more samples than fit into memory."""
        if self.highest * sample_time >= 0.5:
            raise ParameterError(
                f"{self.name} reaches {self.highest:g} Hz; at a sample time of {sample_time:g} s the Nyquist frequency "
                f"is {0.5 / sample_time:g} Hz: lower 'highest', or shorten loop.sample_time"
            )
        if samples > MOST:
            raise ParameterError(
                f"{self.name} has {samples:,.0f} samples per period at a sample time of {sample_time:g} s; "
                f"expected {MOST:,} at most: shorten the period, or lengthen loop.sample_time"
            )
        recorded = samples * self.whole_periods * realisations
        if recorded > MOST_RECORDED:
            raise ParameterError(
                f"{self.name} records {recorded:,.0f} samples in all; expected {MOST_RECORDED:,} at most: "
                "lower 'whole_periods', or shorten the period"
            )

    def check_lines(self, lines: np.ndarray, samples: int, sample_time: float) -> None:
        """Refuse a band without lines, and a line that rounding has moved to the Nyquist frequency."""
        if not lines.size:
            raise ParameterError(
                f"{self.name} has no line between {self.lowest:g} and {self.highest:g} Hz; "
                "widen the band, or lengthen the period"
            )
        if 2 * lines[-1] >= samples:
            raise ParameterError(
                f"{self.name} has a line at {lines[-1] / (samples * sample_time):g} Hz, the Nyquist frequency at a "
                f"sample time of {sample_time:g} s: lower 'highest', or shorten loop.sample_time"
            )
