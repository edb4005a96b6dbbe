"""Integrals and derivatives of a channel over time."""

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import RecordError
from fraexp.records.cutting import Cut

MIN_FREQUENCY_RATIO = 0.5
"""Frequency relative to the lowest line below which an integral is set to 0: there it is drift and noise."""


def integrate_blocks(blocks: NDArray[np.float64], cut: Cut, times: int, place: str) -> NDArray[np.float64]:
    """Return blocks of a channel, shape (blocks, samples), integrated `times` times; if below 0, differentiated.

    A periodic record is divided by (jω)ⁿ at all its frequencies at once, which is exact at its lines; its mean and
    what lies below half the lowest line cannot be integrated and become 0. A record that does not repeat itself is
    differentiated by central differences, too small by (ωTs)²/6, and cannot be integrated: it would drift.
    """
    if not times:
        return blocks
    if not cut.periodic and times > 0:
        raise RecordError(
            f"{place}: a record that does not repeat itself cannot be integrated, its offset would grow without end; "
            "give a measured position, or cut whole periods"
        )
    record = blocks.ravel()
    if not cut.periodic:
        for _ in range(-times):
            record = np.gradient(record, cut.sample_time)
        return record.reshape(blocks.shape)
    omega = 2 * np.pi * np.fft.rfftfreq(record.size, cut.sample_time)
    lowest = 2 * np.pi * cut.lines[0] / (cut.samples * cut.sample_time)
    kept = omega > (MIN_FREQUENCY_RATIO * lowest if times > 0 else 0.0)
    kept[-1] &= record.size % 2 == 1  # at the Nyquist frequency a derivative has no phase
    factor = np.zeros(omega.size, dtype=complex)
    factor[kept] = (1j * omega[kept]) ** -times
    return np.fft.irfft(factor * np.fft.rfft(record), record.size).reshape(blocks.shape)
