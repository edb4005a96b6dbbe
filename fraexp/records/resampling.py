"""Channels brought to one uniform clock, by interpolation between their time stamps.

What interpolation adds differs from period to period, because the stamps do: the scatter over the periods, and with
it the confidence band, contains it. Input and output of equal stamps are interpolated alike, so that a common loss of
amplitude near the Nyquist frequency cancels in their ratio.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data.sweep import Plain
from fraexp.errors import RecordError
from fraexp.records.timebase import (
    GAP_RATIO,
    MAX_JITTER,
    MAX_LOST,
    TimeStamps,
    check_ascending,
    examine_stamps,
    stamps_text,
    uneven_text,
)

Interpolation = Callable[[NDArray[Any], NDArray[np.float64], NDArray[np.float64]], NDArray[Any]]
"""Signature of a method: values, their time stamps [s], and the instants [s] at which it returns the values."""
PASSBAND_RATIO = 0.8
"""Highest frequency relative to the Nyquist frequency at which a channel that is sampled faster keeps its amplitude."""
STOPBAND_ATTENUATION_DB = 80.0
FASTER_RATIO = 1.5
"""Rate of a channel relative to the common one from which it is low-pass filtered before."""
RATE_TOLERANCE = 0.01
"""Relative difference by which the common rate may exceed that of the slowest channel."""


@dataclass(frozen=True)
class UniformClock:
    """The clock to which channels are brought."""

    start: float
    """First instant [s], on the clock of the stamps."""
    rate: float
    """Sample rate [Hz]."""
    samples: int
    method: str

    @property
    def instants(self) -> NDArray[np.float64]:
        """Its instants [s], shape (samples,)."""
        return self.start + np.arange(self.samples) / self.rate

    def as_plain(self) -> Plain:
        """Return the plain data that identify it."""
        return {"start": self.start, "rate": self.rate, "samples": self.samples, "method": self.method}


def plan_clock(
    times: Mapping[str, NDArray[np.float64]], rate: float | None, period_time: float | None, method: str, place: str
) -> UniformClock:
    """Return the common clock of channels with these time stamps [s].

    Its rate is the stated one, or that of the slowest channel, changed so that a stated period is a whole number of
    samples. RecordError if stamps do not ascend, leave too long a gap, or are too few for the stated rate.
    """
    found = {name: _checked_stamps(time, f"{place}: the time of '{name}'") for name, time in times.items()}
    slowest = max(found, key=lambda name: found[name].period)
    nominal = 1 / found[slowest].period
    if rate is not None and rate > (1 + RATE_TOLERANCE) * nominal:
        raise RecordError(
            f"{place}: sample_rate is {rate:.6g} Hz, but '{slowest}' was sampled at {nominal:.6g} Hz; expected no more"
        )
    common = rate or nominal
    if period_time:
        common = max(round(period_time * common), 1) / period_time
    margins = {name: _filter_length(1 / stamps.period, common) / 2 * stamps.period for name, stamps in found.items()}
    start = max(float(time[0]) + margins[name] for name, time in times.items())
    own = times[slowest]  # at its own stamps the slowest channel is exact
    start = float(own[min(int(np.searchsorted(own, start - MAX_JITTER / nominal)), own.size - 1)])
    end = min(float(time[-1]) - margins[name] for name, time in times.items())
    samples = int(np.floor((end - start) * common * (1 + 1e-12))) + 1
    if samples < 2:
        raise RecordError(f"{place}: the channels have no time in common; expected records of the same instants")
    return UniformClock(start, common, samples, method)


def _checked_stamps(time: NDArray[np.float64], place: str) -> TimeStamps:
    check_ascending(time, place)
    found = examine_stamps(time)
    if np.diff(time).max() > (MAX_LOST + GAP_RATIO) * found.period:
        raise RecordError(f"{place} {uneven_text(time)}")
    return found


def resample(values: NDArray[np.float64], time: NDArray[np.float64], clock: UniformClock) -> NDArray[np.float64]:
    """Return a channel at the instants of the clock, shape (samples,).

    A channel that is sampled faster is first freed from what lies above the common Nyquist frequency, by a
    symmetric filter that does not shift it in time.
    """
    own = 1 / examine_stamps(time).period
    taps = _filter_length(own, clock.rate)
    if taps:
        even = time[0] + np.arange(int((time[-1] - time[0]) * own) + 1) / own
        values, time = _low_pass(METHODS[clock.method](values, time, even), own, clock.rate, taps), even
    return METHODS[clock.method](values, time, clock.instants)


def hold_values(values: NDArray[np.float64], time: NDArray[np.float64], clock: UniformClock) -> NDArray[np.float64]:
    """Return the last value before each instant of the clock, for columns that number or select samples."""
    places = np.searchsorted(time, clock.instants + MAX_JITTER / clock.rate, side="right") - 1
    return np.asarray(values[np.clip(places, 0, values.size - 1)])


def interpolation_error(time: NDArray[np.float64], frequency: float, clock: UniformClock) -> float:
    """Return the root mean square error of interpolating a sine of this frequency [Hz], relative to its amplitude."""
    turning = np.exp(2j * np.pi * frequency * (time - clock.start))
    exact = np.exp(2j * np.pi * frequency * (clock.instants - clock.start))
    return float(np.sqrt(np.mean(np.abs(METHODS[clock.method](turning, time, clock.instants) - exact) ** 2)))


def resampling_text(time: NDArray[np.float64], frequency: float, clock: UniformClock) -> str:
    """Return in words what was resampled, how, and how exactly at the highest line [Hz]."""
    error, reason = interpolation_error(time, frequency, clock), stamps_text(examine_stamps(time))
    is_random = examine_stamps(time).jitter > MAX_JITTER or examine_stamps(time).lost_count
    share = "and the scatter over periods contains it" if is_random else "which the confidence band does not contain"
    return (
        f"resampled to {clock.rate:.6g} Hz by {DESCRIPTIONS[clock.method]} ({reason}): at "
        f"{frequency:.4g} Hz, the highest line, it is exact to {error:.1g} of the amplitude, {share}"
    )


def _filter_length(own: float, common: float) -> int:
    """Return the taps of the filter of a channel with its own rate [Hz]; 0 if it needs none."""
    from scipy.signal import kaiserord

    if own < FASTER_RATIO * common:
        return 0
    width = 2 * (1 - PASSBAND_RATIO) * common / own
    return int(kaiserord(STOPBAND_ATTENUATION_DB, width)[0]) | 1


def _low_pass(values: NDArray[np.float64], own: float, common: float, taps: int) -> NDArray[np.float64]:
    from scipy.signal import fftconvolve, firwin, kaiser_beta

    window = ("kaiser", kaiser_beta(STOPBAND_ATTENUATION_DB))
    return np.asarray(fftconvolve(values, firwin(taps, common / own, window=window), mode="same"))


def _cubic(values: NDArray[Any], time: NDArray[np.float64], instants: NDArray[np.float64]) -> NDArray[Any]:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time - time[0], values)(instants - time[0]))


def _linear(values: NDArray[Any], time: NDArray[np.float64], instants: NDArray[np.float64]) -> NDArray[Any]:
    return np.interp(instants, time, values)


METHODS: Mapping[str, Interpolation] = {"cubic": _cubic, "linear": _linear}
DESCRIPTIONS = {"cubic": "cubic splines", "linear": "straight lines"}
