"""The moving-axis FRA method: excitation during a motion without reversals, so that friction keeps its sign."""

import itertools
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Finding, Metric, Outcome, Quantity, RecordError, Result, Segment, Signals, param, response_result
from fraexp_plugins.estimators._shared.delayed_estimator import PlantReferredEstimator

MIN_RELATIVE_LENGTH = 0.8
"""Length of a block over that of the longest one from which it is used: the record's ends cut off the others. Half of
it uses those that have lost less than 60 %."""


class MovingAxis(PlantReferredEstimator, name="moving_axis", version=1):
    """P̂ = y'/u from the blocks of a record in which a base motion of constant velocity prevents reversals.

    Without reversals rolling and Coulomb friction are a constant force, and only viscous friction remains. Drives are
    commissioned like this (Siemens SINAMICS: an offset such that the speed has no zero crossings; Aerotech Automation1:
    Enable Motion). The record itself shows the reversals. A block leaves out `reversal_settling_time` after a reversal,
    and before the next one the time in which the reference brakes, or `reversal_settling_time` without a reference. In
    each block an offset, a slope, a cosine and a sine are fitted to input and output by least squares over whole
    periods of the sine, which is exact for a constant velocity. The phasors of all blocks of both directions are
    averaged; their scatter gives the covariance, with 2(S - 1) degrees of freedom for S blocks (R. Pintelon and
    J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, section 2.4).

    Do not use it if the stroke is too short, nor on a base motion whose velocity changes within the blocks, such as a
    slow sine, which an offset and a slope do not describe. A slow sine is periodic and orthogonal to the sine over
    whole periods, where `conventional` is exact.
    """

    reversal_settling_time: float = param(
        "s", "settling time after each reversal, in which its disturbance decays", 0.5,
        at_least=0, inherit="excitation.reversal_settling_time",
    )  # fmt: skip
    reference_channel: str = param("", "channel of the position reference, if there is one", "reference")

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses an axis that turns round all the time, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/u, or y'/(G_di G_do u), the minimum velocity, and the residual of the blocks."""
        units = (signals.unit(self.input), signals.unit(self.output))
        found = [self._blocks(segment) for segment in signals.segments]
        inputs = [
            blocks.input * self.path(segment.frequency, segment.sample_time)
            for segment, blocks in zip(signals.segments, found, strict=True)
        ]
        outputs = [blocks.output for blocks in found]
        result = response_result(signals, inputs, outputs, names=(self.input, self.output), units=units, repeats=False)
        if not found:
            return result
        metrics = (
            Metric("minimum velocity", min(blocks.velocity for blocks in found), f"{units[1]}/s"),
            Metric("stretches per frequency", min(len(blocks.output) for blocks in found), "1"),
            Metric("residual over amplitude", max(blocks.residual for blocks in found), "1"),
        )
        remarks = result.findings or _residual_remarks(result.outcome, found)
        return Result(result.outcome, remarks, result.response, metrics)

    def _blocks(self, segment: Segment) -> "_Blocks":
        if segment.lines.size != 1:
            raise RecordError(
                f"moving_axis: {segment.lines.size} lines are excited at once; expected one sine at a time: use an "
                "excitation such as moving_sine"
            )
        frequency, sample_time = float(segment.frequency[0]), segment.sample_time
        y = segment.channels[self.output].ravel()
        bounds = _whole_periods(self._bounds(segment, y), 1 / (frequency * sample_time))
        if not bounds:
            raise RecordError(
                f"moving_axis: {self.output} has no constant velocity for a period of {frequency:.4g} Hz, "
                f"from {self.reversal_settling_time:g} s after a reversal on; raise velocity or period of the base "
                "motion, or lower the sine's amplitude"
            )
        u = segment.channels[self.input].ravel()
        turn = 2 * np.pi * frequency * sample_time
        fits = [_sine_fit(u[begin:end], y[begin:end], begin, turn) for begin, end in bounds]
        velocity = min(float(np.min(np.abs(_slope(y)[begin:end]))) for begin, end in bounds) / sample_time
        phasors = np.array([fit.phasors for fit in fits])
        size = abs(complex(phasors[:, 1].mean()))
        residual = max(fit.residual for fit in fits) / size if size else np.inf
        return _Blocks(phasors[:, :1], phasors[:, 1:], velocity, float(residual))

    def _bounds(self, segment: Segment, y: NDArray[np.float64]) -> list[tuple[int, int]]:
        direction = np.sign(_slope(y))
        after = int(np.ceil(self.reversal_settling_time / segment.sample_time))
        if self.reference_channel not in segment.channels:
            return _blocks_between_reversals(direction, after, after)
        steps = np.diff(segment.channels[self.reference_channel].ravel())
        direction[1:-1][~np.isclose(steps[1:], steps[:-1], atol=0.0)] = 0
        return _blocks_between_reversals(direction, 0, after)


