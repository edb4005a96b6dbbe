"""What repeats in a record: its period, the lines that are excited in it, and its realisations."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fraexp.data.findings import Finding, Quantity
from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.record_settings import MIN_BLOCKS, RecordSettings

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
SIGNIFICANCE_RATIO = 20.0
"""Power of a line relative to the variance of its mean above which it is more than noise."""
NEGLIGIBLE_RATIO = 1e-3
"""Amplitude relative to the strongest line below which a line is not excited."""
ROUNDING_RATIO = 1e-9
"""Amplitude relative to the strongest line up to which it is rounding."""
MIN_GAP_RATIO = 3.0
"""Least ratio of amplitudes that separates excited lines from distortion."""
WEAK_RATIO = 0.03
"""Amplitude relative to the median of the excited lines below which a line is much weaker."""
EDGE_LINES = 5
"""Lines on either side of the edge of an excited frequency range that show it."""
MAX_SLOPE = 3
"""Power of the frequency with which an excitation under feedback may rise or fall."""
POOLED_LINES = 33
"""Neighbouring lines whose scatter is pooled: that of one line may be small by chance."""
MAX_LINE_DIFFERENCE = 0.2
"""Share of lines in which realisations of one multisine may differ by noise."""
MIN_POWER_SHARE = 0.5
"""Share of the input's power at the lines of the reference below which something else excites the machine."""
MAX_LEVEL_RATIO = 1.2
"""Largest ratio of rms values of inputs at one level."""


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


def split_levels(run: tuple[int, int], channel: NDArray[np.float64], period: float) -> list[tuple[int, int]]:
    """Return the parts of a run [samples] between whose periods an input changes its level; by default the run itself.

    A part has two periods or more: a single one may be a transient, or a pause.
    """
    edges = run[0] + np.rint(np.arange(int((run[1] - run[0]) / period) + 1) * period).astype(int)
    levels = np.array([np.std(channel[start:stop]) for start, stop in pairwise(edges.tolist())])
    low, high = np.minimum(levels[1:], levels[:-1]), np.maximum(levels[1:], levels[:-1])
    parts = np.split(np.arange(levels.size), np.flatnonzero(high > MAX_LEVEL_RATIO * low) + 1)
    kept = [part for part in parts if part.size >= MIN_BLOCKS and levels[part].min() > 0]
    return [(int(edges[of[0]]), int(edges[of[-1] + 1])) for of in kept] if len(kept) > 1 else [run]


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


def missing_period_error(ways: Sequence[str], channel: NDArray[np.float64], rate: float, place: str) -> RecordError:
    """Return the error for a record without a period, or with several ways to state it."""
    if ways:
        return RecordError(f"{place}: {' and '.join(ways)} are both given; expected one of them")
    found = detect_period(channel)
    seems = f": {period_hint(found, rate)}" if found else ", as samples_per_period = N (--samples-per-period N)"
    return RecordError(
        f"{place}: give samples_per_period or period_time (s) of a periodic record{seems}; "
        "steps or frequency_column (--frequency) of a stepped sine; or periodic = false (--aperiodic) if it "
        "does not repeat itself"
    )


@dataclass(frozen=True)
class ExcitedLines:
    """The excited lines of a signal."""

    lines: Sequence[int]
    anywhere: Sequence[int] = ()
    """Excited lines inside and outside of the requested range."""
    left_out: int = 0
    """Number of other lines above the noise, if some of them are not much weaker."""
    doubtful: int = 0
    """Number of lines that are much weaker than the others."""


def find_injected_lines(blocks: NDArray[np.float64], band: tuple[float, float]) -> ExcitedLines:
    """Return the lines of a signal that neither friction nor feedback touches, in blocks of shape (blocks, samples).

    All lines above its noise and rounding are excited. Rounding repeats itself: below a thousandth of the
    greatest line, lines count if no gap of a factor of 3 parts them from the others.
    """
    amplitude, scatter = line_spectrum(blocks)
    greatest = amplitude.max(initial=0.0)
    above = (amplitude**2 > SIGNIFICANCE_RATIO * scatter) & (amplitude > ROUNDING_RATIO * greatest)
    above &= amplitude > _gap_level(amplitude[above], NEGLIGIBLE_RATIO * greatest)
    lines = np.flatnonzero(above) + 1
    return ExcitedLines(_lines_within(lines, band), lines.tolist())


