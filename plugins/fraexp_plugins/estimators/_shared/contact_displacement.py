"""The displacement of a contact where measured positions add up to it, and the channel that it has then."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Signals

MIN_WEIGHT = 1e-9
"""Weight of a position in a displacement that counts as none."""


def contact_channel(contact: str) -> str:
    """Return the channel of a contact's displacement."""
    return f"displacement by {contact}"


def position_weights(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the weights by which rows add up to another one; None if they do not."""
    solved = np.linalg.lstsq(rows.T, row, rcond=None)[0]
    weights = np.where(np.abs(solved) > MIN_WEIGHT, solved, 0.0).astype(float)
    return weights if np.allclose(weights @ rows, row, rtol=0.0, atol=MIN_WEIGHT * np.abs(row).max()) else None


def with_displacement(signals: Signals, contact: str, weights: Mapping[str, float]) -> Signals:
    """Return the signals with the displacement of a contact, which is a combination of measured positions."""
    used = {channel: weight for channel, weight in weights.items() if weight}

    def combine(parts: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        if not used.keys() <= parts.keys():
            return {}
        return {contact_channel(contact): sum((w * parts[name] for name, w in used.items()), start=np.zeros(1))}

    segments = [
        replace(
            segment,
            channels={**segment.channels, **combine(segment.channels)},
            lead_in={**segment.lead_in, **combine(segment.lead_in)},
        )
        for segment in signals.segments
    ]
    return replace(signals, segments=tuple(segments))
