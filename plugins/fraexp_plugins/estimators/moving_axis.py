"""The moving-axis FRA method: the machine is excited while it moves on, so that friction does not turn round."""

import itertools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fraexp.api import Metric, Outcome, RecordError, Result, Segment, Signals, param, response_result
from fraexp_plugins.estimators.delayed import DelayedEstimator

STEADY = 1e-6
"""Change of the reference's velocity from one sample to the next, relative to it, up to which it is constant."""
SHORT = 0.8
"""Length of a stretch, relative to the longest one, from which on it is used: others are cut by the record's ends."""


class MovingAxis(DelayedEstimator, name="moving_axis", version=1):
    """P̂ = y'/u from the stretches in which a base motion of constant velocity lets no reversal happen.

    Without a reversal rolling and Coulomb friction are a constant force: what remains of friction is its viscous
    part. Drives are commissioned so (Siemens SINAMICS: an offset such that the speed has no zero crossings; Aerotech
    Automation1: Enable Motion). Reversals are seen in the record itself; `run_in` is left out after each, and before it
    the time from where the reference brakes, or `run_in` again without a reference. In each stretch an offset, a slope,
    a cosine and a sine are fitted to input and output, over whole periods of the sine and by least squares: exact for a
    constant velocity. The phasors of all stretches of both directions are averaged; their scatter gives the covariance,
    with 2(S - 1) degrees of freedom for S stretches (R. Pintelon and J. Schoukens, System Identification: A Frequency
    Domain Approach, 2nd ed. 2012, section 2.4).

    Not to be used where the stroke does not allow it, nor on a base motion whose velocity changes within the stretches,
    such as a slow sine: an offset and a slope do not describe it. That one repeats itself and is orthogonal to the sine
    over whole periods, where `conventional` is exact.
    """

    remove_delay: bool = param("", "whether to divide by G_di G_do and the hold, to compare with P(jω)", False)
    run_in: float = param(
        "s", "time that is left out after each reversal, until its disturbance has decayed", 0.5,
        at_least=0, inherit="excitation.run_in",
    )  # fmt: skip
    reference_channel: str = param("", "channel of the position reference, if there is one", "reference")

    expected_failures: ClassVar[dict[str, str]] = dict.fromkeys(
        ("linear-plant", "result-units", "covariance", "outcome"),
        "It refuses an axis that does not move on, with which it is tried here.",
    )

    def estimate(self, signals: Signals) -> Result:
        """Return y'/u, or y'/(G_di G_do u), the least velocity met, and how well the stretches are described."""
        units = (signals.unit(self.input), signals.unit(self.output))
        found = [self._stretches(segment) for segment in signals.segments]
        inputs = [
            stretches.input * self._path(segment) for segment, stretches in zip(signals.segments, found, strict=True)
        ]
        outputs = [stretches.output for stretches in found]
        result = response_result(signals, inputs, outputs, names=(self.input, self.output), units=units)
        if not found:
            return result
        metrics = (
            Metric("minimum velocity", min(stretches.velocity for stretches in found), f"{units[1]}/s"),
            Metric("stretches per frequency", min(len(stretches.output) for stretches in found), "1"),
            Metric("residual over amplitude", max(stretches.residual for stretches in found), "1"),
        )
        return Result(result.outcome, result.message or _remark(result.outcome, found), result.response, metrics)

    def _path(self, segment: Segment) -> np.ndarray:
        if not self.remove_delay:
            return np.ones(1)
        omega = 2 * np.pi * segment.frequency
        return self.input_path(omega, segment.sample_time) * self.output_path(omega)

    def _stretches(self, segment: Segment) -> "_Stretches":
        if segment.lines.size != 1:
            raise RecordError(
                f"moving_axis needs one sine at a time, but {segment.lines.size} lines are excited at once: take an "
                "excitation such as moving_sine"
            )
        frequency, sample_time = float(segment.frequency[0]), segment.sample_time
        y = segment.channels[self.output].ravel()
        bounds = _whole_periods(self._bounds(segment, y), 1 / (frequency * sample_time))
        if not bounds:
            raise RecordError(
                f"{self.output} does not move on at a constant velocity for a period of {frequency:.4g} Hz, "
                f"{self.run_in:g} s after a reversal: raise the base motion's velocity or period, or lower the sine's"
            )
        u = segment.channels[self.input].ravel()
        fits = [
            _fitted(u[begin:end], y[begin:end], begin, 2 * np.pi * frequency * sample_time) for begin, end in bounds
        ]
        velocity = min(float(np.min(np.abs(_slope(y)[begin:end]))) for begin, end in bounds) / sample_time
        phasors = np.array([fit[0] for fit in fits])
        size = abs(complex(phasors[:, 1].mean()))
        residual = max(fit[1] for fit in fits) / size if size else np.inf
        return _Stretches(phasors[:, :1], phasors[:, 1:], velocity, float(residual))

    def _bounds(self, segment: Segment, y: np.ndarray) -> list[tuple[int, int]]:
        direction = np.sign(_slope(y))
        after = int(np.ceil(self.run_in / segment.sample_time))
        if self.reference_channel not in segment.channels:
            return _without_reversal(direction, after, after)
        steps = np.diff(segment.channels[self.reference_channel].ravel())
        turning = np.abs(np.diff(steps, prepend=steps[:1])) > STEADY * np.max(np.abs(steps))
        direction[:-1][turning] = 0
        return _without_reversal(direction, 0, after)