def find_excited_lines(
    blocks: NDArray[np.float64], band: tuple[float, float] = (1, np.inf), stated: bool = False
) -> ExcitedLines:
    """Return the lines above noise and distortion in the blocks of an input, shape (blocks, samples).

    A controller's input also contains lines that friction has made. Where the lines above the noise fall by more than a
    factor of 3 from one to the next and stay low, at either end, all beyond is friction's. The others are sorted by
    amplitude and cut at their widest gap, if that is at least a factor of 3. Lines outside of the range indicate
    friction within it too, unless both ends of it are `stated`.
    """
    amplitude, scatter = line_spectrum(blocks)
    significant = (amplitude**2 > SIGNIFICANCE_RATIO * scatter) & (
        amplitude > NEGLIGIBLE_RATIO * amplitude.max(initial=0.0)
    )
    above = np.flatnonzero(significant)
    kept = _between_edges(amplitude, above)
    kept = kept[amplitude[kept] > _gap_level(amplitude[kept], np.inf)]
    weak = _weak_level(amplitude[kept])
    lines, others = (
        _lines_within(kept + 1, band),
        _lines_within(np.setdiff1d(above, kept) + 1, band if stated else (1, np.inf)),
    )
    strong = (
        any(amplitude[line - 1] > weak for line in others) and len(blocks) > 1
    )  # the noise is unknown with one block
    doubtful = sum(bool(amplitude[line - 1] < weak) for line in lines)
    return ExcitedLines(lines, (kept + 1).tolist(), len(others) if strong else 0, doubtful)


def _weak_level(amplitude: NDArray[np.float64]) -> float:
    """Return the level below which a line is much weaker: than most lines, or than the strongest if most are so."""
    if not amplitude.size:
        return 0.0
    usual, strongest = float(np.median(amplitude)), float(amplitude.max())
    return WEAK_RATIO * (strongest if usual < WEAK_RATIO * strongest else usual)


def _lines_within(lines: NDArray[np.intp], band: tuple[float, float]) -> list[int]:
    return [int(line) for line in lines if band[0] <= line <= band[1]]


def _gap_level(amplitude: NDArray[np.float64], highest: float) -> float:
    """Return the level just below the widest gap of the amplitudes, if that is one and lies below `highest`; else 0."""
    levels = np.sort(amplitude)
    ratios = np.where(levels[:-1] < highest, levels[1:] / levels[:-1], 0.0)
    return float(levels[np.argmax(ratios)]) if ratios.max(initial=0.0) >= MIN_GAP_RATIO else 0.0


