"""A periodic injection during any motion: the response at its lines, and the apparent mass or inertia."""

from dataclasses import replace
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    Curve,
    FrequencyResponse,
    Metric,
    Quantity,
    RecordError,
    Result,
    Segment,
    Signals,
    degrees_of_freedom,
    param,
    response_result,
)
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator
from fraexp_plugins.estimators._shared.hann_windows import LINE_HALF_WIDTH

SMOOTHING_SHARE = 0.1
"""Part of the highest line's period over which the velocity is averaged: encoder increments do not look like reversals,
and reversals by the injection still do. Half of it sees increments in twice the velocity."""
OVERLAP_VARIANCE = 1 + 2 * 3 / 35
"""Variance of a mean of half overlapping blocks over that of independent ones: sin⁴ and its neighbour correlate by 3/35
(P. D. Welch, IEEE Trans. Audio and Electroacoustics 15(2), 1967, doi 10.1109/TAU.1967.1161901)."""


class InjectionOnMotion(PlantReferredEstimator, name="injection_on_motion", version=5):
    """P̂ = y'/u at the lines of a known periodic signal that is injected while the axis moves as its task demands.

    The record is cut into blocks in which the axis slides without reversal, wherever they begin; consecutive ones
    overlap by half. There Coulomb and rolling friction are constant. A block has as many periods of the injection as
    keep its lines apart. In each block the second difference of the output and the input, averaged over two samples as
    the hold does, are fitted by the sines of all lines and a polynomial of `order`, weighted by a window that vanishes
    at the ends with its derivatives. These are modulating functions (M. Shinbrot, Trans. ASME 79, 1957, 547-554): the
    motion is a nuisance that acts on the force as on the acceleration, so that their ratio remains that of the plant,
    and the state at the ends of a block does not enter. The blocks' phasors are averaged; their scatter gives the
    covariance (R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, section
    2.4).

    The apparent mass F/a (of a rotary axis the inertia T/α) follows at each line; viscous friction is its imaginary
    part, unless `effective_input` takes it off with this estimator as its `method`. With modes of the plant, a block
    must be longer than their decay.
    """

    motion_repeats: ClassVar[bool] = False
    """Whether the motion, and not only the injection, has the period of the record."""

    order: int = param("1", "order of the polynomial that takes slow friction", 2, at_least=0, at_most=20)
    min_speed: float = param("m/s", "speed below which the axis counts as reversing", 1e-3, at_least=0)

    expected_failures = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "it refuses an axis that turns round all the time, with which it is tried here",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/u with the apparent mass, and the number of blocks."""
        units = (signals.unit(self.input), signals.unit(self.output))
        found = [self._blocks(segment) for segment in signals.segments]
        inputs = [
            blocks.input * self.path(segment.frequency, segment.sample_time)
            for segment, blocks in zip(signals.segments, found, strict=True)
        ]
        moving = tuple(replace(segment, settling=None) for segment in signals.segments)  # blocks omit a start from rest
        result = response_result(
            replace(signals, segments=moving),
            inputs,
            [one.output for one in found],
            names=(self.input, self.output),
            units=units,
            repeats=False,
        )
        if result.response is None:
            return result
        factors = np.concatenate([one.variance_factor for one in found])
        blocks = np.concatenate([np.full(one.output.shape[1], float(len(one.output))) for one in found])
        response = with_variance_factor(result.response, factors, blocks)
        count = Metric("blocks", float(min(len(one.output) for one in found)), "1")
        return Result(
            result.outcome,
            result.findings,
            response,
            (*apparent_mass_metrics(response), count),
            (apparent_mass_curve(response),),
        )

    def _blocks(self, segment: Segment) -> "_Phasors":
        u, y = (segment.channels[name].ravel() for name in (self.input, self.output))
        block, lines = _block_of(segment)
        if lines[0] <= self.order / 2:
            raise RecordError(
                f"injection_on_motion: the lowest line has {lines[0]} periods in a block; expected more than half of "
                f"order, {self.order}: lower order, or give a higher min_frequency"
            )
        starts = self._starts(y, segment.sample_time, block, int(SMOOTHING_SHARE * block / lines[-1]))
        if len(starts) < 2:
            raise RecordError(
                f"injection_on_motion: {len(starts)} blocks of {block * segment.sample_time:.4g} s slide "
                "without reversal at ",
                Quantity(self.min_speed, "m/s"),
                " or more; expected 2: move farther or faster, inject with a shorter period, or lower min_speed",
            )
        delay = round((self.input_dead_time + self.output_dead_time) / segment.sample_time)
        return _block_phasors(u, y, starts, _Modulation.of(lines, block, self.order), delay)

    def _starts(self, y: NDArray[np.float64], sample_time: float, block: int, smoothing: int) -> list[int]:
        """Return the first samples of blocks without reversal, each half a block after the one before."""
        smoothing = max(smoothing, 1)
        speed = np.gradient(np.convolve(y, np.full(smoothing, 1 / smoothing), mode="same"))
        sign = np.where(np.abs(speed) >= self.min_speed * sample_time, np.sign(speed), 0.0)
        edges = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), y.size]
        starts: list[int] = []
        for begin, end in pairwise(edges):
            if sign[begin]:
                starts += range(begin + smoothing, end - smoothing - block + 1, max(block // 2, 1))
        return starts


def _block_of(segment: Segment) -> tuple[int, NDArray[np.int64]]:
    """Return the samples of a block, and the periods in it of each line, shape (lines,)."""
    common = int(np.gcd.reduce(segment.lines))
    basic = segment.lines // common
    count = int(np.ceil(LINE_HALF_WIDTH / np.diff(basic, prepend=0).min()))
    return count * segment.samples // common, count * basic


class _Modulation(NamedTuple):
    """The linear functionals of a block that give the phasors at its lines, whatever polynomial is added."""

    rows: NDArray[np.complex128]
    """Shape (lines, samples)."""
    angle: NDArray[np.float64]
    """Angle of each line per sample [rad], shape (lines,)."""
    window: NDArray[np.float64]
    """Root of the weights of the samples, shape (samples,)."""
    fitted: NDArray[np.float64]
    """Orthonormal basis of what is fitted to the windowed samples, shape (samples, parameters)."""

    @classmethod
    def of(cls, lines: NDArray[np.int64], block: int, order: int) -> "_Modulation":
        """Return those of weighted least squares."""
        angle = 2 * np.pi * lines / block
        turning = np.exp(1j * np.outer(np.arange(block), angle))
        powers = np.polynomial.legendre.legvander(np.linspace(-1, 1, block), order)
        basis = np.hstack([turning.real, -turning.imag, powers])
        window = np.sin(np.pi * (np.arange(block) + 0.5) / block) ** 2
        weighted = basis * window[:, None] ** 2
        rows = np.linalg.solve(basis.T @ weighted, weighted.T)
        fitted = np.linalg.qr(basis * window[:, None])[0]
        return cls(rows[: lines.size] + 1j * rows[lines.size : 2 * lines.size], angle, window, fitted)

    def phasors(self, values: NDArray[np.float64], starts: list[int]) -> NDArray[np.complex128]:
        """Return the phasors of the blocks that begin there, on the clock of the record, shape (blocks, lines)."""
        blocks = values[np.add.outer(starts, np.arange(self.rows.shape[1]))]
        return np.asarray(blocks @ self.rows.T * np.exp(-1j * np.outer(starts, self.angle)))

    def repetition(self, values: NDArray[np.float64], starts: list[int]) -> NDArray[np.float64]:
        """Return the variance of the mean of the blocks' phasors over that of independent blocks, shape (lines,).

        It is the sum of the correlations of the blocks' residuals, each turned by the line's angle between the blocks:
        where a move repeats itself, so does the pattern of the encoder's increments, in the residual as at the lines.
        """
        blocks = values[np.add.outer(starts, np.arange(self.rows.shape[1]))] * self.window
        residual = blocks - (blocks @ self.fitted) @ self.fitted.T
        residual /= np.maximum(np.linalg.norm(residual, axis=1), 1e-300)[:, None]
        turned = np.exp(-1j * np.outer(self.angle, starts)) @ residual
        return np.asarray(np.sum(np.abs(turned) ** 2, axis=1) / len(starts))


def _block_phasors(
    u: NDArray[np.float64], y: NDArray[np.float64], starts: list[int], modulation: _Modulation, delay: int
) -> "_Phasors":
    """Return the phasors of input and output, of an input that acts `delay` samples later."""
    acceleration = np.pad(np.diff(y, 2), 1)
    force = np.roll((u + np.roll(u, 1)) / 2, delay)
    angle = modulation.angle
    hold = np.cos(angle / 2) * np.exp(-1j * angle * (delay + 0.5))
    slide = np.cumsum(np.diff(starts, prepend=starts[:1]) > modulation.rows.shape[1] // 2)
    return _Phasors(
        modulation.phasors(force, starts) / hold,
        modulation.phasors(acceleration, starts) / (2 * np.cos(angle) - 2),
        slide,
        modulation.repetition(acceleration, starts),
    )


class _Phasors(NamedTuple):
    """Phasors of input and output in the blocks of a segment, each of shape (blocks, lines)."""

    input: NDArray[np.complex128]
    output: NDArray[np.complex128]
    slide: NDArray[np.int64]
    """Number of the slide to which each block belongs, shape (blocks,)."""
    repetition: NDArray[np.float64]
    """Variance of the mean over that of independent blocks by the blocks' residuals, shape (lines,)."""

    @property
    def variance_factor(self) -> NDArray[np.float64]:
        """Variance of the ratio of the means over that of independent blocks, shape (lines,).

        Half overlapping blocks correlate; and within a slide they share the pattern of the encoder's increments, which
        the scatter of the slides' sums shows (K.-Y. Liang and S. L. Zeger, Biometrika 73(1), 1986). What all slides
        have in common does not scatter: the residuals show it.
        """
        least = np.maximum(self.repetition, OVERLAP_VARIANCE)
        error = self.output - self.output.mean(axis=0) / self.input.mean(axis=0) * self.input
        sums = np.array([error[self.slide == number].sum(axis=0) for number in range(self.slide[-1] + 1)])
        if len(sums) == 1:
            return least
        squares = np.sum(np.abs(error) ** 2, axis=0) * len(error) / (len(error) - 1)
        between = np.sum(np.abs(sums) ** 2, axis=0) * len(sums) / (len(sums) - 1)
        return np.asarray(np.maximum(between / np.maximum(squares, 1e-300), least))


