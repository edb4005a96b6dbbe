"""What noise and rounding of the encoder do to a response of one period: motions that could have given the record.

Nothing repeats in one period, so no mean error is taken off. Around the measured motion others are drawn that are as
likely. The force along what the observer took, less the force along such a motion, is one error of the force. Errors
are alike at neighbouring frequencies, so that a few motions at a few frequencies suffice.
"""

import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Segment, rounding_symmetry
from fraexp_plugins.estimators._shared.measured_terms import measured_terms
from fraexp_plugins.estimators._shared.weak_terms import CLEAR_TERM_STDS, motion_shares

MIN_DRAWS = 16
"""Errors from which a variance is taken, at least."""
REACH = 2**0.5
"""Ratio of frequencies up to which errors are alike."""
SPACING = 2 ** (1 / 3)
"""Ratio of the frequencies at which motions are drawn, at least."""


class PossibleMotions(NamedTuple):
    """A measured motion, and others that could have given the same record, by their Fourier coefficients."""

    terms: NDArray[np.complex128]
    """What the observer takes in the first row, motions that are possible in the others, shape (1 + draws, terms)."""
    output_errors: NDArray[np.complex128]
    """Phasors of the output less those of the possible motions [m], shape (draws, lines)."""
    lines: NDArray[np.int64]
    """Terms that are excited, shape (lines,)."""
    duration: float
    """Period of the motion [s]."""
    likely: NDArray[np.complex128]
    """The mean of the possible motions, shape (terms,): of a weak term, its likely part."""


class EncoderErrorSamples(NamedTuple):
    """Errors of output and friction force at some frequencies."""

    frequency: NDArray[np.float64]
    """Frequencies [Hz], shape (n,)."""
    output: NDArray[np.complex128]
    """Errors of the output [m], shape (draws, n)."""
    force: NDArray[np.complex128]
    """Errors of the force [N], shape (draws, n)."""
    deviation: NDArray[np.float64]
    """Standard deviation of the output's phasors [m], with which both scale, shape (n,)."""


class ErrorMoments(NamedTuple):
    """Second moments of the errors of output δy and friction force δf, shape (n,)."""

    output: NDArray[np.float64]
    """E|δy|² [m²]."""
    force: NDArray[np.float64]
    """E|δf|² [N²]."""
    product: NDArray[np.complex128]
    """E[δy conj(δf)] [m N]."""
    freedom: NDArray[np.float64]
    """Their degrees of freedom: two for each error."""

    def variance(self, output: NDArray[np.complex128], force: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return E|output δy + force δf|², shape (n,)."""
        mixed = 2 * np.real(output * np.conj(force) * self.product)
        squares = np.abs(output) ** 2 * self.output + np.abs(force) ** 2 * self.force
        return np.asarray(np.maximum(squares + mixed, 0.0))


def examined_segments(segments: Sequence[Segment]) -> list[Segment]:
    """Return the segments whose motions are drawn: of those with a single line a few in each octave."""
    chosen, last = [segment for segment in segments if segment.lines.size > 1], 0.0
    for segment in sorted(segments, key=lambda segment: float(segment.frequency[0])):
        if segment.lines.size == 1 and segment.frequency[0] >= SPACING * last:
            chosen.append(segment)
            last = float(segment.frequency[0])
    return chosen


def draws_per_segment(segments: Sequence[Segment]) -> int:
    """Return how many motions each of these segments needs, so that neighbouring frequencies have enough together."""
    frequency = np.sort(np.concatenate([segment.frequency for segment in segments]))
    first, behind = _neighbours(frequency, frequency)
    return int(np.ceil(MIN_DRAWS / np.median(behind - first)))


def possible_motions(segment: Segment, channel: str, resolution: float, noise: float, draws: int) -> PossibleMotions:
    """Return the motion of a record of one period, and motions that are as likely.

    A clear term is known but for its scatter. A weaker one, which the observer leaves out, is as strong as its
    neighbours make likely.
    """
    measured = measured_terms(segment, channel, resolution, noise)
    terms, (count, samples) = measured.terms, measured.periods.shape
    rounding, random = resolution**2 / 12 / samples, noise**2 / (count * samples)
    share = motion_shares(terms, rounding + random)
    scatter = np.full(terms.size, rounding + random)
    scatter[1::2] = rounding_symmetry(segment) * rounding + random
    generator = np.random.default_rng(zlib.crc32(measured.periods.tobytes()))
    normal = generator.standard_normal((draws, 2 * terms.size)).view(complex) * np.sqrt(0.5)
    drawn = share * terms + np.sqrt(share * scatter) * normal
    found = np.where(np.abs(terms) < CLEAR_TERM_STDS * np.sqrt(rounding + random), 0, terms)
    lines = measured.lines
    output_errors = 2 * (terms - drawn)[:, lines]
    return PossibleMotions(np.vstack([found, drawn]), output_errors, lines, measured.duration, share * terms)


def error_moments(
    samples: EncoderErrorSamples, frequency: NDArray[np.float64], deviation: NDArray[np.float64]
) -> ErrorMoments:
    """Return the moments at frequencies [Hz], shape (n,), from the errors at neighbouring ones.

    `deviation` is the standard deviation of the output's phasors there [m], shape (n,).
    """
    order = np.argsort(samples.frequency, kind="stable")
    first, behind = _neighbours(samples.frequency[order], frequency)
    output, force = (errors[:, order] / samples.deviation[order] for errors in (samples.output, samples.force))

    def mean(products: NDArray[np.complex128]) -> NDArray[np.complex128]:
        sums = np.concatenate([[0.0], np.cumsum(np.add.reduce(products, axis=0) / len(products))])
        return np.asarray((sums[behind] - sums[first]) / (behind - first) * deviation**2)

    return ErrorMoments(
        mean(output * output.conj()).real,
        mean(force * force.conj()).real,
        mean(output * force.conj()),
        np.asarray(2.0 * (behind - first) * len(output), dtype=float),
    )


def _neighbours(
    known: NDArray[np.float64], frequency: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first one of ascending known frequencies [Hz] near each frequency, and the one behind the last."""
    return np.searchsorted(known, frequency / REACH), np.searchsorted(known, frequency * REACH, side="right")
