"""Excited lines of a periodic signal, separated from those of friction, feedback and noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.data.findings import Finding, Quantity
from fraexp.records.cutting import Cut

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
