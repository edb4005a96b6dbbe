"""The motion that an encoder measured: the posterior of the terms of its Fourier series, and rounding that repeats.

Noise and rounding hide a term the more, the weaker it is. So a term is estimated from its own value and from what is
likely before it is measured, weighted by their variances (empirical Bayes: B. Efron and C. Morris, Stein's estimation
rule and its competitors, J. Am. Stat. Assoc. 68(341), 1973, doi:10.1080/01621459.1973.10481350). Likely is what
friction makes of the plant, or the power of the neighbours, because the spectrum of a motion is smooth. The rounding
error along a known motion is known as well, and taken off.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    MAX_ITERATIONS,
    ROUNDING,
    SIGNIFICANCE,
    Encoder,
    Result,
    Segment,
    grid_step,
    phasor_variance,
    record_spectrum,
    significant_deviation,
)

ROUNDING_HARMONICS = 200
"""Terms of the Fourier series of the rounding error over one quantisation step."""
COHERENCE = 2.0
"""Variance of a term by rounding that repeats, over that of white rounding: about a step of the scale, where a loop
rests, neighbouring terms err alike. In the loop of the paper at 12 N it is 2.1 over 1 to 55 Hz. With half of it a
response is ok where the encoder hides the motion."""
LEAST_ERROR = 0.1
"""Relative error of a term that friction predicts, at least: a measured term is never given up for it altogether.
Without it the harmonics do not tell a dead time."""
MIN_NEIGHBOURS = 4
"""Terms on either side from which the power of a weak one is taken: so many, or one of so many of the terms below it,
because the spectrum of a motion falls over a ratio of frequencies."""


class LikelyTerms(NamedTuple):
    """What friction makes likely of each term, before it is measured, shape (terms,)."""

    mean: NDArray[np.complex128]
    """Its likely value [m]; 0 where friction does not predict it."""
    deviation: NDArray[np.float64]
    """Standard deviation of that [m], by an error that all terms have in common; NaN where friction does not predict
    it."""

    @classmethod
    def unknown(cls, count: int) -> "LikelyTerms":
        """Return it for terms of which nothing is known beforehand."""
        return cls(np.zeros(count, dtype=complex), np.full(count, np.nan))


class MeasuredMotion(NamedTuple):
    """The motion in a segment, by Fourier coefficients up to the Nyquist frequency, shape (terms,).

    A motion may repeat itself within a period: its terms are those at multiples of its own frequency.
    """

    terms: NDArray[np.complex128]
    """The mean over the periods less the rounding error along the motion [m]."""
    rounding: NDArray[np.complex128]
    """That error [m]."""
    variance: float
    """Variance of a term by noise and rounding [m²]; what is taken off is not subtracted, for it is an estimate."""
    blur: float
    """Standard deviation of what blurs the rounding error: noise, and what is not known of the motion [m]."""
    taken: NDArray[np.complex128]
    """The measured terms that stand out of noise and rounding, which an observer takes for the motion [m]."""
    posterior: NDArray[np.complex128]
    """Mean of what the terms can be [m]."""
    share: NDArray[np.float64]
    """Share of the measured value in that, 0 … 1; its variance is share × variance."""
    likely: LikelyTerms
    """What friction made likely of it."""
    lines: NDArray[np.int64]
    """Terms that are excited, shape (lines,)."""
    duration: float
    """Period of the motion [s]."""

    @classmethod
    def of(
        cls, segment: Segment, channel: str, encoder: Encoder, likely: LikelyTerms | None = None
    ) -> "MeasuredMotion":
        """Return the motion that an encoder measured."""
        periods, step = segment.channels[channel], int(np.gcd.reduce(segment.lines))
        count, samples = periods.shape
        measured = record_spectrum(segment, channel)[: (periods.size + 1) // 2 : count * step] / periods.size
        likely, lines = likely or LikelyTerms.unknown(measured.size), segment.lines // step
        rounding_variance = float(phasor_variance(segment, encoder._replace(noise=0.0), channel)[0]) / 4
        repeated = repeated_share(encoder.resolution, encoder.noise)
        random = encoder.noise**2 / (samples * count) + rounding_variance * (1 - repeated) / count
        variance = random + COHERENCE * rounding_variance * repeated
        posterior, share = _posterior(measured, variance, likely, lines)
        rounding, blur = np.zeros_like(measured), encoder.noise
        if encoder.resolution:
            blur = float(np.hypot(encoder.noise, np.sqrt(2 * variance * np.add.reduce(share))))
            bins = np.zeros(samples // 2 + 1, dtype=complex)
            bins[: (samples + 1) // 2 : step] = posterior
            error = mean_rounding_error(np.fft.irfft(bins, samples) * samples, encoder.resolution, blur)
            rounding = np.fft.rfft(error)[: (samples + 1) // 2 : step] / samples
            posterior, share = _posterior(measured - rounding, variance, likely, lines)
        duration = samples * segment.sample_time / step
        taken = np.where(stands_out(measured, segment, count, encoder), measured, 0)
        return cls(measured - rounding, rounding, variance, blur, taken, posterior, share, likely, lines, duration)

    @property
    def omega(self) -> NDArray[np.float64]:
        """Frequencies of the terms [rad/s], shape (terms,)."""
        return np.asarray(2 * np.pi / self.duration * np.arange(self.terms.size))

    @property
    def is_clear(self) -> NDArray[np.bool_]:
        """Whether a term stands out of noise and rounding, shape (terms,)."""
        return np.asarray(np.abs(self.terms) ** 2 >= clear_power(self.terms.size) * self.variance)


def clear_power(terms: int) -> float:
    """Return the power of a term over its variance by noise from which it is clear: of so many one, at most, by chance.

    The power of a complex normal variable is distributed exponentially.
    """
    return float(np.log(terms / SIGNIFICANCE))


def stands_out(terms: NDArray[np.complex128], segment: Segment, count: int, encoder: Encoder) -> NDArray[np.bool_]:
    """Return whether Fourier coefficients of a mean over periods stand out of noise and rounding, shape (terms,)."""
    variance = (encoder.noise**2 / count + encoder.resolution**2 / 12) / segment.samples
    return np.asarray(np.abs(terms) ** 2 >= clear_power(terms.size) * variance)


def _posterior(
    terms: NDArray[np.complex128], variance: float, likely: LikelyTerms, lines: NDArray[np.int64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the mean of what terms can be, and the share of their measured value in it, shape (terms,) each.

    An excited one may have any size.
    """
    beforehand = np.maximum(likely.deviation, LEAST_ERROR * np.abs(likely.mean)) ** 2
    share = np.where(np.isnan(beforehand), _shares(terms, variance), beforehand / (beforehand + variance))
    share[lines] = 1.0
    return likely.mean + share * (terms - likely.mean), share


