"""The exact stop operator, and the turning points of a motion."""

import numpy as np
from numpy.typing import NDArray


def stop_operators(displacement: NDArray[np.float64], thresholds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deflections z_i [m] of elements with thresholds Y_i [m], shape (n, N), along a displacement from rest.

    Between reversals z = clip(z_r + y - y_r, -Y, Y): exact, all samples and thresholds at once.
    """
    deflection = np.empty((displacement.size, thresholds.size))
    state = np.zeros(thresholds.size)
    deflection[0] = state
    ends = reversals(displacement)
    for begin, end in zip([0, *ends[:-1]], ends, strict=True):
        monotone = deflection[begin + 1 : end + 1]
        np.subtract(displacement[begin + 1 : end + 1, None], displacement[begin] - state, out=monotone)
        np.clip(monotone, -thresholds, thresholds, out=monotone)
        state = monotone[-1]
    return deflection


def reversals(displacement: NDArray[np.float64]) -> list[int]:
    """Return the samples at which monotone parts of the motion end, the last sample included."""
    change = np.diff(displacement)
    moving = np.flatnonzero(change)
    turns = np.flatnonzero(np.diff(np.sign(change[moving])))
    ends = moving[turns + 1].tolist()
    return [*ends, displacement.size - 1] if displacement.size > 1 else []


def turning_points(displacement: NDArray[np.float64], swing: float) -> NDArray[np.int64]:
    """Return the samples at which the motion turns by more than `swing` [m], ascending, shape (turns,)."""
    ends = np.array([0, *reversals(displacement)])
    found: list[int] = []
    highest = lowest = 0
    direction = 0
    for sample in ends.tolist():
        y = displacement[sample]
        highest = sample if y > displacement[highest] else highest
        lowest = sample if y < displacement[lowest] else lowest
        if direction >= 0 and displacement[highest] - y > swing:
            found += [highest]
            direction, lowest = -1, sample
        elif direction <= 0 and y - displacement[lowest] > swing:
            found += [lowest]
            direction, highest = 1, sample
    return np.array([turn for turn in found if turn > 0], dtype=int)
