"""Period of a record: whether it repeats as the study states, and the period that is detected."""

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.record_settings import MIN_BLOCKS

MIN_CORRELATION = 0.5
"""Correlation of successive periods below which a record is not periodic."""
GOOD_CORRELATION = 0.9
"""Correlation above which only a miscounted period is suspected, not another period."""
MAX_MISCOUNT = 0.02
"""Largest relative difference of a miscounted period."""
PEAK_RATIO = 0.95
"""Autocorrelation relative to the highest one from which an earlier peak is the period."""
CLEAR_SCATTER_RATIO = 0.1
"""Scatter over the periods relative to that of the stated period below which another period clearly fits better."""
BETTER_SCATTER_RATIO = 0.8
"""The same ratio if the record hardly repeats at the stated period."""
CHANCE_FACTOR = 6.0
"""Margin for noise: divided by the root of the number of samples, it lowers the ratio further."""
MISCOUNT_SAMPLES = 3
"""Number of samples by which a period is likely to be miscounted."""
ROUNDING_SCATTER = 1e-20
"""Scatter relative to the power that is rounding: no period can fit better."""


def check_repeats(cut: Cut, channel: NDArray[np.float64], rate: float, name: str, place: str) -> None:
    """Raise RecordError if a channel does not repeat block after block, or clearly better after another period.

    `rate` is the sample rate [Hz], which with the cut gives the exact number of samples of a block.
    """
    blocks = cut.blocks_of(channel)
    if len(blocks) < MIN_BLOCKS:
        return
    swing = blocks - blocks.mean()
    _check_changes(swing, name, place)
    power = float(np.sum(swing**2)) / len(swing)
    alike = float(np.sum(swing[1:] * swing[:-1])) / (len(swing) - 1) / power if power else 1.0
    used = channel[cut.start :]
    found = detect_period(used)
    other = found is not None and _repeats_better(used, found, cut.samples)
    if alike < MIN_CORRELATION and (other or alike < MIN_CORRELATION / 5):
        remedy = period_hint(found, rate, used.size) if found and other else "check period and sample_rate"
        raise RecordError(
            f"{place}: '{name}' does not repeat after {cut.samples} samples (correlation {alike:.2f}); {remedy}"
        )
    # With mains hum, a good record may repeat slightly better with a very different period.
    likely = found if found and (alike < GOOD_CORRELATION or _is_miscount(cut.samples, found)) else None
    better = find_better_period(used, cut.samples * cut.sample_time * rate, likely)
    if better:
        raise RecordError(
            f"{place}: '{name}' repeats worse after {cut.samples} samples than after {better}; "
            f"{period_hint(better, rate, used.size)}"
        )


def _check_changes(swing: NDArray[np.float64], name: str, place: str) -> None:
    """Raise RecordError if most successive blocks are alike but some are not: these are different realisations."""
    power = np.sqrt(np.sum(swing[1:] ** 2, axis=1) * np.sum(swing[:-1] ** 2, axis=1))
    alike = np.sum(swing[1:] * swing[:-1], axis=1) / np.where(power, power, 1.0)
    changes = np.flatnonzero((alike < MIN_CORRELATION) & (power > 0)) + 1
    if not changes.size or np.median(alike) < GOOD_CORRELATION:
        return
    lengths = np.diff([0, *changes, len(swing)])
    even = len(set(lengths.tolist())) == 1
    remedy = "cut the record there, or use segment"
    if even:
        remedy = (
            f"if realisations follow one another, give periods_per_realisation = {lengths[0]} (--periods {lengths[0]})"
        )
    elif changes.size == 1:
        remedy = f"if it was still settling, give skip_periods = {changes[0]} (--skip-periods {changes[0]})"
    raise RecordError(f"{place}: '{name}' is another signal from period {changes[0] + 1} on; {remedy}")


def period_hint(period: int, rate: float, samples: int | None = None) -> str:
    """Return the hint that names the period [samples] and the option to give; `rate` in Hz, of so many samples."""
    found = f"it seems to repeat every {period} samples ({period / rate:.6g} s)"
    if samples is not None and samples < MIN_BLOCKS * period:
        lacking = MIN_BLOCKS * period - samples
        return f"{found}, and ends {lacking} before {MIN_BLOCKS} periods do: record for longer, or give --aperiodic"
    return f"{found}: give samples_per_period = {period} (--samples-per-period)"


