"""An amplitude that depends on the frequency."""

import itertools

import numpy as np

from fraexp.api import ParameterError

Shape = tuple[tuple[float, float], ...]
"""Pairs of frequency [Hz] and relative amplitude, ascending; none for a constant amplitude."""
MEANING = "pairs of frequency and relative amplitude, joined by straight lines on logarithmic axes; none for 1"


def check_shape(name: str, shape: Shape) -> None:
    """Raise ParameterError unless frequencies ascend and all numbers are above 0."""
    if min((number for pair in shape for number in pair), default=1.0) <= 0:
        raise ParameterError(f"{name}.shape has a number of 0 or less; expected frequencies and amplitudes above 0")
    frequencies = [frequency for frequency, _ in shape]
    if any(second <= first for first, second in itertools.pairwise(frequencies)):
        raise ParameterError(f"{name}.shape has the frequencies {frequencies} Hz; expected them to ascend")


def shaped(shape: Shape, frequency: np.ndarray) -> np.ndarray:
    """Return the relative amplitude at `frequency` [Hz], shape (n,); beyond the outermost pairs it is theirs."""
    if not shape:
        return np.ones(frequency.shape)
    known, relative = np.log(np.array(shape)).T
    return np.exp(np.interp(np.log(frequency), known, relative))