def _between_edges(amplitude: NDArray[np.float64], lines: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return those of the lines, as ascending indices, that lie between the edges of the excited band."""
    lines = lines[: _edge_index(amplitude[lines], lines + 1)]
    return lines[lines.size - _edge_index(amplitude[lines][::-1], (lines + 1)[::-1]) :]


def _edge_index(amplitude: NDArray[np.float64], frequency: NDArray[np.intp]) -> int:
    """Return how many lines come before the amplitudes fall steeply and stay low; all of them if they do not.

    The greatest of all lines beyond is compared with the median of those just before the edge.
    """
    count = amplitude.size
    if count < 2 * EDGE_LINES:
        return count
    before = np.median(np.lib.stride_tricks.sliding_window_view(amplitude, EDGE_LINES), axis=1)[:-EDGE_LINES]
    last = np.arange(EDGE_LINES - 1, count - EDGE_LINES)  # the line just before the edge
    beyond = np.maximum.accumulate(amplitude[::-1])[::-1][last + 1]
    turn = frequency[last + 1] / frequency[last - EDGE_LINES // 2]
    drop = before / beyond / np.maximum(turn, 1 / turn) ** MAX_SLOPE
    drop[amplitude[last] < before / MIN_GAP_RATIO] = 0.0  # such a line is beyond the edge itself
    steepest = int(np.argmax(drop))
    return int(last[steepest]) + 1 if drop[steepest] >= MIN_GAP_RATIO else count


def line_spectrum(blocks: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the amplitude of the mean spectrum from line 1, not scaled, and the variance of that mean.

    The variance is that of the line, or that usual around it if that is greater.
    """
    spectra = np.fft.rfft(blocks, axis=1)[:, 1 : (blocks.shape[1] - 1) // 2 + 1]
    mean = np.add.reduce(spectra, axis=0) / len(spectra)
    pairs = max(len(spectra) * (len(spectra) - 1), 1)  # one block alone has no scatter
    scatter = np.add.reduce(np.abs(spectra - mean) ** 2, axis=0) / pairs
    return np.abs(mean), np.maximum(scatter, _pooled_scatter(scatter))


def _pooled_scatter(scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median of the scatter of each line and its neighbours."""
    if scatter.size < POOLED_LINES:
        return np.full(scatter.size, np.median(scatter)) if scatter.size else scatter
    padded = np.pad(scatter, POOLED_LINES // 2, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, POOLED_LINES), axis=1))


def line_power(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the power of each line from 1 that is above the noise, not scaled; 0 for the others."""
    amplitude, scatter = line_spectrum(blocks)
    return np.where(amplitude**2 > SIGNIFICANCE_RATIO * scatter, amplitude**2, 0.0)


def find_doubtful_lines(cuts: Sequence[Cut]) -> Finding | None:
    """Return how many lines may not be excited; None if there is no doubt."""
    worst = max(cuts, key=lambda cut: (cut.left_out, cut.doubtful))
    count = worst.left_out or worst.doubtful
    if not count:
        return None
    left_out = Quantity(float(worst.left_out), "1", "left out")
    return Finding("doubtful lines", (left_out,), place=f"{count} of {worst.left_out + len(worst.lines)} lines")


def select_lines(settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], place: str) -> Cut:
    """Return the cut with its excited harmonics: those stated, otherwise those that are found in the injected signal.

    RecordError if nothing is injected at one that is stated. Without a channel for the injected signal they are found
    in the input, where they must be stronger than the lines of friction.
    """
    _check_statement(settings, cut, place)
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.min_frequency or 0.0) / base - 1e-6), 1)
    highest = math.floor(settings.max_frequency / base + 1e-6) if settings.max_frequency else last // cut.periods
    stated = sorted(set(settings.harmonics))
    lines = [line * cut.periods for line in stated]
    band = (lowest * cut.periods, highest * cut.periods)
    found = ExcitedLines(lines) if stated else _find_lines(settings, cut, values, band, place)
    lines = list(found.lines)
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0] // cut.periods} to {lines[-1] // cut.periods}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct min_frequency and max_frequency, or harmonics"
        )
    if stated:
        blocks = cut.blocks_of(values[settings.injected])
        _check_excited(lines, blocks, base / cut.periods, cut.periods, f"{place}: '{settings.injected}'")
    return replace(cut, lines=tuple(lines), left_out=found.left_out, doubtful=found.doubtful)


def _find_lines(
    settings: RecordSettings, cut: Cut, values: Mapping[str, NDArray[np.float64]], band: tuple[int, int], place: str
) -> ExcitedLines:
    """Return the excited lines within a frequency range, with the doubtful ones."""
    name, blocks = settings.injected, cut.blocks_of(values[settings.injected])
    if name == settings.reference:
        found = find_excited_lines(blocks, band, stated=bool(settings.min_frequency and settings.max_frequency))
    else:
        found = find_injected_lines(blocks, band)
        if name == "reference":
            _check_share(found.anywhere, cut.blocks_of(values[settings.reference]), settings.reference, place)
    if found.anywhere and not found.lines:
        spacing = 1 / (cut.samples * cut.sample_time)
        low, high = (line * spacing for line in (found.anywhere[0], found.anywhere[-1]))
        raise RecordError(
            f"{place}: none of the excited lines, {low:.4g} to {high:.4g} Hz, is between min_frequency and "
            "max_frequency; correct both, or give harmonics"
        )
    return found


def _check_share(lines: Sequence[int], blocks: NDArray[np.float64], name: str, place: str) -> None:
    """Raise RecordError if the input has most of its power at other lines than those of the reference."""
    power = line_power(blocks)
    share = float(power[np.array(lines, dtype=int) - 1].sum() / power.sum()) if power.any() else 1.0
    if share < MIN_POWER_SHARE:
        raise RecordError(
            f"{place}: '{name}' has {share:.0%} of its power at the {len(lines)} lines of 'reference': something else "
            f"excites the machine; give that as channel 'excitation', or line_channel = '{name}' (--input {name}) to "
            "look for lines there"
        )


def _check_statement(settings: RecordSettings, cut: Cut, place: str) -> None:
    if settings.harmonics and (settings.min_frequency or settings.max_frequency):
        raise RecordError(f"{place}: expected either harmonics, or min_frequency and max_frequency")
    if settings.max_frequency and settings.max_frequency > 0.5 / cut.sample_time:
        raise RecordError(
            f"{place}: max_frequency is {settings.max_frequency:.4g} Hz; expected at most half the sample rate, "
            f"{0.5 / cut.sample_time:.4g} Hz"
        )
    if settings.min_frequency and settings.max_frequency and settings.min_frequency > settings.max_frequency:
        raise RecordError(
            f"{place}: min_frequency is {settings.min_frequency:g} Hz and max_frequency {settings.max_frequency:g} Hz; "
            "expected the first below"
        )


