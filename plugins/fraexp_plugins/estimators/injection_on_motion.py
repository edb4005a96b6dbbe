"""A periodic injection during any motion: the response at its lines, and the apparent mass or inertia."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, FrequencyResponse, Metric, RecordError, Result, Segment, Signals, param, response_result
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator

SMOOTHING_SAMPLES = 5
"""Samples over which the velocity is averaged, so that encoder increments do not look like reversals."""
MIN_LINES_PER_ORDER = 0.5
"""Lowest line of a block relative to the order of the polynomial: below, the polynomial contains the line."""


class InjectionOnMotion(PlantReferredEstimator, name="injection_on_motion", version=1):
    """P̂ = y'/u at the lines of a known periodic signal that is injected while the axis moves as its task demands.

    The record is cut into blocks of one period of the injection in which the axis slides without reversal, wherever
    they begin. There Coulomb and rolling friction are constant. In each block input and output are fitted, by least
    squares, by the sines of all lines and a polynomial of `order`: motion and the slow part of friction are a nuisance
    that the polynomial takes, exactly for a minimum-jerk move at order 5 (T. Flash and N. Hogan, Journal of
    Neuroscience 5(7), 1985, 1688-1703). The blocks' phasors are averaged; their scatter gives the covariance (R.
    Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, section 2.4).

    The apparent mass F/a (of a rotary axis the inertia T/α) follows at each line; viscous friction is its imaginary
    part, unless `effective_input` takes it off with this estimator as its `method`. Lines below `order`/2 periods per
    block are left out.
    """

    order: int = param("1", "order of the polynomial that takes motion and slow friction", 6, at_least=1, at_most=20)
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
        result = response_result(
            signals, inputs, [one.output for one in found], names=(self.input, self.output), units=units
        )
        if result.response is None:
            return result
        count = Metric("blocks", float(min(len(one.output) for one in found)), "1")
        return Result(
            result.outcome,
            result.message,
            result.response,
            (*apparent_mass_metrics(result.response), count),
            (apparent_mass_curve(result.response),),
        )

    def _blocks(self, segment: Segment) -> "_Phasors":
        u, y = (segment.channels[name].ravel() for name in (self.input, self.output))
        starts = self._starts(y, segment)
        if len(starts) < 2:
            raise RecordError(
                f"injection_on_motion: {len(starts)} blocks of {segment.samples * segment.sample_time:.4g} s slide "
                f"without reversal at {self.min_speed:g} m/s or more; expected 2: move farther or faster, inject with "
                "a shorter period, or lower min_speed"
            )
        if segment.lines[0] < MIN_LINES_PER_ORDER * self.order:
            raise RecordError(
                f"injection_on_motion: the lowest line has {segment.lines[0]} periods in a block; expected "
                f"{int(np.ceil(MIN_LINES_PER_ORDER * self.order))}: lower order, or give a higher min_frequency"
            )
        fits = np.array([self._fit(segment, start, u, y) for start in starts])
        return _Phasors(fits[:, 0], fits[:, 1])

    def _starts(self, y: NDArray[np.float64], segment: Segment) -> list[int]:
        """Return the first samples of consecutive blocks without reversal."""
        speed = np.gradient(np.convolve(y, np.full(SMOOTHING_SAMPLES, 1 / SMOOTHING_SAMPLES), mode="same"))
        threshold = self.min_speed * segment.sample_time
        sign = np.where(np.abs(speed) >= threshold, np.sign(speed), 0.0)
        edges = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), y.size]
        starts: list[int] = []
        for begin, end in pairwise(edges):
            if sign[begin]:
                inner = range(begin + SMOOTHING_SAMPLES, end - SMOOTHING_SAMPLES - segment.samples + 1, segment.samples)
                starts += inner
        return starts

    def _fit(
        self, segment: Segment, start: int, u: NDArray[np.float64], y: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the phasors of input and output in a block, on the clock of the record, shape (2, lines)."""
        samples = np.arange(start, start + segment.samples)
        turning = np.exp(2j * np.pi * np.outer(samples, segment.lines) / segment.samples)
        powers = np.polynomial.legendre.legvander(np.linspace(-1, 1, segment.samples), self.order)
        basis = np.hstack([turning.real, -turning.imag, powers])
        both = np.stack([u[samples], y[samples]], axis=1)
        scale = np.abs(both).max(axis=0)
        found = np.linalg.lstsq(basis, both / scale, rcond=None)[0] * scale
        count = segment.lines.size
        return np.asarray((found[:count] + 1j * found[count : 2 * count]).T, dtype=np.complex128)


class _Phasors(NamedTuple):
    """Phasors of input and output in the blocks of a segment, each of shape (blocks, lines)."""

    input: NDArray[np.complex128]
    output: NDArray[np.complex128]


def _apparent_mass(response: FrequencyResponse) -> NDArray[np.complex128]:
    """Return F/a at each line: force over the second derivative of the position."""
    return np.asarray(1 / (response.response * (2j * np.pi * response.frequency) ** 2), dtype=np.complex128)


def apparent_mass_metrics(response: FrequencyResponse) -> tuple[Metric, ...]:
    """Return the apparent mass, the mean of the real part of F/a weighted by its variance, with its deviation."""
    mass = _apparent_mass(response)
    variance = np.maximum((response.standard_deviation / np.abs(response.response) * np.abs(mass)) ** 2 / 2, 1e-300)
    weights = 1 / variance
    unit = _mass_unit(response.unit)
    return (
        Metric("apparent mass", float(np.sum(weights * mass.real) / np.sum(weights)), unit),
        Metric("apparent mass deviation", float(1 / np.sqrt(np.sum(weights))), unit),
    )


def apparent_mass_curve(response: FrequencyResponse) -> Curve:
    """Return real and imaginary part of F/a over the frequency."""
    mass, unit = _apparent_mass(response), _mass_unit(response.unit)
    columns = {"frequency": response.frequency, "apparent mass": mass.real, "imaginary part": mass.imag}
    return Curve("apparent mass", columns, {"frequency": "Hz", "apparent mass": unit, "imaginary part": unit})


def _mass_unit(unit: str) -> str:
    """Return the unit of F/a for a response of position over force."""
    return "kg" if unit == "m/N" else f"s**2/({unit})"
