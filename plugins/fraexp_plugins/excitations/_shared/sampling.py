"""How finely a period is sampled, how whole cycles fit into whole samples, and amplitudes over frequency."""

import itertools
from functools import cache
from math import gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError, cached_arrays

MIN_SAMPLES_PER_PERIOD, MAX_SAMPLES_PER_PERIOD = 16, 2_000_000
"""Fewer samples do not draw a wave; more do not fit into memory: half a gigabyte of channels."""
MAX_RECORDED_SAMPLES = 20_000_000
"""Samples that an experiment may record in all: about a gigabyte of channels."""
MAX_WAVES_BYTES = 1 << 24
"""Memory of all sines that are cached."""
MIN_CYCLES_PER_SAMPLE = 1e-18
"""A lower frequency is computed as this one, so that its period is a finite number."""
FREQUENCY_TOLERANCE = 1e-3
"""Relative distance between the frequency asked for and the one at which whole periods fit into whole samples."""
MIN_BLOCK_SAMPLES, MAX_BLOCK_SAMPLES = 400, 1 << 16
"""Samples of a block of whole periods."""
EXACT_TOLERANCE = 1e-9
"""Relative distance at which a frequency is the one asked for."""
MAX_LENGTH_RATIO = 1.2
"""How much longer than the shortest a block may be if its number of samples has small prime factors."""
MIN_PHASES = 20
"""Different phases at which a sine is sampled."""
MAX_ADDED_CYCLES = 8
"""Cycles that a block may have in addition, if its frequency is nearer to the one asked for then."""
MAX_PRIME_FACTOR = 13
"""Greatest prime factor of a number of samples whose Fourier transform is fast."""


class CoherentBlock(NamedTuple):
    """Whole cycles of a sine in whole samples."""

    cycles: int
    samples: int

    def relative_error(self, cycles_per_sample: float) -> float:
        """Return how far the block's frequency is from the one asked for, relative to it."""
        return abs(self.cycles / (self.samples * cycles_per_sample) - 1)


def check_range(name: str, lowest: float, highest: float) -> None:
    """Refuse a frequency range [Hz] that ends before it begins."""
    if lowest > highest:
        raise ParameterError(
            f"{name}.min_frequency is {lowest:g} Hz; it must not be above max_frequency, {highest:g} Hz"
        )


def check_nyquist(name: str, highest: float, sample_time: float, remedy: str = "lower 'max_frequency'") -> None:
    """Refuse frequencies [Hz] from the Nyquist frequency on."""
    if highest * sample_time >= 0.5:
        raise ParameterError(
            f"{name} reaches {highest:g} Hz; at a sample time of {sample_time:g} s the Nyquist frequency is "
            f"{0.5 / sample_time:g} Hz: {remedy}, or shorten loop.sample_time"
        )


def check_period(name: str, samples: float, sample_time: float, remedy: str, frequency: float | None = None) -> None:
    """Refuse a period, perhaps that of a frequency [Hz], whose samples do not fit into memory."""
    if samples > MAX_SAMPLES_PER_PERIOD:
        at = "" if frequency is None else f"{frequency:g} Hz and "
        raise ParameterError(
            f"{name} has {samples:.4g} samples per period at {at}a sample time of {sample_time:g} s; expected "
            f"{MAX_SAMPLES_PER_PERIOD:,} or fewer: {remedy}"
        )


def check_recorded(name: str, samples: float, remedy: str) -> None:
    """Refuse a record that does not fit into memory."""
    if samples > MAX_RECORDED_SAMPLES:
        raise ParameterError(
            f"{name} records {samples:,.0f} samples in all; expected {MAX_RECORDED_SAMPLES:,} or fewer: {remedy}"
        )


def samples_per_period(name: str, frequency: float, sample_time: float) -> int:
    """Return the whole number nearest to 1/(f Ts); ParameterError if there are too few samples, or too many."""
    samples = round(1 / max(frequency * sample_time, MIN_CYCLES_PER_SAMPLE))
    check_period(name, samples, sample_time, "raise 'frequency', or lengthen loop.sample_time", frequency)
    if samples < MIN_SAMPLES_PER_PERIOD:
        raise ParameterError(
            f"{name} has {samples} samples per period at {frequency:g} Hz and a sample time of {sample_time:g} s; "
            f"expected {MIN_SAMPLES_PER_PERIOD} or more: lower 'frequency', or shorten loop.sample_time"
        )
    return samples


def even_samples(duration: float, sample_time: float) -> int:
    """Return the even number of samples nearest to `duration` [s] whose Fourier transform is fast.

    It is even because the second half of a period of odd harmonics is the first one with its sign changed, which
    a wave that is held between samples can only be if both halves have equally many.
    """
    half = max(round(duration / sample_time / 2), 1)
    nearest = (half + sign * away for away in range(half + 1) for sign in (-1, 1))
    return 2 * next(samples for samples in nearest if samples > 0 and max(_prime_factors(samples)) <= MAX_PRIME_FACTOR)


