"""Continuous phases of many responses together, on the branches of `scales.continuous_phase`."""

import numpy as np
from numpy.typing import NDArray

from fraexp.figures.elements.scales import ANCHOR_WEIGHT, continuous_phase


def continuous_phases(
    phase: NDArray[np.float64], trusted: NDArray[np.bool_], anchor: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return what `continuous_phase` returns for each row of arrays of shape (m, n); 100 times as fast with an anchor.

    The rows of `anchor` may end in NaN where those of `phase` do.
    """
    if anchor is None:
        return np.stack([continuous_phase(*row) for row in zip(phase, trusted, strict=True)])
    trusted = trusted & np.isfinite(phase)
    candidates = np.stack([_chain_all(phase, trusted, anchor, turn) for turn in (-360, 0, 360)])
    distances = np.where(trusted, np.abs(candidates - anchor), 0).sum(axis=2)
    nearest: NDArray[np.float64] = candidates[np.argmin(distances, axis=0), np.arange(len(phase))]
    return nearest


def _chain_all(
    phase: NDArray[np.float64], trusted: NDArray[np.bool_], anchor: NDArray[np.float64], turn: float
) -> NDArray[np.float64]:
    chained = np.full(phase.shape, np.nan)
    previous = anchor[:, 0] + turn
    for column in range(phase.shape[1]):
        here = phase[:, column]
        turns = here + 360 * (np.round((previous - here) / 360) + np.arange(-1, 2)[:, None])
        cost = np.abs(turns - previous) + ANCHOR_WEIGHT * np.abs(turns - anchor[:, column])
        chained[:, column] = turns[np.argmin(cost, axis=0), np.arange(len(here))]
        previous = np.where(trusted[:, column], chained[:, column], previous)
    return chained