def _shares(terms: NDArray[np.complex128], variance: float) -> NDArray[np.float64]:
    """Return the share of each term that is motion rather than noise, 0 … 1, shape (terms,): Wiener's v/(v + s).

    Of a clear term v is its power less the variance s, of a weaker one the mean of that over its neighbours of the same
    parity: the even terms of a motion that is odd about its middle vanish.
    """
    power = np.abs(terms) ** 2 / variance
    found, clear = 1 - 1 / np.maximum(power, 1.0), clear_power(terms.size)
    for first in (1, 2):
        own = power[first::2]
        excess, number = np.minimum(own, clear) - 1, np.arange(own.size)
        reach = np.maximum(MIN_NEIGHBOURS, number // MIN_NEIGHBOURS)
        begin, behind = np.maximum(number - reach, 0), np.minimum(number + reach + 1, own.size)
        sums = np.concatenate([[0.0], np.cumsum(excess)])
        mean = (sums[behind] - sums[begin]) / (behind - begin)
        mean = np.where(mean * np.sqrt(behind - begin) > significant_deviation(), mean, 0.0)
        found[first::2] = np.where(own >= clear, found[first::2], mean / (mean + 1))
    return found


def mean_rounding_error(position: NDArray[np.float64], resolution: float, noise: float) -> NDArray[np.float64]:
    """Return the mean rounding error [m] at positions [m] of any shape, over normal noise [m]."""
    error, turn = np.zeros_like(position), np.exp(2j * np.pi / resolution * position)
    harmonic = np.ones_like(turn)
    for order in range(1, ROUNDING_HARMONICS + 1):
        damping = np.exp(-2 * (np.pi * order * noise / resolution) ** 2)
        if damping < ROUNDING:
            break
        harmonic *= turn
        error += (-1) ** order * resolution / (np.pi * order) * damping * harmonic.imag
    return error


def recorded_step(segments: Sequence[Segment], channel: str) -> float:
    """Return the step to which a measured channel is rounded [its unit]; 0 if none is seen, or it is negligible.

    Segments that state whether they had settled are played or simulated, by whoever knows the encoder.
    """
    if any(segment.settling is not None or segment.stated is not None for segment in segments):
        return 0.0
    samples = np.concatenate([segment.channels[channel].ravel() for segment in segments])
    return grid_step(samples)


def repeated_share(resolution: float, noise: float) -> float:
    """Return the share of the rounding error's variance q²/12 that repeats with a motion, under normal noise [m].

    Without noise that is all of it. Noise acts as dither: of the rounding error's sawtooth over the position the mean
    over noise keeps its k-th harmonic (q/πk) e^{-2(πkσ/q)²}. R. M. Gray and T. G. Stockham, Dithered quantizers, IEEE
    Trans. Inf. Theory 39(3), 1993, doi:10.1109/18.256489.
    """
    if not (resolution and noise):
        return 1.0
    order = np.arange(1, ROUNDING_HARMONICS + 1)
    amplitudes = np.exp(-2 * (np.pi * order * noise / resolution) ** 2) / (np.pi * order)
    return float(6 * np.add.reduce(amplitudes**2))


def with_rounding(
    found: Result, segments: Sequence[Segment], output: str, resolution: float, encoder: Encoder | None
) -> Result:
    """Return a result less the rounding of its output that repeats in every period, with the rest in its band.

    Scatter over the periods does not show it. It is the smaller, the more the periods differ: noise is dither. That of
    one period is left as it is: what is known of the encoder is its band.
    """
    response = found.response
    repeats = min((len(segment.channels[output]) for segment in segments), default=0) > 1
    if response is None or not resolution or not repeats:
        return found
    parts = [_repeated_rounding(segment, output, resolution, encoder) for segment in segments]
    error, variance = (np.concatenate(each) for each in zip(*parts, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        known = variance / response.input_amplitude**2
        shown = response.standard_deviation**2
        freedom = np.inf if response.freedom is None else response.freedom
        freedom = np.where(shown > 0, freedom * (1 + known / shown) ** 2, np.inf)  # Welch and Satterthwaite
    covariance = response.covariance + known[:, None, None] * (np.eye(2) / 2)
    moved = replace(response, response=response.response * (1 - error), covariance=covariance, freedom=freedom)
    return replace(found, response=moved)


def _repeated_rounding(
    segment: Segment, output: str, resolution: float, encoder: Encoder | None
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the rounding error that repeats, relative to the output, and the variance of the rest [m²], (lines,)."""
    if segment.stated is not None:
        return np.zeros(segment.lines.size, dtype=complex), np.zeros(segment.lines.size)
    periods, noise = segment.channels[output], encoder.noise if encoder is not None else 0.0
    noise = max(noise, _noise_from_scatter(float(np.mean(np.var(periods, axis=0, ddof=1))), resolution))
    motion = MeasuredMotion.of(segment, output, Encoder(noise, resolution))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        error = (motion.rounding / (motion.terms + motion.rounding))[motion.lines]
    if float(np.ptp(periods)) < 1.5 * resolution:  # it toggles, as with any smaller motion
        return error, np.abs(2 * (motion.terms + motion.rounding)[motion.lines]) ** 2
    left = max(repeated_share(resolution, noise) - repeated_share(resolution, motion.blur), 0.0)
    return error, phasor_variance(segment, Encoder(0.0, resolution), output) * left


def _noise_from_scatter(variance: float, resolution: float) -> float:
    """Return the noise [m] with which rounded positions scatter with this variance [m²] from period to period."""
    low, high = 0.0, float(np.sqrt(variance))  # rounding only adds to the scatter
    for _ in range(MAX_ITERATIONS):
        middle = (low + high) / 2
        rounding = resolution**2 / 12 * (1 - repeated_share(resolution, middle))
        low, high = (middle, high) if middle**2 + rounding < variance else (low, middle)
    return low
