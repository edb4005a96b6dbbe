"""Motions of few encoder steps: the step that a record shows, and how far rounding alone may move a response."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Encoder, Finding, Quantity, Segment, at_worst, grid_step

NEGLIGIBLE_SHARE = 1e-5
"""Step over the range of a channel below which its rounding is negligible: that of the numbers in a file."""
DITHER = 0.3
"""Standard deviation of the noise, in steps, from which it blurs the rounding of a motion that repeats."""
MAX_ERROR = 0.05
"""Relative error by rounding from which a response is not ok."""
MIN_STEPS = 1.5
"""Half the range, in steps, from which the lines of a motion blur each other's rounding."""
OFFSETS, WAVE_SAMPLES = 32, 512
"""Places of a motion within a step, and samples of its period, at which its rounding is looked at."""


def recorded_step(segments: Sequence[Segment], channel: str) -> float:
    """Return the step to which a measured channel is rounded [its unit]; 0 if none is seen, or it is negligible.

    Segments that state whether they had settled are played or simulated, by whoever knows the encoder.
    """
    if any(segment.settling is not None or segment.stated is not None for segment in segments):
        return 0.0
    samples = np.concatenate([segment.channels[channel].ravel() for segment in segments])
    step = grid_step(samples)
    return step if step >= NEGLIGIBLE_SHARE * float(np.ptp(samples)) else 0.0


def coarse_motion(
    segments: Sequence[Segment], output: str, resolution: float, encoder: Encoder | None
) -> Finding | None:
    """Return where the output moves by so few steps that rounding may spoil the response, and how far.

    `resolution` is the step [unit of the output].
    Noise that differs from period to period blurs the rounding; without it each period is rounded alike.
    """
    if not resolution:
        return None
    errors = [_rounding_error(segment, output, resolution, encoder) for segment in segments]
    error = np.repeat(errors, [segment.lines.size for segment in segments])
    coarse = error > MAX_ERROR
    if not coarse.any():
        return None
    frequency = np.concatenate([segment.frequency for segment in segments])
    step = Quantity(resolution, "m", "encoder step")
    return at_worst("few encoder steps", frequency, coarse, error, "response off by up to", quantities=(step,))


def _rounding_error(segment: Segment, output: str, resolution: float, encoder: Encoder | None) -> float:
    """Return the greatest relative error of a sine's phasor by rounding; 0 where noise blurs it, or other lines do.

    Where several lines move an encoder by hardly a step, all of them together may be seen as anything.
    """
    if segment.stated is not None:
        return 0.0
    periods = segment.channels[output]
    noise = encoder.noise if encoder is not None else 0.0
    if len(periods) > 1:
        noise = max(noise, float(np.sqrt(np.mean(np.var(periods, axis=0, ddof=1)))))
    if noise > DITHER * resolution:
        return 0.0
    steps = float(np.ptp(periods.mean(axis=0))) / 2 / resolution
    if segment.lines.size > 1:
        return np.inf if 0 < steps < MIN_STEPS else 0.0
    return _worst_error(round(steps, 2))


@cache
def _worst_error(amplitude: float) -> float:
    """Return the greatest relative error of the fundamental of a rounded sine, over the places within a step.

    The amplitude is in steps, of the rounded sine, which is up to half a step off.
    """
    wave = np.sin(2 * np.pi * (np.arange(WAVE_SAMPLES) + 0.5) / WAVE_SAMPLES)
    places: NDArray[np.float64] = np.arange(OFFSETS)[:, None] / OFFSETS
    fundamental = 2 * np.rint(amplitude * wave + places) @ wave / WAVE_SAMPLES
    return float(np.abs(fundamental / amplitude - 1).max()) if amplitude > 0 else 0.0
