"""Whether a record repeats itself as the study says, and after how many samples it seems to."""

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.settings import BLOCKS

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
    found = detected_period(channel[cut.start :])
    other = found is not None and _repeats_better(channel[cut.start :], found, cut.samples)
    if alike < SIMILAR and (other or alike < SIMILAR / 5):
        remedy = seems_to_repeat(found, rate) if found and other else "check period and sample_rate"
        raise RecordError(
            f"{place}: '{name}' does not repeat after {cut.samples} samples (correlation {alike:.2f}); {remedy}"
        )
    # Through hum, a good record may repeat somewhat better after a quite different stretch.
    likely = found if found and (alike < WELL or _miscounted(cut.samples, found)) else None
    better = better_period(channel[cut.start :], cut.samples * cut.sample_time * rate, likely)
    if better:
        raise RecordError(
            f"{place}: '{name}' repeats worse after {cut.samples} samples than after {better}; "
            f"{seems_to_repeat(better, rate)}"
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


def seems_to_repeat(period: int, rate: float) -> str:
    """Return the hint that names the period [samples] and the option to give; `rate` in Hz."""
    return f"it seems to repeat every {period} samples ({period / rate:.6g} s): give period = {period} (--period)"


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
    blocks = channel[starts[:, None] + np.arange(samples)]
    return float(np.mean(np.var(blocks, axis=0, ddof=1)))


def detected_period(channel: np.ndarray) -> int | None:
    """Return the period [samples] that the autocorrelation of a channel shows, or None."""
    count = channel.size
    swing = channel - channel.mean()
    power = np.abs(np.fft.rfft(swing, 2 * count)) ** 2
    correlation = np.fft.irfft(power)[:count] / np.arange(count, 0, -1)
    falling = np.flatnonzero(correlation[: count // 2 + 1] < 0)
    if not falling.size or correlation[0] <= 0:
        return None
    first = int(falling[0])  # up to here a smooth signal resembles itself anyway
    later = correlation[first : count // 2 + 1] / correlation[0]
    if later.max() < SIMILAR:
        return None
    start = int(np.argmax(later >= ALIKE * later.max()))
    run = later[start:]
    end = int(np.argmax(run < ALIKE * later.max())) or run.size
    return first + start + int(np.argmax(run[:end]))


def _miscounted(stated: int, found: int) -> bool:
    return abs(round(stated / found) * found - stated) <= MISCOUNT * stated


def _repeats_better(channel: np.ndarray, found: int, stated: int) -> bool:
    return scatter(channel, found) < BETTER * scatter(channel, stated)


def _fits(channel: np.ndarray, period: int) -> bool:
    return period >= 2 and BLOCKS * period <= channel.size