@dataclass(frozen=True)
class _Blocks:
    """Phasors and residual of the blocks of one segment."""

    input: NDArray[np.complex128]
    """Phasor of the input of each block, shape (blocks, 1)."""
    output: NDArray[np.complex128]
    """Phasor of the output of each block, shape (blocks, 1)."""
    velocity: float
    """Minimum magnitude of the velocity in them."""
    residual: float
    """Largest root mean square residual of the output without noise, relative to the sine's amplitude."""


def _slope(y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the central difference per sample; the two ends repeat their neighbours."""
    inner = (y[2:] - y[:-2]) / 2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _blocks_between_reversals(direction: NDArray[np.float64], before: int, after: int) -> list[tuple[int, int]]:
    """Return begin and end of each block in one direction, without so many samples before and after a reversal."""
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    runs = itertools.pairwise([0, *turns.tolist(), direction.size])
    moving = [(begin + after, end - before) for begin, end in runs if direction[begin] != 0]
    return [(begin, end) for begin, end in moving if end > begin]


def _whole_periods(blocks: list[tuple[int, int]], period: float) -> list[tuple[int, int]]:
    """Return the blocks cut to whole periods [samples], without those that are much shorter than the longest."""
    found = []
    for begin, end in blocks:
        whole = np.floor((end - begin) / period)
        if whole >= 1:
            found.append((begin, begin + round(whole * period)))
    longest = max((end - begin for begin, end in found), default=0)
    return [(begin, end) for begin, end in found if end - begin >= MIN_RELATIVE_LENGTH * longest]


class _SineFit(NamedTuple):
    """Offset, slope and sine of one block."""

    phasors: NDArray[np.complex128]
    """Of input and output, shape (2,)."""
    residual: float
    """Root mean square residual of the output without white noise."""


def _sine_fit(u: NDArray[np.float64], y: NDArray[np.float64], begin: int, turn: float) -> _SineFit:
    """Return the sine in u and y.

    `begin` is the number of the first sample, and `turn` the sine's phase per sample [rad].
    """
    samples = np.arange(u.size)
    phase = turn * (begin + samples)
    basis = np.stack([np.ones(u.size), 2 * samples / u.size - 1, np.cos(phase), -np.sin(phase)], axis=1)
    both = np.stack([u, y], axis=1)
    coefficients = np.linalg.lstsq(basis, both, rcond=None)[0]
    residual = y - basis @ coefficients[:, 1]
    smooth = np.mean(residual**2) - np.mean(np.diff(residual) ** 2) / 2  # its expectation for white noise is 0
    return _SineFit(coefficients[2] + 1j * coefficients[3], float(np.sqrt(max(smooth, 0.0))))


def _residual_remarks(outcome: Outcome, found: list[_Blocks]) -> tuple[Finding, ...]:
    """Return a finding if a constant velocity and the sine do not describe the blocks."""
    worst = max(blocks.residual for blocks in found)
    if outcome is not Outcome.OK or worst < 1:
        return ()
    residual = Quantity(worst, "1", "residual between reversals over the sine's amplitude")
    return (Finding("misfit", (residual,), remedy="check that the base motion has a constant velocity there"),)
