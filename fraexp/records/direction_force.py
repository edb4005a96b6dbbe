"""A force in a control input that follows the direction of motion, as a machine's own friction compensation does."""

import numpy as np
from numpy.typing import NDArray

CLEAR_SPEED = 0.5
"""Speed relative to the greatest one from which the direction is clear, also if the force is a few samples late."""
SPEED_SPAN = 1 / 16
"""Part of the shortest period over which a speed is taken: encoders are coarse."""
MAX_LEFT, MIN_LEFT = 0.1, 0.05
"""What such a force leaves of a residual at most, and what a force in proportion to the speed leaves at least."""
MIN_GAIN = 3.0
"""Factor by which the former leaves less than the latter: another controller's answer is in proportion to motion."""


def direction_force(residual: NDArray[np.float64], position: NDArray[np.float64], shortest: float) -> float:
    """Return the force [N] with which a residual [N] follows the direction of motion; 0 if it does not.

    Both are sample by sample, shape (n,), and `shortest` is the shortest period in them [samples].
    """
    span = max(round(SPEED_SPAN * shortest), 1)
    speed = position[span:] - position[:-span]
    if not speed.any():
        return 0.0
    sums = np.cumsum(residual)
    force = (sums[span:] - sums[:-span]) / span
    clear = np.abs(speed) > CLEAR_SPEED * np.abs(speed).max()
    speed, force = speed[clear], force[clear]
    terms = np.array([np.sign(speed), speed, np.ones(speed.size)])
    size = float(np.sqrt(np.mean(force**2)))
    found, left = _fit(terms, force)
    _, left_by_speed = _fit(terms[1:], force)
    follows = left < MAX_LEFT * size and MIN_LEFT * size < left_by_speed and MIN_GAIN * left < left_by_speed
    return max(float(found[0]), 0.0) if follows else 0.0


def _fit(terms: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the factors of terms, shape (m, n), that make a force, shape (n,), and the rms that they leave of it."""
    scale = np.maximum(np.abs(terms).max(axis=1), np.finfo(float).tiny)
    factors = np.linalg.lstsq((terms / scale[:, None]).T, force, rcond=None)[0] / scale
    return factors, float(np.sqrt(np.mean((force - factors @ terms) ** 2)))
