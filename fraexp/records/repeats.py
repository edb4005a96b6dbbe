"""Whether a record repeats itself as the study says, and after how many samples it seems to."""

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.record_settings import BLOCKS

SIMILAR = 0.5
"""Correlation of successive periods below which a record does not repeat itself."""
WELL = 0.9
"""Correlation from which only a miscount of the period is suspected, not another period."""
MISCOUNT = 0.02
"""Greatest relative difference that is a miscount."""
ALIKE = 0.95
"""Share of the highest autocorrelation from which an earlier peak is taken for the period."""
CLEARLY = 0.1
"""Scatter over the periods, as a share of that at the stated period, below which another period fits clearly better."""
BETTER = 0.8
"""The same share where the record hardly repeats at the stated period."""
CHANCE = 6.0
"""Over the root of the number of samples: how much further below the share must be, for noise alone to stay above."""
NEIGHBOURS = 3
"""Samples by which a period is likely to be miscounted."""
ROUNDING = 1e-20
"""Scatter over power that is rounding: no period can fit better."""


def check_repeats(cut: Cut, channel: np.ndarray, rate: float, name: str, place: str) -> None:
    """Raise RecordError if a channel does not repeat block after block, or clearly better after another period.

    `rate` is the sample rate [Hz]: with it the cut tells how many samples its blocks would have exactly.
    """
    blocks = cut.blocks_of(channel)
    if len(blocks) < BLOCKS:
        return
    swing = blocks - blocks.mean()
    _check_changes(swing, name, place)
    power = float(np.sum(swing**2)) / len(swing)
    alike = float(np.sum(swing[1:] * swing[:-1])) / (len(swing) - 1) / power if power else 1.0
    used = channel[cut.start :]
    found = detected_period(used)
    other = found is not None and _repeats_better(used, found, cut.samples)
    if alike < SIMILAR and (other or alike < SIMILAR / 5):
        remedy = seems_to_repeat(found, rate, used.size) if found and other else "check period and sample_rate"
        raise RecordError(
            f"{place}: '{name}' does not repeat after {cut.samples} samples (correlation {alike:.2f}); {remedy}"
        )
    # Through hum, a good record may repeat somewhat better after a quite different stretch.
    likely = found if found and (alike < WELL or _miscounted(cut.samples, found)) else None
    better = better_period(used, cut.samples * cut.sample_time * rate, likely)
    if better:
        raise RecordError(
            f"{place}: '{name}' repeats worse after {cut.samples} samples than after {better}; "
            f"{seems_to_repeat(better, rate, used.size)}"
        )


def _check_changes(swing: np.ndarray, name: str, place: str) -> None:
    """Raise RecordError if most successive blocks are alike and some are not: realisations that follow one another."""
    power = np.sqrt(np.sum(swing[1:] ** 2, axis=1) * np.sum(swing[:-1] ** 2, axis=1))
    alike = np.sum(swing[1:] * swing[:-1], axis=1) / np.where(power, power, 1.0)
    changes = np.flatnonzero((alike < SIMILAR) & (power > 0)) + 1
    if not changes.size or np.median(alike) < WELL:
        return
    lengths = np.diff([0, *changes, len(swing)])
    even = len(set(lengths.tolist())) == 1
    remedy = "cut the record there, or use segment"
    if even:
        remedy = f"if realisations follow one another, give periods = {lengths[0]} (--periods {lengths[0]})"
    elif changes.size == 1:
        remedy = f"if it was still settling, give skip = {changes[0]} (--skip {changes[0]})"
    raise RecordError(f"{place}: '{name}' is another signal from period {changes[0] + 1} on; {remedy}")


def seems_to_repeat(period: int, rate: float, samples: int | None = None) -> str:
    """Return the hint that names the period [samples] and the option to give; `rate` in Hz, of so many samples."""
    found = f"it seems to repeat every {period} samples ({period / rate:.6g} s)"
    if samples is not None and samples < BLOCKS * period:
        lacking = BLOCKS * period - samples
        return f"{found}, and ends {lacking} before {BLOCKS} periods do: record for longer, or give --not-periodic"
    return f"{found}: give period = {period} (--period)"


def better_period(channel: np.ndarray, stated: float, found: int | None) -> int | None:
    """Return the period [samples] at which a channel repeats clearly better than at the stated one, or None.

    The period that was found is tried, then the stated one's neighbours. Noise, drift and hum scatter alike over the
    periods whichever period is taken; a wrong one adds the signal itself, which slips from period to period.
    """
    ours = scatter(channel, stated)
    if ours <= ROUNDING * float(np.var(channel)):
        return None
    limit = CLEARLY / (1 + CHANCE / np.sqrt(channel.size)) * ours
    near = round(stated)
    ranges = [range(found - 1, found + 2)] if found else []
    for candidates in (*ranges, range(near - NEIGHBOURS, near + NEIGHBOURS + 1)):
        fitting = {period: scatter(channel, period) for period in candidates if _fits(channel, period)}
        best = min(fitting, key=fitting.__getitem__, default=None)
        if best is not None and fitting[best] < limit:
            return best
    return None


def scatter(channel: np.ndarray, period: float) -> float:
    """Return the variance of a channel over its periods, which may be between samples; it is unbiased for noise."""
    samples = int(period + 0.5)
    starts = np.rint(np.arange(int((channel.size - samples + 0.5) / period) + 1) * period).astype(int)
    starts = starts[starts + samples <= channel.size]
    if starts.size < BLOCKS:  # the last one lacks its end
        return float(np.mean((channel[samples:] - channel[:-samples]) ** 2)) / 2
    blocks = channel[starts[:, None] + np.arange(samples)]
    return float(np.mean(np.var(blocks, axis=0, ddof=1)))


def detected_period(channel: np.ndarray) -> int | None:
    """Return the period [samples] that the autocorrelation of a channel shows, or None.

    Each lag is normalised by the power of both stretches that it compares: the correlation is then 1 where they are
    alike, and nowhere more. By the power of the whole channel a lag counts more that happens to compare strong
    stretches, which moves the peak.
    """
    count, last = channel.size, _longest(channel.size)
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
    if later.max() < SIMILAR:
        return None
    start = int(np.argmax(later >= ALIKE * later.max()))
    run = later[start:]
    end = int(np.argmax(run < ALIKE * later.max())) or run.size
    return _refined(channel, first + start + int(np.argmax(run[:end])))


def _refined(channel: np.ndarray, found: int) -> int:
    """Return the period near `found` at which all of the channel repeats best: noise has moved the peak of one lag."""
    while True:
        near = [period for period in range(found - NEIGHBOURS, found + NEIGHBOURS + 1) if _fits(channel, period)]
        best = min(near, key=lambda period: scatter(channel, period), default=found)
        if best == found or not scatter(channel, best) < scatter(channel, found):
            return found
        found = best


def _miscounted(stated: int, found: int) -> bool:
    return abs(round(stated / found) * found - stated) <= MISCOUNT * stated


def _repeats_better(channel: np.ndarray, found: int, stated: int) -> bool:
    return scatter(channel, found) < BETTER * scatter(channel, stated)


def _fits(channel: np.ndarray, period: int) -> bool:
    return 2 <= period <= _longest(channel.size)


def _longest(samples: int) -> int:
    """Return the longest period that is looked for: a record may lack the end of its last one."""
    return min(int(samples / BLOCKS * (1 + MISCOUNT)), samples - 1)
