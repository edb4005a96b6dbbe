"""Which harmonics are excited, and whether a record repeats itself as the study says."""

import math

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
SIMILAR = 0.5
"""Correlation of successive periods below which a record does not repeat itself."""
ALIKE = 0.95
"""Share of the highest autocorrelation from which an earlier peak is taken for the period."""


def excited_lines(settings: RecordSettings, cut: Cut, channel: np.ndarray, place: str) -> tuple[int, ...]:
    """Return the excited harmonics of the block: those stated, else those that stand out of the input channel."""
    last = (cut.samples - 1) // 2
    base = cut.periods / (cut.samples * cut.sample_time)
    lowest = max(math.ceil((settings.lowest or 0.0) / base - 1e-6), 1)
    highest = math.floor((settings.highest or math.inf) / base + 1e-6) if settings.highest else last // cut.periods
    if settings.lines:
        lines = sorted({line * cut.periods for line in settings.lines})
    elif settings.lowest and settings.highest:
        lines = [line * cut.periods for line in range(lowest, highest + 1, settings.every)]
    else:
        found = detected_lines(cut.blocks_of(channel))
        lines = [line for line in found if lowest * cut.periods <= line <= highest * cut.periods]
    if not lines or lines[0] < 1 or lines[-1] > last:
        found_text = f"{lines[0]} to {lines[-1]}" if lines else "none"
        raise RecordError(
            f"{place}: the excited harmonics are {found_text}; expected some from 1 to {last // cut.periods} "
            f"({base:.4g} to {0.5 / cut.sample_time:.4g} Hz): correct lowest and highest, or lines"
        )
    return tuple(lines)


def detected_lines(blocks: np.ndarray) -> list[int]:
    """Return the harmonics that stand out of noise and distortion in the blocks of an input, shape (blocks, samples).

    Lines above the noise are sorted by amplitude and cut at their widest gap, if that is at least a factor of 3:
    a controller's input also holds lines that friction has made.
    """
    spectra = np.fft.rfft(blocks, axis=1)[:, 1 : (blocks.shape[1] - 1) // 2 + 1]
    mean = np.add.reduce(spectra, axis=0) / len(spectra)
    scatter = np.add.reduce(np.abs(spectra - mean) ** 2, axis=0) / (len(spectra) * (len(spectra) - 1))
    amplitude = np.abs(mean)
    above = (amplitude**2 > SIGNIFICANT * scatter) & (amplitude > NEGLIGIBLE * amplitude.max(initial=0.0))
    levels = np.sort(amplitude[above])
    if levels.size > 1:
        ratios = levels[1:] / levels[:-1]
        widest = int(np.argmax(ratios))
        if ratios[widest] >= STEP:
            above &= amplitude > levels[widest]
    return [int(line) + 1 for line in np.flatnonzero(above)]


def check_repeats(cut: Cut, channel: np.ndarray, name: str, place: str) -> None:
    """Raise RecordError if the blocks of a channel do not resemble each other; it tells the period that would fit."""
    blocks = cut.blocks_of(channel)
    swing = blocks - blocks.mean()
    power = float(np.sum(swing**2)) / len(swing)
    alike = float(np.sum(swing[1:] * swing[:-1])) / (len(swing) - 1) / power if power else 1.0
    if alike >= SIMILAR:
        return
    better = detected_period(channel[cut.start :])
    if better or alike < SIMILAR / 5:
        remedy = f"it seems to repeat every {better} samples" if better else "check period and sample_rate"
        raise RecordError(
            f"{place}: '{name}' does not repeat after {cut.samples} samples (correlation {alike:.2f}); {remedy}"
        )


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
