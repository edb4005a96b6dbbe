"""How finely a period is sampled, and how whole cycles fit into whole samples."""

from functools import cache, lru_cache
from math import gcd

import numpy as np

from fraexp.api import ParameterError

LEAST, MOST = 16, 2_000_000
"""Samples per period that make a wave, and that fit into memory: half a gigabyte of channels."""
MOST_RECORDED = 20_000_000
"""Samples that an experiment records in all, at most: about a gigabyte of channels."""
LEAST_CYCLES = 1e-18
"""Cycles per sample, of which fewer are none."""
NEAR = 1e-3
"""Relative distance at which a frequency counts as met by whole periods in whole samples."""
SHORTEST, LONGEST = 400, 1 << 16
"""Samples of a block of whole periods, at least and at most."""
EXACT = 1e-9
"""Relative distance at which a frequency is the one asked for."""
LITTLE_LONGER = 1.2
"""How much longer a block may be, if its number of samples has small prime factors only."""
PHASES = 20
"""Different phases at which a sine is sampled, at least."""
SMALL = 13
"""Greatest prime factor of a number of samples whose Fourier transform is fast."""


def samples_per_period(name: str, frequency: float, sample_time: float) -> int:
    """Return the whole number nearest to 1/(f Ts); ParameterError if `LEAST` are not reached."""
    samples = round(1 / max(frequency * sample_time, LEAST_CYCLES))
    if samples > MOST:
        raise ParameterError(
            f"{name} has {samples:,} samples per period at {frequency:g} Hz and a sample time of {sample_time:g} s; "
            f"expected {MOST:,} at most: raise 'frequency', or lengthen loop.sample_time"
        )
    if samples < LEAST:
        raise ParameterError(
            f"{name} has {samples} samples per period at {frequency:g} Hz and a sample time of {sample_time:g} s; "
            f"expected {LEAST} at least: lower 'frequency', or shorten loop.sample_time"
        )
    return samples


def even_samples(duration: float, sample_time: float) -> int:
    """Return the even number of samples nearest to `duration` [s] whose Fourier transform is fast.

    It is even because the second half of a period of odd harmonics is the first one with its sign changed, which
    a wave that is held between samples can only be if both halves have equally many.
    """
    half = max(round(duration / sample_time / 2), 1)
    nearest = (half + sign * away for away in range(half + 1) for sign in (-1, 1))
    return 2 * next(samples for samples in nearest if samples > 0 and max(_prime_factors(samples)) <= SMALL)


@cache
def coherent(cycles_per_sample: float) -> tuple[int, int]:
    """Return whole cycles and whole samples whose ratio is near `cycles_per_sample`.

    The samples meet the sine at `PHASES` different phases at least: what the resolution of a scale hides from one
    of them the others show. Of numbers of samples that are alike one is taken whose Fourier transform is fast.
    """
    fitting: list[tuple[int, int]] = []
    for cycles in range(1, max(2, int(cycles_per_sample * LONGEST))):
        least = max(int(np.ceil(cycles / cycles_per_sample / (1 + NEAR))), SHORTEST)
        if fitting and least > LITTLE_LONGER * fitting[0][1]:
            break
        most = int(np.floor(cycles / cycles_per_sample / (1 - NEAR)))
        fitting += [(cycles, samples) for samples in range(least, most + 1) if samples >= PHASES * gcd(cycles, samples)]
    if fitting:
        exact = [pair for pair in fitting if abs(pair[0] / (pair[1] * cycles_per_sample) - 1) < EXACT]
        return min(exact or fitting, key=lambda pair: (sum(_prime_factors(pair[1])), pair[1]))
    samples = max(round(1 / cycles_per_sample), PHASES)
    return 1, samples


def coherent_half(least: float, cycles_per_sample: float) -> tuple[int, int]:
    """Return whole cycles and whole samples of half a period, `least` samples long at least.

    Their ratio is near `cycles_per_sample`, and below the Nyquist frequency.
    """
    first = max(int(np.ceil(least * cycles_per_sample * (1 - EXACT))), 1)
    found = [
        (cycles, max(round(cycles / cycles_per_sample), 2 * cycles + 1)) for cycles in range(first, 2 * first + 10)
    ]
    near = [pair for pair in found if abs(pair[0] / (pair[1] * cycles_per_sample) - 1) <= NEAR]
    if not near:
        return min(found, key=lambda pair: abs(pair[0] / (pair[1] * cycles_per_sample) - 1))
    short = [pair for pair in near if pair[1] <= LITTLE_LONGER * near[0][1]]
    return min(short, key=lambda pair: (sum(_prime_factors(pair[1])), pair[1]))


@lru_cache(1024)
def sine(cycles: int, samples: int) -> np.ndarray:
    """Return whole cycles of a sine; many sweeps have the same frequencies."""
    return np.sin(2 * np.pi * (cycles * np.arange(samples) % samples) / samples)


@cache
def _prime_factors(samples: int) -> tuple[int, ...]:
    """Return the prime factors; a Fourier transform takes about their sum of operations per sample."""
    found, factor = [], 2
    while samples > 1:
        while samples % factor == 0:
            found.append(factor)
            samples //= factor
        factor += 1 if factor * factor <= samples else samples - factor
    return tuple(found or [1])