def with_variance_factor(
    response: FrequencyResponse, factor: NDArray[np.float64], blocks: NDArray[np.float64]
) -> FrequencyResponse:
    """Return a response whose covariance is so many times that of independent blocks, each of shape (lines,).

    So many fewer blocks are independent: their scatter about their own mean tells less, and has fewer degrees of
    freedom.
    """
    independent = np.maximum(blocks / factor, 2.0)  # fewer have no scatter
    larger = factor * (1 - 1 / blocks) / (1 - 1 / independent)
    return replace(response, covariance=response.covariance * larger[:, None, None], freedom=2 * (independent - 1))


def _apparent_mass(response: FrequencyResponse) -> NDArray[np.complex128]:
    """Return F/a at each line: force over the second derivative of the position."""
    return np.asarray(1 / (response.response * (2j * np.pi * response.frequency) ** 2), dtype=np.complex128)


def apparent_mass_metrics(response: FrequencyResponse) -> tuple[Metric, ...]:
    """Return the apparent mass, the mean of the real part of F/a weighted by its variance, with its deviation.

    The weights are estimates themselves: the mean of several lines with few degrees of freedom ν deviates by
    1 + 4 Σ w (1 - w)/ν more in variance, with 1/Σ(w²/ν) degrees of freedom for weights of the sum 1 (P. Meier,
    Biometrics 9(1), 1953, 59-73, doi 10.2307/3001633). The 95 % interval follows from both.
    """
    mass = _apparent_mass(response)
    variance = np.maximum((response.standard_deviation / np.abs(response.response) * np.abs(mass)) ** 2 / 2, 1e-300)
    total = float(np.sum(1 / variance))
    weights = 1 / variance / total
    from scipy.special import stdtrit  # slow to import

    freedom = degrees_of_freedom(response)
    deviation = float(np.sqrt((1 + 4 * np.sum(weights * (1 - weights) / freedom)) / total))
    unit = _mass_unit(response.unit)
    return (
        Metric("apparent mass", float(np.sum(weights * mass.real)), unit),
        Metric("apparent mass deviation", deviation, unit),
        Metric("apparent mass, 95 %", deviation * float(stdtrit(1 / np.sum(weights**2 / freedom), 0.975)), unit),
    )


def apparent_mass_curve(response: FrequencyResponse) -> Curve:
    """Return real and imaginary part of F/a over the frequency."""
    mass, unit = _apparent_mass(response), _mass_unit(response.unit)
    columns = {"frequency": response.frequency, "apparent mass": mass.real, "imaginary part": mass.imag}
    return Curve("apparent mass", columns, {"frequency": "Hz", "apparent mass": unit, "imaginary part": unit})


def _mass_unit(unit: str) -> str:
    """Return the unit of F/a for a response of position over force."""
    return "kg" if unit == "m/N" else f"s**2/({unit})"
