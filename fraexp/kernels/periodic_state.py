"""Slow convergence to the periodic motion, extrapolated: a window starts where the ones before it lead to.

A lightly damped machine needs hundreds of periods until its motion repeats. The linear states at the windows' ends then
form a sequence of which few modes are left, so that a combination of few windows is close to its limit (Anderson
acceleration: D. G. Anderson, J. ACM 12, 547, 1965, doi:10.1145/321296.321305). Friction keeps its own state and follows
the jump as a motion. What counts as settled is decided by windows that run on without a jump.
"""

import numpy as np
from numpy.typing import NDArray

from fraexp.kernels.decorators import COMPILER_OPTIONS, compiled

DEPTH = 5
"""Maximum number of windows that are combined."""
KEPT_WINDOWS = 2 * DEPTH
"""Windows of measured positions that are kept: every other one may follow a jump."""
RIDGE = 1e-13
"""Share of the squares that is added to them, so that windows which hardly differ get small weights."""
MAX_SHARE = 1e4
"""Greatest magnitude of a window's weight: beyond it the windows say nothing of their limit."""


@compiled(**COMPILER_OPTIONS)
def keep_state(numbers: NDArray[np.float64], rows: NDArray[np.int64], states: NDArray[np.float64], pair: int) -> None:
    """Keep a lane's linear state as one of a pair."""
    for i in range(rows.size):
        states[pair % DEPTH, i] = numbers[rows[i]]


@compiled(**COMPILER_OPTIONS)
def combine_windows(
    starts: NDArray[np.float64], ends: NDArray[np.float64], newest: int, count: int, weights: NDArray[np.float64]
) -> bool:
    """Find the weights with which `count` windows leave the state as it was; return whether there are such.

    The weights, of the newest window and those before it, add up to 1; what each window changes is made least in the
    sum of squares, each row in units of its greatest change.
    """
    unknowns = count - 1
    normal = np.zeros((unknowns, unknowns + 1))
    change = np.empty(count)
    for row in range(starts.shape[1]):
        greatest = 0.0
        for j in range(count):
            at = (newest - j) % DEPTH
            change[j] = ends[at, row] - starts[at, row]
            greatest = max(greatest, abs(change[j]))
        if greatest == 0.0:
            continue
        for i in range(unknowns):
            difference = (change[i + 1] - change[0]) / greatest
            for j in range(unknowns):
                normal[i, j] += difference * (change[j + 1] - change[0]) / greatest
            normal[i, unknowns] -= difference * change[0] / greatest
    for i in range(unknowns):
        normal[i, i] *= 1.0 + RIDGE
        if normal[i, i] == 0.0:
            return False
    return _solve(normal, weights)


@compiled(**COMPILER_OPTIONS)
def _solve(normal: NDArray[np.float64], weights: NDArray[np.float64]) -> bool:
    """Solve positive definite equations, whose right side is the last column, by elimination."""
    unknowns = normal.shape[0]
    for i in range(unknowns):
        if not normal[i, i] > 0.0:
            return False
        for j in range(i + 1, unknowns):
            factor = normal[j, i] / normal[i, i]
            for column in range(i, unknowns + 1):
                normal[j, column] -= factor * normal[i, column]
    weights[0] = 1.0
    for i in range(unknowns - 1, -1, -1):
        value = normal[i, unknowns]
        for j in range(i + 1, unknowns):
            value -= normal[i, j] * weights[j + 1]
        weights[i + 1] = value / normal[i, i]
        weights[0] -= weights[i + 1]
        if not abs(weights[i + 1]) < MAX_SHARE:
            return False
    return True


@compiled(**COMPILER_OPTIONS)
def predicted_change(
    history: NDArray[np.float64], filled: int, window: int, passed: int, numbers: NDArray[np.int64],
    newest: int, count: int, weights: NDArray[np.float64],
) -> float:  # fmt: skip
    """Return how far the combination of the last windows is from the newest [m], as the root mean square."""
    total, begin = 0.0, filled - window
    for i in range(window):
        change = 0.0
        for j in range(1, count):
            age = passed - numbers[(newest - j) % DEPTH]
            change += weights[j] * (history[begin - age * window + i] - history[begin + i])
        total += change * change
    return np.sqrt(total / window)


@compiled(**COMPILER_OPTIONS)
def jump(
    numbers: NDArray[np.float64], rows: NDArray[np.int64], ends: NDArray[np.float64], newest: int, count: int,
    weights: NDArray[np.float64],
) -> None:  # fmt: skip
    """Put a lane into the combination of the windows' ends, where the next window starts."""
    for i in range(rows.size):
        latest = ends[newest % DEPTH, i]
        value = latest
        for j in range(1, count):
            value += weights[j] * (ends[(newest - j) % DEPTH, i] - latest)
        numbers[rows[i]] = value
