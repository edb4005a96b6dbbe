"""Outputs of a record that move against each other where a machine moves as one body: one of them may be mounted so."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

LOWEST_LINES = 3
"""Excited lines that are looked at, the lowest ones: below the first resonance both ends of a drive move together."""
EXCITED_SHARE = 0.05
"""Share of the strongest line from which a line counts as excited."""
MAX_ANGLE_RAD = np.deg2rad(15.0)
"""Greatest deviation from opposite motion."""
MAX_RATIO = 2.0
"""Greatest ratio of the amplitudes, either way: more is no motion as one body."""


def opposite_pairs(columns: Mapping[str, NDArray[np.float64]], source: str, period: int) -> Iterator[tuple[str, str]]:
    """Yield the first output and each other one, by name, that moves against it at the lowest excited lines.

    Args:
        columns: samples of the input `source` and of the outputs, each of shape (n,).
        source: name of the input.
        period: samples of a period.

    """
    whole = {name: values[: values.size // period * period] for name, values in columns.items()}
    spectra = {name: np.fft.rfft(of.reshape(-1, period).mean(0))[1:] for name, of in whole.items() if of.size}
    if source not in spectra or len(spectra) < 2:
        return
    strength = np.abs(spectra.pop(source))
    lines = np.flatnonzero(strength > EXCITED_SHARE * strength.max())[:LOWEST_LINES]
    first, *others = spectra
    for other in others:
        if spectra[other].size == spectra[first].size and _is_opposite(spectra[other][lines], spectra[first][lines]):
            yield first, other


def _is_opposite(one: NDArray[np.complex128], other: NDArray[np.complex128]) -> bool:
    if not (np.all(one) and np.all(other)):
        return False
    ratio = -one / other
    size = np.abs(np.log(np.abs(ratio)))
    return bool(np.all(np.abs(np.angle(ratio)) < MAX_ANGLE_RAD) and np.all(size < np.log(MAX_RATIO)))
