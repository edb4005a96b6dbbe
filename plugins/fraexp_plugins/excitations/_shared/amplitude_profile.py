"""An amplitude that depends on the frequency."""

import itertools

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ParameterError

AmplitudeProfile = tuple[tuple[float, float], ...]
"""Pairs of frequency [Hz] and relative amplitude, ascending; empty for a constant amplitude."""
PROFILE_MEANING = (
    "pairs of frequency and relative amplitude, joined by straight lines on logarithmic axes; "
    "empty for a constant amplitude"
)


def check_profile(name: str, profile: AmplitudeProfile) -> None:
    """Raise ParameterError unless frequencies ascend and all numbers are above 0."""
    if min((number for pair in profile for number in pair), default=1.0) <= 0:
        raise ParameterError(
            f"{name}.amplitude_profile has a number of 0 or less; expected frequencies and amplitudes above 0"
        )
    frequencies = [frequency for frequency, _ in profile]
    if any(second <= first for first, second in itertools.pairwise(frequencies)):
        raise ParameterError(f"{name}.amplitude_profile has the frequencies {frequencies} Hz; expected them to ascend")


def relative_amplitude(profile: AmplitudeProfile, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the relative amplitude at `frequency` [Hz], shape (n,); constant beyond the outermost pairs."""
    if not profile:
        return np.ones(frequency.shape)
    known, relative = np.log(np.array(profile)).T
    return np.exp(np.interp(np.log(frequency), known, relative))
