"""Base classes of the excitations that settle until periodic: of lines over a range, and of one sine after another."""

from abc import ABC
from collections import Counter
from fractions import Fraction
from functools import cached_property
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Excitation, ParameterError, Schedule, param
from fraexp_plugins.excitations._shared.sampling import (
    FREQUENCY_TOLERANCE,
    MIN_CYCLES_PER_SAMPLE,
    CoherentBlock,
    check_nyquist,
    check_period,
    check_profile,
    check_range,
    check_recorded,
    coherent_block,
)

MAX_SETTLING_TOLERANCE = 0.1
"""Greatest tolerance: the error of a response is about half of it, that of the proposed method up to three times it."""


class SettledExcitation(Excitation, ABC):
    """Whole periods, recorded once successive ones agree."""

    ramp: float = param("s", "time over which the amplitude rises", 0.1, at_least=0, at_most=1000)
    settling_tolerance: float = param(
        "1",
        "relative difference of successive periods that counts as settled",
        1e-5,
        above=0,
        at_most=MAX_SETTLING_TOLERANCE,
    )
    settling_timeout: float = param("s", "time after which settling is given up", 30.0, above=0, at_most=10_000)
    recorded_periods: int = param("1", "minimum number of whole periods recorded", 1, at_least=1, at_most=100_000)

    def model_post_init(self, context: object) -> None:
        """Check the amplitude profile of an excitation that has one."""
        check_profile(self.name, getattr(self, "amplitude_profile", ()))

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(self.ramp, self.settling_tolerance, self.settling_timeout, self.recorded_periods)


MAX_JOINT_SHIFT = 2 * FREQUENCY_TOLERANCE
"""Relative distance up to which two frequencies may be moved to the same one."""


class SteppedExcitation(SettledExcitation, ABC):
    """One frequency after another on a logarithmic grid, each in its periodic state."""

    min_frequency: float = param("Hz", "lowest frequency", 1.0, above=0)
    max_frequency: float = param("Hz", "highest frequency", 200.0, above=0)
    points: int = param("1", "number of frequencies, spaced logarithmically", 100, at_least=1, at_most=100_000)
    frequencies: tuple[float, ...] = param("Hz", "frequencies in place of min_frequency, max_frequency and points", ())
    min_record_time: float = param("s", "minimum time recorded", 0.0, at_least=0, at_most=10_000)

    def model_post_init(self, context: object) -> None:
        """Check the grid."""
        super().model_post_init(context)
        if not self.frequencies:
            check_range(self.name, self.min_frequency, self.max_frequency)
        if min(self.frequencies, default=1.0) <= 0:
            raise ParameterError(f"{self.name}.frequencies must be above 0 Hz")
        frequency, count = max(Counter(self.frequencies).items(), key=itemgetter(1), default=(0.0, 0))
        if count > 1:
            raise ParameterError(
                f"{self.name}.frequencies has {frequency:.10g} Hz {count} times; expected each once: "
                "for more periods raise 'recorded_periods'"
            )

    @cached_property
    def grid(self) -> NDArray[np.float64]:
        """The frequencies asked for [Hz], shape (n,)."""
        if self.frequencies:
            return np.array(self.frequencies)
        return np.geomspace(self.min_frequency, self.max_frequency, self.points)

    def check(self, sample_time: float) -> None:
        """Refuse frequencies from the Nyquist frequency on, those that are alike, and periods beyond the memory."""
        longest = 1 / max(self.grid.min() * sample_time, MIN_CYCLES_PER_SAMPLE)
        remedy = "raise 'min_frequency', or lengthen loop.sample_time"
        check_period(self.name, longest, sample_time, remedy, float(self.grid.min()))
        recorded = np.maximum(self.recorded_periods / self.grid, self.min_record_time).sum() / sample_time
        remedy = "lower 'points', 'recorded_periods' or 'min_record_time', or raise 'min_frequency'"
        check_recorded(self.name, recorded, remedy)
        check_nyquist(self.name, float(self.grid.max()), sample_time)
        self._check_distances(sample_time)

    def _check_distances(self, sample_time: float) -> None:
        """Refuse frequencies that are so close that they are moved to the same one."""
        grid = np.sort(self.grid)
        is_close = np.diff(grid) <= MAX_JOINT_SHIFT * grid[1:]
        first_with: dict[Fraction, float] = {}
        for frequency in grid[np.append(is_close, False) | np.append(False, is_close)].tolist():
            block = self.block(frequency, sample_time)
            moved = Fraction(block.cycles, block.samples)
            if moved in first_with:
                fitting = 1 + int(np.log(grid[-1] / grid[0]) / -np.log1p(-MAX_JOINT_SHIFT))
                raise ParameterError(
                    f"{self.name} has {first_with[moved]:.10g} and {frequency:.10g} Hz, and both become "
                    f"{float(moved) / sample_time:.10g} Hz, where whole periods fit into whole samples of "
                    f"{sample_time:g} s; expected frequencies farther apart, by {MAX_JOINT_SHIFT:.1%} or more: "
                    + ("leave one of them out" if self.frequencies else f"lower 'points' to {fitting:,} or fewer")
                )
            first_with[moved] = frequency

    def block(self, frequency: float, sample_time: float) -> CoherentBlock:
        """Return the whole cycles in whole samples at which a frequency [Hz] of the grid is run."""
        return coherent_block(frequency * sample_time)

    @property
    def schedule(self) -> Schedule:
        """Settle until periodic."""
        return Schedule(
            self.ramp, self.settling_tolerance, self.settling_timeout, self.recorded_periods, self.min_record_time
        )


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
        super().model_post_init(context)
        check_range(self.name, self.min_frequency, self.max_frequency)

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
        check_nyquist(self.name, self.max_frequency, sample_time)
        check_period(self.name, samples, sample_time, "shorten the period, or lengthen loop.sample_time")
        recorded = samples * self.recorded_periods * realisations
        check_recorded(self.name, recorded, "lower 'recorded_periods', or shorten the period")

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