def find_better_period(channel: NDArray[np.float64], stated: float, found: int | None) -> int | None:
    """Return the period [samples] at which a channel repeats clearly better than at the stated one, or None.

    The period that was found is tried, then the stated one's neighbours. Noise, drift and hum scatter alike over the
    periods whichever period is taken; a wrong one adds the signal itself, which slips from period to period.
    """
    ours = period_scatter(channel, stated)
    if ours <= ROUNDING_SCATTER * float(np.var(channel)):
        return None
    limit = CLEAR_SCATTER_RATIO / (1 + CHANCE_FACTOR / np.sqrt(channel.size)) * ours
    near = round(stated)
    ranges = [range(found - 1, found + 2)] if found else []
    for candidates in (*ranges, range(near - MISCOUNT_SAMPLES, near + MISCOUNT_SAMPLES + 1)):
        fitting = {
            period: period_scatter(channel, period) for period in candidates if _is_possible_period(channel, period)
        }
        best = min(fitting, key=fitting.__getitem__, default=None)
        if best is not None and fitting[best] < limit:
            return best
    return None


def period_scatter(channel: NDArray[np.float64], period: float) -> float:
    """Return the variance of a channel over its periods, which may be between samples; it is unbiased for noise."""
    samples = int(period + 0.5)
    starts = np.rint(np.arange(int((channel.size - samples + 0.5) / period) + 1) * period).astype(int)
    starts = starts[starts + samples <= channel.size]
    if starts.size < MIN_BLOCKS:  # the last one lacks its end
        return float(np.mean((channel[samples:] - channel[:-samples]) ** 2)) / 2
    blocks = channel[starts[:, None] + np.arange(samples)]
    return float(np.mean(np.var(blocks, axis=0, ddof=1)))


def detect_period(channel: NDArray[np.float64]) -> int | None:
    """Return the period [samples] that the autocorrelation of a channel shows, or None.

    Each lag is normalised by the power of both stretches that it compares: the correlation is then 1 where they are
    alike, and nowhere more. By the power of the whole channel a lag counts more that happens to compare strong
    stretches, which moves the peak.
    """
    count, last = channel.size, _longest_period(channel.size)
    swing = channel - channel.mean()
    energy = np.cumsum(np.append(0.0, swing**2))
    lags = np.arange(last + 1)
    powers = np.sqrt(energy[count - lags] * (energy[count] - energy[lags]))
    products = np.fft.irfft(np.abs(np.fft.rfft(swing, 2 * count)) ** 2)[: last + 1]
    correlation = products / np.where(powers > 0, powers, np.inf)
    falling = np.flatnonzero(correlation < 0)
    if not falling.size:
        return None
    first = int(falling[0])  # up to here a smooth signal resembles itself anyway
    later = correlation[first:]
    if later.max() < MIN_CORRELATION:
        return None
    start = int(np.argmax(later >= PEAK_RATIO * later.max()))
    run = later[start:]
    end = int(np.argmax(run < PEAK_RATIO * later.max())) or run.size
    return _refine_period(channel, first + start + int(np.argmax(run[:end])))


def _refine_period(channel: NDArray[np.float64], found: int) -> int:
    """Return the period near `found` at which all of the channel repeats best: noise has moved the peak of one lag."""
    while True:
        near = [
            period
            for period in range(found - MISCOUNT_SAMPLES, found + MISCOUNT_SAMPLES + 1)
            if _is_possible_period(channel, period)
        ]
        best = min(near, key=lambda period: period_scatter(channel, period), default=found)
        if best == found or not period_scatter(channel, best) < period_scatter(channel, found):
            return found
        found = best


def _is_miscount(stated: int, found: int) -> bool:
    return abs(round(stated / found) * found - stated) <= MAX_MISCOUNT * stated


def _repeats_better(channel: NDArray[np.float64], found: int, stated: int) -> bool:
    return period_scatter(channel, found) < BETTER_SCATTER_RATIO * period_scatter(channel, stated)


def _is_possible_period(channel: NDArray[np.float64], period: int) -> bool:
    return 2 <= period <= _longest_period(channel.size)


def _longest_period(samples: int) -> int:
    """Return the longest possible period: a record may lack the end of its last one."""
    return min(int(samples / MIN_BLOCKS * (1 + MAX_MISCOUNT)), samples - 1)