def _check_excited(lines: list[int], blocks: NDArray[np.float64], spacing: float, periods: int, place: str) -> None:
    """Raise RecordError if a stated line is lost in noise; `spacing` is that of the block's lines [Hz]."""
    amplitude, scatter = line_spectrum(blocks)
    stated = np.array(lines) - 1
    others = np.delete(amplitude, stated)
    floor = np.maximum(scatter, np.median(others**2) if others.size else 0.0)[stated]
    share = amplitude[stated] / amplitude.max() if amplitude.any() else amplitude[stated]
    lost = (share < NEGLIGIBLE_RATIO) & (amplitude[stated] ** 2 <= SIGNIFICANCE_RATIO * floor) | (
        share < ROUNDING_RATIO
    )
    if lost.any():
        first = int(np.argmax(lost))
        more = f", nor at {int(lost.sum()) - 1} more of the {len(lines)} stated lines" if lost.sum() > 1 else ""
        raise RecordError(
            f"{place} does not excite {lines[first] * spacing:.6g} Hz (harmonic "
            f"{lines[first] // periods}), with {share[first]:.1e} of the strongest line{more}; "
            "correct harmonics, or leave them out"
        )


def common_lines(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts whose lines are those that most of them have, where noise alone makes them differ.

    Realisations are recognised by equal lines. If more than a few differ, friction or feedback may have added some,
    more at one amplitude than at another: the excited ones are in all cuts. With random grids all cuts are kept.
    """
    found = list(cuts)
    for shape in {(cut.samples, cut.sample_time) for cut in cuts}:
        places = [place for place, cut in enumerate(cuts) if (cut.samples, cut.sample_time) == shape]
        counts = Counter(line for place in places for line in cuts[place].lines)
        most = {line for line, count in counts.items() if count > len(places) / 2}
        shared = set.intersection(*(set(cuts[place].lines) for place in places))
        fewest = min(len(cuts[place].lines) for place in places)
        differences = [len(most.symmetric_difference(cuts[place].lines)) for place in places]
        if max(differences) > MAX_LINE_DIFFERENCE * len(most):
            most = shared if fewest - len(shared) <= MAX_LINE_DIFFERENCE * fewest else set()
        for place in places if most else ():
            found[place] = replace(cuts[place], lines=tuple(sorted(most)))
    return found


def check_step_frequencies(
    cuts: Sequence[Cut], channel: NDArray[np.float64], rate: float, name: str, place: str
) -> None:
    """Raise RecordError if in most steps the input is strongest at another frequency than the stated one."""
    wrong = []
    for cut in cuts:
        samples = cut.blocks_of(channel).ravel()  # not the mean block, in which half of the stated frequency cancels
        spectrum = np.abs(np.fft.rfft(samples - np.linspace(samples[0], samples[-1], samples.size)))
        strongest = int(np.argmax(spectrum[1:])) + 1
        if spectrum[strongest] > 2 * spectrum[cut.lines[0] * cut.blocks]:
            wrong.append((cut, strongest / cut.blocks))
    if len(wrong) > len(cuts) / 2:
        cut, strongest_line = wrong[0]
        stated, found = (line * rate / cut.samples for line in (cut.lines[0], strongest_line))
        raise RecordError(
            f"{place}: '{name}' is strongest at {found:.4g} Hz where {stated:.4g} Hz is stated, and so in "
            f"{len(wrong)} of {len(cuts)} steps; check sample_rate and the steps"
        )


def check_levels(cuts: Sequence[Cut], inputs: Sequence[NDArray[np.float64]], name: str, place: str) -> None:
    """Raise RecordError if segments that would be averaged as realisations have different levels.

    `inputs` are the blocks of the input in each segment, each of shape (blocks, samples).
    """
    levels: dict[int, list[float]] = {}
    for cut, blocks in zip(cuts, inputs, strict=True):
        if cut.periodic:
            levels.setdefault(cut.samples, []).append(float(np.std(blocks)))
    for found in levels.values():
        if max(found) > MAX_LEVEL_RATIO * min(found):
            raise RecordError(
                f"{place}: the rms of '{name}' is {min(found):.3g} to {max(found):.3g} in segments that would be "
                "averaged as realisations; give each level as a file of its own, or analyse it by itself, with {level} "
                "in a column, a file or select, and level (--level)"
            )
