"""Which harmonics are excited, and whether the input is where the study says."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut
from fraexp.records.settings import RecordSettings

SIGNIFICANT = 20.0
"""Power of a line over the variance of its mean from which it is more than noise."""
NEGLIGIBLE = 1e-3
"""Amplitude relative to the greatest line below which a line counts as not excited."""
STEP = 3.0
"""Least ratio of amplitudes that separates excited lines from distortion."""
FEW = 0.2
"""Share of lines by which realisations of one multisine may seem to differ."""
NOTHING = 1e-9
"""Amplitude relative to the greatest line that is rounding."""


def excited_lines(settings: RecordSettings, cut: Cut, channel: np.ndarray, place: str) -> tuple[int, ...]:
    """Return the excited harmonics of the block: those stated, else those that stand out of the input channel.

    `lines`, or `every` from `lowest` to `highest`, state them; RecordError if the input has nothing there.
    """
    _check_statement(settings, cut, place)
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.lowest or 0.0) / base - 1e-6), 1)
    highest = math.floor(settings.highest / base + 1e-6) if settings.highest else last // cut.periods
    stated = sorted(set(settings.lines or (range(lowest, highest + 1, settings.every) if settings.every else ())))
    blocks = cut.blocks_of(channel)
    lines = [line * cut.periods for line in stated]
    if not settings.lines and not settings.every:
        found = detected_lines(blocks)
        lines = [line for line in found if lowest * cut.periods <= line <= highest * cut.periods]
        if found and not lines:
            low, high = (line * base / cut.periods for line in (found[0], found[-1]))
            raise RecordError(
                f"{place}: none of the excited lines, {low:.4g} to {high:.4g} Hz, is between lowest and highest; "
                "correct them, or state lines"
            )
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0] // cut.periods} to {lines[-1] // cut.periods}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct lowest and highest, or lines"
        )
    if stated:
        _check_excited(lines, blocks, base / cut.periods, cut.periods, place)
    return tuple(lines)


def common_lines(cuts: Sequence[Cut]) -> list[Cut]:
    """Return cuts whose lines are those that most of them have, where noise alone makes them differ.

    Realisations are told to be such by equal lines. Where more than a few differ, as with random grids, all is left.
    """
    found = list(cuts)
    for shape in {(cut.samples, cut.sample_time) for cut in cuts}:
        places = [place for place, cut in enumerate(cuts) if (cut.samples, cut.sample_time) == shape]
        counts = Counter(line for place in places for line in cuts[place].lines)
        most = {line for line, count in counts.items() if count > len(places) / 2}
        if all(len(most.symmetric_difference(cuts[place].lines)) <= FEW * len(most) for place in places):
            for place in places:
                found[place] = replace(cuts[place], lines=tuple(sorted(most)))
    return found


def _check_statement(settings: RecordSettings, cut: Cut, place: str) -> None:
    if settings.lines and (settings.every or settings.lowest or settings.highest):
        raise RecordError(f"{place}: lines are given, and lowest, highest or every as well; expected one way")
    if settings.every and not (settings.lowest and settings.highest):
        raise RecordError(f"{place}: every is given without lowest and highest; give both, or lines")
    if settings.highest and settings.highest > 0.5 / cut.sample_time:
        raise RecordError(
            f"{place}: highest is {settings.highest:.4g} Hz; expected at most half the sample rate, "
            f"{0.5 / cut.sample_time:.4g} Hz"
        )
    if settings.lowest and settings.highest and settings.lowest > settings.highest:
        raise RecordError(
            f"{place}: lowest is {settings.lowest:g} Hz and highest {settings.highest:g} Hz; expected lowest below"
        )


def _check_excited(lines: list[int], blocks: np.ndarray, spacing: float, periods: int, place: str) -> None:
    """Raise RecordError if a stated line cannot be told from the noise; `spacing` of the block's lines in Hz."""
    amplitude, scatter = _spectrum(blocks)
    stated = np.array(lines) - 1
    others = np.delete(amplitude, stated)
    floor = np.maximum(scatter, np.median(others**2) if others.size else 0.0)[stated]
    share = amplitude[stated] / amplitude.max() if amplitude.any() else amplitude[stated]
    lost = (share < NEGLIGIBLE) & (amplitude[stated] ** 2 <= SIGNIFICANT * floor) | (share < NOTHING)
    if lost.any():
        first = int(np.argmax(lost))
        more = f", nor at {int(lost.sum()) - 1} more of the {len(lines)} stated lines" if lost.sum() > 1 else ""
        raise RecordError(
            f"{place}: the input does not excite {lines[first] * spacing:.6g} Hz (harmonic "
            f"{lines[first] // periods}), with {share[first]:.1e} of the strongest line{more}; "
            "correct lines, or leave out every"
        )


def detected_lines(blocks: np.ndarray) -> list[int]:
    """Return the harmonics that stand out of noise and distortion in the blocks of an input, shape (blocks, samples).

    Lines above the noise are sorted by amplitude and cut at their widest gap, if that is at least a factor of 3:
    a controller's input also holds lines that friction has made.
    """
    amplitude, scatter = _spectrum(blocks)
    above = (amplitude**2 > SIGNIFICANT * scatter) & (amplitude > NEGLIGIBLE * amplitude.max(initial=0.0))
    levels = np.sort(amplitude[above])
    if levels.size > 1:
        ratios = levels[1:] / levels[:-1]
        widest = int(np.argmax(ratios))
        if ratios[widest] >= STEP:
            above &= amplitude > levels[widest]
    return [int(line) + 1 for line in np.flatnonzero(above)]


def _spectrum(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitude of the mean spectrum from line 1, not scaled, and the variance of that mean."""
    spectra = np.fft.rfft(blocks, axis=1)[:, 1 : (blocks.shape[1] - 1) // 2 + 1]
    mean = np.add.reduce(spectra, axis=0) / len(spectra)
    pairs = max(len(spectra) * (len(spectra) - 1), 1)  # one block alone has no scatter
    scatter = np.add.reduce(np.abs(spectra - mean) ** 2, axis=0) / pairs
    return np.abs(mean), scatter


def check_steps(cuts: list[Cut], channel: np.ndarray, rate: float, name: str, place: str) -> None:
    """Raise RecordError if in most steps the input is strongest at another frequency than the stated one."""
    wrong = []
    for cut in cuts:
        spectrum = np.abs(np.fft.rfft(cut.blocks_of(channel).mean(axis=0)))
        strongest = int(np.argmax(spectrum[1:])) + 1
        if spectrum[strongest] > 2 * spectrum[cut.lines[0]]:
            wrong.append((cut, strongest))
    if len(wrong) > len(cuts) / 2:
        cut, strongest = wrong[0]
        stated, found = (line * rate / cut.samples for line in (cut.lines[0], strongest))
        raise RecordError(
            f"{place}: '{name}' is strongest at {found:.4g} Hz where {stated:.4g} Hz is stated, and so in "
            f"{len(wrong)} of {len(cuts)} steps; check sample_rate and the steps"
        )
