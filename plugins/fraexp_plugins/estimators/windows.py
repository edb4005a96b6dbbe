"""Records cut into Hann windows that overlap by half: spectra where nothing is periodic (Welch 1967)."""

import numpy as np

from fraexp.api import RecordError, Segment
from fraexp_plugins.estimators.realisations import Group

LEAST = 8
"""Samples of a window at least: fewer resolve no line beside the mean and its leakage."""
REPEATED = 0.5
"""Correlation of successive periods above which they are repetitions."""


def window_samples(group: Group, window: float, name: str) -> int:
    """Return the samples of a window [s]; RecordError if the records do not hold one."""
    segment = group[0]
    longest = segment.samples * next(iter(segment.channels.values())).shape[0]
    samples = round(window / segment.sample_time)
    if not LEAST <= samples <= longest:
        raise RecordError(
            f"{name}.window is {window:g} s, {samples} samples; expected {LEAST * segment.sample_time:g} s to "
            f"{longest * segment.sample_time:g} s, the length of the record"
        )
    return samples


def window_bins(group: Group, samples: int) -> np.ndarray:
    """Return the bins of windows from the lowest to the highest excited line, shape (n,) of int."""
    segment = group[0]
    first, last = segment.lines[[0, -1]] * samples / segment.samples
    bins = np.arange(max(int(np.ceil(first - 1e-9)), 1), min(int(last + 1e-9), (samples - 1) // 2) + 1)
    if not bins.size:
        raise RecordError(
            f"a window of {samples * segment.sample_time:g} s has no line between {segment.frequency[0]:.4g} and "
            f"{segment.frequency[-1]:.4g} Hz; expected a longer one"
        )
    return bins


def window_phasors(group: Group, channel: str, samples: int, bins: np.ndarray) -> np.ndarray:
    """Return the phasors of a channel in all windows of all records of a group, complex, shape (windows, bins).

    A window's mean is taken off; a sine of a bin's frequency is answered with its amplitude.
    """
    return np.concatenate([_of_segment(segment, channel, samples, bins) for segment in group])


def independent_windows(group: Group, channel: str, samples: int) -> float:
    """Return how many windows without overlap, each of a signal of its own, scatter as little as these do.

    The correlation of windows that overlap by half is ρ = 1/6 for Hann ones, and K of them in a row count for
    K/(1 + 2ρ²(K - 1)/K): P. D. Welch, IEEE Trans. Audio and Electroacoustics 15(2) 1967, doi:10.1109/TAU.1967.1161901.
    Periods in which a channel repeats itself count once: leakage and distortions repeat themselves with it.
    """
    hann = _hann(samples)
    hop = samples // 2
    correlation = float(np.add.reduce(hann[hop:] * hann[: samples - hop]) / np.add.reduce(hann**2))
    counts = [len(_starts(segment, samples)) / _repetitions(segment, channel) for segment in group]
    pairs = sum(max(count - 1, 0.0) for count in counts)
    return sum(counts) / (1 + 2 * correlation**2 * pairs / sum(counts))


def _repetitions(segment: Segment, channel: str) -> int:
    """Return how often a channel of a segment says the same: its periods, or once if they are blocks of noise."""
    blocks = segment.channels[channel]
    blocks = blocks - (np.add.reduce(blocks, axis=1) / segment.samples)[:, None]
    common = np.add.reduce((blocks[1:] * blocks[:-1]).ravel())
    return len(blocks) if common > REPEATED * np.add.reduce((blocks[1:] ** 2).ravel()) else 1


def _of_segment(segment: Segment, channel: str, samples: int, bins: np.ndarray) -> np.ndarray:
    record = segment.channels[channel].ravel()
    hann = _hann(samples)
    windows = np.stack([record[start : start + samples] for start in _starts(segment, samples)])
    windows = windows - (np.add.reduce(windows, axis=1) / samples)[:, None]
    return np.fft.rfft(windows * hann, axis=1)[:, bins] * (2 / np.add.reduce(hann))


def _starts(segment: Segment, samples: int) -> range:
    length = segment.samples * next(iter(segment.channels.values())).shape[0]
    return range(0, length - samples + 1, max(samples // 2, 1))


def _hann(samples: int) -> np.ndarray:
    return 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(samples) / samples)