@cache
def coherent_block(cycles_per_sample: float) -> CoherentBlock:
    """Return a block whose cycles per sample are near the number asked for.

    Its samples meet the sine at `MIN_PHASES` different phases or more: the encoder's quantisation, which hides a small
    motion at one phase, shows it at others. Of blocks of similar length it is one whose Fourier transform is fast.
    """
    fitting: list[CoherentBlock] = []
    for cycles in range(1, max(2, int(cycles_per_sample * MAX_BLOCK_SAMPLES))):
        shortest = max(int(np.ceil(cycles / cycles_per_sample / (1 + FREQUENCY_TOLERANCE))), MIN_BLOCK_SAMPLES)
        if fitting and shortest > MAX_LENGTH_RATIO * fitting[0].samples:
            break
        longest = int(np.floor(cycles / cycles_per_sample / (1 - FREQUENCY_TOLERANCE)))
        lengths = range(shortest, longest + 1)
        fitting += [CoherentBlock(cycles, n) for n in lengths if n >= MIN_PHASES * gcd(cycles, n)]
    if fitting:
        exact = [block for block in fitting if block.relative_error(cycles_per_sample) < EXACT_TOLERANCE]
        return min(exact or fitting, key=_transform_cost)
    return CoherentBlock(1, max(round(1 / cycles_per_sample), MIN_PHASES))


def interleaved_block(cycles_per_sample: float, cycles: int) -> CoherentBlock:
    """Return the block of this many cycles, or a few more, in which each sample meets the sine at another phase.

    Its cycles per sample are as near as that allows to the number asked for.
    """
    near = [
        CoherentBlock(count, samples)
        for count in range(cycles, cycles + MAX_ADDED_CYCLES + 1)
        for samples in range(
            max(int(count / cycles_per_sample) - cycles, MIN_PHASES), int(count / cycles_per_sample) + cycles + 2
        )
        if gcd(count, samples) == 1
    ]
    return min(
        near,
        key=lambda block: (
            block.relative_error(cycles_per_sample) > FREQUENCY_TOLERANCE,
            block.cycles,
            block.relative_error(cycles_per_sample),
        ),
    )


def coherent_half_period(min_samples: float, cycles_per_sample: float) -> CoherentBlock:
    """Return a block of `min_samples` or more that is half a period of a slower motion.

    Its cycles per sample are near the number asked for, and below the Nyquist frequency.
    """
    first = max(int(np.ceil(min_samples * cycles_per_sample * (1 - EXACT_TOLERANCE))), 1)
    blocks = [
        CoherentBlock(cycles, max(round(cycles / cycles_per_sample), 2 * cycles + 1))
        for cycles in range(first, 2 * first + 10)
    ]
    near = [block for block in blocks if block.relative_error(cycles_per_sample) <= FREQUENCY_TOLERANCE]
    if not near:
        return min(blocks, key=lambda block: block.relative_error(cycles_per_sample))
    return min((block for block in near if block.samples <= MAX_LENGTH_RATIO * near[0].samples), key=_transform_cost)


@cached_arrays(MAX_WAVES_BYTES)
def sine_wave(block: CoherentBlock) -> NDArray[np.float64]:
    """Return a block of a sine of amplitude 1, shape (samples,); cached, as many sweeps have the same frequencies."""
    cycles, samples = block
    return np.sin(2 * np.pi * (cycles * np.arange(samples) % samples) / samples)


def _transform_cost(block: CoherentBlock) -> tuple[int, int]:
    """Return a key that sorts blocks by the operations per sample of their Fourier transform, then by length."""
    return sum(_prime_factors(block.samples)), block.samples


@cache
def _prime_factors(samples: int) -> tuple[int, ...]:
    """Return the prime factors; a Fourier transform takes about their sum of operations per sample."""
    factors, factor = [], 2
    while samples > 1:
        while samples % factor == 0:
            factors.append(factor)
            samples //= factor
        factor += 1 if factor * factor <= samples else samples - factor
    return tuple(factors or [1])


AmplitudeProfile = tuple[tuple[float, float], ...]
"""Pairs of frequency [Hz] and relative amplitude, ascending; empty for a constant amplitude."""
PROFILE_MEANING = (
    "pairs of frequency and relative amplitude, joined by straight lines on logarithmic axes; "
    "empty for a constant amplitude"
)


def check_profile(name: str, profile: AmplitudeProfile) -> None:
    """Raise ParameterError unless frequencies ascend and all numbers are above 0."""
    if min((number for pair in profile for number in pair), default=1.0) <= 0:
        raise ParameterError(
            f"{name}.amplitude_profile has a number of 0 or less; expected frequencies and amplitudes above 0"
        )
    frequencies = [frequency for frequency, _ in profile]
    if any(second <= first for first, second in itertools.pairwise(frequencies)):
        raise ParameterError(f"{name}.amplitude_profile has the frequencies {frequencies} Hz; expected them to ascend")


def relative_amplitude(profile: AmplitudeProfile, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative amplitude at `frequency` [Hz], shape (n,); constant beyond the outermost pairs."""
    if not profile:
        return np.ones(frequency.shape)
    known, relative = np.log(np.array(profile)).T
    return np.exp(np.interp(np.log(frequency), known, relative))
