"""Hann windows with 50 % overlap: spectra of records that are not periodic (Welch 1967)."""

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, Segment
from fraexp_plugins.estimators._shared.realisations import Group

LINE_HALF_WIDTH = 2
"""Bins on either side of a line from which its Hann window vanishes: lines that are closer share a window. With half of
it a window of half the samples passes, whose only line is the leakage of the mean."""
MIN_WINDOW_SAMPLES = 4 * LINE_HALF_WIDTH
"""Samples from which a window has a line beside the mean and the Nyquist frequency."""


def window_samples(group: Group, window: float, name: str) -> int:
    """Return the samples of a window [s]; RecordError if the records are too short for one."""
    segment, longest = group[0], longest_record(group)
    samples = round(window / segment.sample_time)
    if not MIN_WINDOW_SAMPLES <= samples <= longest:
        raise RecordError(
            f"{name}.window is {window:g} s, {samples} samples; "
            f"expected {MIN_WINDOW_SAMPLES * segment.sample_time:g} s to {longest * segment.sample_time:g} s"
        )
    return samples


def longest_record(group: Group) -> int:
    """Return the samples of a record of the group, which are equally long."""
    return group[0].samples * next(iter(group[0].channels.values())).shape[0]


def window_bins(group: Group, samples: int) -> NDArray[np.int64]:
    """Return the bins of windows from the lowest to the highest excited line, shape (n,)."""
    segment = group[0]
    first, last = segment.lines[[0, -1]] * samples / segment.samples
    bins = np.arange(max(int(np.ceil(first - 1e-9)), 1), min(int(last + 1e-9), (samples - 1) // 2) + 1)
    if not bins.size:
        raise RecordError(
            f"a window of {samples * segment.sample_time:g} s has no line between {segment.frequency[0]:.4g} and "
            f"{segment.frequency[-1]:.4g} Hz; use a longer window"
        )
    return bins


def window_phasors(
    group: Group, channel: str, samples: int, bins: NDArray[np.int64], transform: int = 0
) -> NDArray[np.complex128]:
    """Return the phasors of a channel in all windows of all records of a group, complex, shape (windows, bins).

    The mean of each window is subtracted. The phasor of a sine at a bin's frequency has the sine's amplitude. The bins
    are those of a transform of so many samples, if it is longer than the windows.
    """
    return np.concatenate(
        [_segment_phasors(segment, channel, samples, bins, transform or samples) for segment in group]
    )


def independent_windows(group: Group, channel: str, samples: int) -> float:
    """Return the number of independent windows without overlap that have the same scatter.

    Hann windows with 50 % overlap have the correlation ρ = 1/6, and K of them in a row count as K/(1 + 2ρ²(K - 1)/K):
    P. D. Welch, IEEE Trans. Audio and Electroacoustics 15(2) 1967, doi:10.1109/TAU.1967.1161901. Periods that repeat
    count once, because leakage and distortions repeat with them.
    """
    hann = _hann(samples)
    hop = samples // 2
    correlation = float(np.add.reduce(hann[hop:] * hann[: samples - hop]) / np.add.reduce(hann**2))
    counts = [len(window_starts(segment, samples)) / _repetitions(segment, channel) for segment in group]
    pairs = sum(max(count - 1, 0.0) for count in counts)
    return sum(counts) / (1 + 2 * correlation**2 * pairs / sum(counts))


def _repetitions(segment: Segment, channel: str) -> int:
    """Return how often a channel of a segment repeats: its number of periods, or 1 if they are blocks of noise.

    Successive periods that repeat differ by less than they are, blocks of noise by more.
    """
    blocks = segment.channels[channel]
    blocks = blocks - (np.add.reduce(blocks, axis=1) / segment.samples)[:, None]
    return len(blocks) if np.linalg.norm(np.diff(blocks, axis=0)) < np.linalg.norm(blocks[1:]) else 1


def _segment_phasors(
    segment: Segment, channel: str, samples: int, bins: NDArray[np.int64], transform: int
) -> NDArray[np.complex128]:
    record = segment.channels[channel].ravel()
    hann = _hann(samples)
    windows = np.stack([record[start : start + samples] for start in window_starts(segment, samples)])
    windows = windows - (np.add.reduce(windows, axis=1) / samples)[:, None]
    return np.fft.rfft(windows * hann, transform, axis=1)[:, bins] * (2 / np.add.reduce(hann))


def window_starts(segment: Segment, samples: int) -> range:
    """Return the first samples of the windows of a record."""
    length = segment.samples * next(iter(segment.channels.values())).shape[0]
    return range(0, length - samples + 1, max(samples // 2, 1))


def _hann(samples: int) -> NDArray[np.float64]:
    return 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(samples) / samples)
