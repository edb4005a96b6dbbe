"""Which lines of a periodic signal somebody has excited, and which friction, feedback or noise have made."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fraexp.records.cutting import Cut

SIGNIFICANT = 20.0
"""Power of a line over the variance of its mean from which it is more than noise."""
NEGLIGIBLE = 1e-3
"""Amplitude relative to the greatest line below which a line counts as not excited."""
NOTHING = 1e-9
"""Amplitude relative to the greatest line that is rounding."""
STEP = 3.0
"""Least ratio of amplitudes that separates excited lines from distortion."""
WEAK = 0.03
"""Amplitude relative to the median of the excited lines below which a line is far weaker than they are."""
BESIDE = 5
"""Lines on either side of the edge of an excited band that show it."""
SLOPE = 3
"""Power of the frequency by which an excitation, or what feedback leaves of it, may rise or fall."""
POOLED = 33
"""Neighbouring lines whose scatter is looked at together: that of one line may by chance be small."""


@dataclass(frozen=True)
class ExcitedLines:
    """The excited lines of a signal."""

    lines: Sequence[int]
    anywhere: Sequence[int] = ()
    """Those outside of the band that was asked for as well."""
    left_out: int = 0
    """How many others stand out of the noise, if there are some that are not far weaker."""
    doubtful: int = 0
    """How many are far weaker than the others."""


def injected_lines(blocks: np.ndarray, band: tuple[float, float]) -> ExcitedLines:
    """Return the lines of a signal that neither friction nor feedback touches, in blocks of shape (blocks, samples).

    All that stands out of its noise and rounding is excited. Rounding repeats itself: below a thousandth of the
    greatest line, lines count if no gap of a factor of 3 parts them from the others.
    """
    amplitude, scatter = line_spectrum(blocks)
    greatest = amplitude.max(initial=0.0)
    above = (amplitude**2 > SIGNIFICANT * scatter) & (amplitude > NOTHING * greatest)
    above &= amplitude > _widest_gap(amplitude[above], NEGLIGIBLE * greatest)
    lines = np.flatnonzero(above) + 1
    return ExcitedLines(_within(lines, band), lines.tolist())


def detected_lines(blocks: np.ndarray, band: tuple[float, float] = (1, np.inf), stated: bool = False) -> ExcitedLines:
    """Return the lines that stand out of noise and distortion in the blocks of an input, shape (blocks, samples).

    A controller's input also holds lines that friction has made. Where the lines above the noise fall by more than a
    factor of 3 from one to the next and stay low, at either end, all beyond is friction's. The others are sorted by
    amplitude and cut at their widest gap, if that is at least a factor of 3. What lies outside of the band tells of
    friction within it too, unless both ends of it are `stated`.
    """
    amplitude, scatter = line_spectrum(blocks)
    significant = (amplitude**2 > SIGNIFICANT * scatter) & (amplitude > NEGLIGIBLE * amplitude.max(initial=0.0))
    above = np.flatnonzero(significant)
    kept = _between_edges(amplitude, above)
    kept = kept[amplitude[kept] > _widest_gap(amplitude[kept], np.inf)]
    weak = WEAK * float(np.median(amplitude[kept])) if kept.size else 0.0
    lines, others = _within(kept + 1, band), _within(np.setdiff1d(above, kept) + 1, band if stated else (1, np.inf))
    strong = any(amplitude[line - 1] > weak for line in others) and len(blocks) > 1  # one block does not tell the noise
    doubtful = sum(bool(amplitude[line - 1] < weak) for line in lines)
    return ExcitedLines(lines, (kept + 1).tolist(), len(others) if strong else 0, doubtful)


def _within(lines: np.ndarray, band: tuple[float, float]) -> list[int]:
    return [int(line) for line in lines if band[0] <= line <= band[1]]


def _widest_gap(amplitude: np.ndarray, highest: float) -> float:
    """Return the level just below the widest gap of the amplitudes, if that is one and lies below `highest`; else 0."""
    levels = np.sort(amplitude)
    ratios = np.where(levels[:-1] < highest, levels[1:] / levels[:-1], 0.0)
    return float(levels[np.argmax(ratios)]) if ratios.max(initial=0.0) >= STEP else 0.0


def _between_edges(amplitude: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return those of the lines, as ascending indices, that lie between the edges of the excited band."""
    lines = lines[: _edge(amplitude[lines], lines + 1)]
    return lines[lines.size - _edge(amplitude[lines][::-1], (lines + 1)[::-1]) :]


def _edge(amplitude: np.ndarray, frequency: np.ndarray) -> int:
    """Return how many lines come before the amplitudes fall steeply and stay low; all of them if they do not.

    The greatest of all lines beyond is compared with the median of those just before the edge.
    """
    count = amplitude.size
    if count < 2 * BESIDE:
        return count
    before = np.median(np.lib.stride_tricks.sliding_window_view(amplitude, BESIDE), axis=1)[:-BESIDE]
    last = np.arange(BESIDE - 1, count - BESIDE)  # the line just before the edge
    beyond = np.maximum.accumulate(amplitude[::-1])[::-1][last + 1]
    turn = frequency[last + 1] / frequency[last - BESIDE // 2]
    drop = before / beyond / np.maximum(turn, 1 / turn) ** SLOPE
    drop[amplitude[last] < before / STEP] = 0.0  # such a line is beyond the edge itself
    steepest = int(np.argmax(drop))
    return int(last[steepest]) + 1 if drop[steepest] >= STEP else count


def line_spectrum(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitude of the mean spectrum from line 1, not scaled, and the variance of that mean.

    The variance is that of the line, or that usual around it if that is greater.
    """
    spectra = np.fft.rfft(blocks, axis=1)[:, 1 : (blocks.shape[1] - 1) // 2 + 1]
    mean = np.add.reduce(spectra, axis=0) / len(spectra)
    pairs = max(len(spectra) * (len(spectra) - 1), 1)  # one block alone has no scatter
    scatter = np.add.reduce(np.abs(spectra - mean) ** 2, axis=0) / pairs
    return np.abs(mean), np.maximum(scatter, _pooled(scatter))


def _pooled(scatter: np.ndarray) -> np.ndarray:
    """Return the median of the scatter of each line and its neighbours."""
    if scatter.size < POOLED:
        return np.full(scatter.size, np.median(scatter)) if scatter.size else scatter
    padded = np.pad(scatter, POOLED // 2, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, POOLED), axis=1))


def power_of_lines(blocks: np.ndarray) -> np.ndarray:
    """Return the power of each line from 1 that stands out of the noise, not scaled; 0 for the others."""
    amplitude, scatter = line_spectrum(blocks)
    return np.where(amplitude**2 > SIGNIFICANT * scatter, amplitude**2, 0.0)


def doubts(cuts: Sequence[Cut]) -> str:
    """Return a sentence on lines of which the input does not tell surely whether they are excited; or nothing."""
    remedy = "give the injected signal as channel 'reference' or 'excitation', or state lines, or lowest and highest"
    worst = max(cuts, key=lambda cut: (cut.left_out, cut.doubtful))
    if worst.left_out:
        return (
            f"{worst.left_out} of the {worst.left_out + len(worst.lines)} lines that stand out of the input's noise "
            "are left out: they are far weaker than those beside them, as friction and feedback make them; some of the "
            f"others may be such too: {remedy}"
        )
    if worst.doubtful:
        return (
            f"{worst.doubtful} of the {len(worst.lines)} lines are far weaker in the input than the others, and "
            f"friction or feedback may have made them: {remedy}"
        )
    return ""