@dataclass(frozen=True)
class _Stretches:
    """What the stretches of one segment tell."""

    input: np.ndarray
    """Phasor of the input of each stretch, shape (stretches, 1)."""
    output: np.ndarray
    """Phasor of the output of each stretch, shape (stretches, 1)."""
    velocity: float
    """Least magnitude of the velocity in them."""
    residual: float
    """Greatest root mean square of what the fit leaves of the output, noise apart, relative to the sine's amplitude."""


def _slope(y: np.ndarray) -> np.ndarray:
    """Return the central difference per sample; its ends are those of their neighbours."""
    inner = (y[2:] - y[:-2]) / 2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _without_reversal(direction: np.ndarray, before: int, after: int) -> list[tuple[int, int]]:
    """Return beginning and end of each stretch in one direction, less what is left out before and after a reversal."""
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    runs = itertools.pairwise([0, *turns.tolist(), direction.size])
    moving = [(begin + after, end - before) for begin, end in runs if direction[begin] != 0]
    return [(begin, end) for begin, end in moving if end > begin]


def _whole_periods(stretches: list[tuple[int, int]], period: float) -> list[tuple[int, int]]:
    """Return the beginnings of the stretches that last whole periods [samples], and not much less than the longest."""
    found = []
    for begin, end in stretches:
        whole = np.floor((end - begin) / period)
        if whole >= 1:
            found.append((begin, begin + round(whole * period)))
    longest = max((end - begin for begin, end in found), default=0)
    return [(begin, end) for begin, end in found if end - begin >= SHORT * longest]


def _fitted(u: np.ndarray, y: np.ndarray, begin: int, turn: float) -> tuple[np.ndarray, float]:
    """Return the phasors of u and y, shape (2,), and the root mean square of what is left of y but for white noise.

    `begin` is the number of the first sample, and `turn` the sine's phase per sample [rad].
    """
    samples = np.arange(u.size)
    phase = turn * (begin + samples)
    basis = np.stack([np.ones(u.size), 2 * samples / u.size - 1, np.cos(phase), -np.sin(phase)], axis=1)
    both = np.stack([u, y], axis=1)
    coefficients = np.linalg.lstsq(basis, both, rcond=None)[0]
    left = y - basis @ coefficients[:, 1]
    smooth = np.mean(left**2) - np.mean(np.diff(left) ** 2) / 2  # of white noise the expectation is 0
    return coefficients[2] + 1j * coefficients[3], float(np.sqrt(max(smooth, 0.0)))


def _remark(outcome: Outcome, found: list[_Stretches]) -> str:
    """Return a sentence if the stretches have more in them than a constant velocity and the sine."""
    worst = max(stretches.residual for stretches in found)
    if outcome is not Outcome.OK or worst < 1:
        return ""
    return f"the stretches leave a residual of {worst:.2g} amplitudes: is the base motion of constant velocity there?"
