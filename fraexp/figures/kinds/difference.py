"""Difference of two frequency responses, in dB and degrees."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.data.results import FrequencyResponse
from fraexp.figures.elements.scales import decibel, degrees


@dataclass(frozen=True)
class Difference:
    """Maximum and root-mean-square difference of two responses over their common frequencies."""

    points: int
    """Number of frequencies compared, all settled."""
    low: float
    """Lowest frequency compared [Hz]."""
    high: float
    """Highest frequency compared [Hz]."""
    interpolated: bool
    """Whether the other response was interpolated because the grids differ."""
    magnitude_max: float
    """Largest difference of the magnitudes, with its sign [dB]."""
    magnitude_max_at: float
    """Its frequency [Hz]."""
    magnitude_rms: float
    """Root mean square of the difference of the magnitudes [dB]."""
    phase_max: float
    """Largest difference of the phases, with its sign [deg]."""
    phase_max_at: float
    """Its frequency [Hz]."""
    phase_rms: float
    """Root mean square of the difference of the phases [deg]."""


def response_difference(reference: FrequencyResponse, other: FrequencyResponse) -> Difference | None:
    """Return the difference of `other` from `reference`; None without a common frequency or unit.

    Where the grids differ, `other` is interpolated: ln|G| and the unwrapped phase, linear in log frequency.
    """
    frequency, expected = _settled_points(reference)
    theirs, found = _settled_points(other)
    if reference.unit != other.unit or not len(frequency) or not len(theirs):
        return None
    slack = 1e-9
    inside = (frequency >= theirs[0] * (1 - slack)) & (frequency <= theirs[-1] * (1 + slack))
    frequency, expected = frequency[inside], expected[inside]
    if not len(frequency):
        return None
    nearest = theirs[np.argmin(np.abs(theirs[None, :] - frequency[:, None]), axis=1)]
    ratio = on_frequencies(frequency, theirs, found) / expected
    interpolated = bool(np.any(np.abs(nearest - frequency) > slack * frequency))
    return _summary(frequency, decibel(ratio), degrees(ratio), interpolated)


def _settled_points(response: FrequencyResponse) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    usable = response.settled & np.isfinite(response.response) & (response.response != 0)
    order = np.argsort(response.frequency[usable], kind="stable")
    return response.frequency[usable][order], response.response[usable][order]


def on_frequencies(
    frequency: NDArray[np.float64], grid: NDArray[np.float64], response: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return a response given on an ascending `grid` at other frequencies: ln|G| and phase, linear in log frequency."""
    logarithm = np.log(np.abs(response)) + 1j * np.unwrap(np.angle(response))
    value: NDArray[np.complex128] = np.exp(np.interp(np.log(frequency), np.log(grid), logarithm))
    return value


def _summary(
    frequency: NDArray[np.float64], magnitude: NDArray[np.float64], phase: NDArray[np.float64], interpolated: bool
) -> Difference:
    loudest, furthest = int(np.argmax(np.abs(magnitude))), int(np.argmax(np.abs(phase)))
    return Difference(
        points=len(frequency),
        low=float(frequency[0]),
        high=float(frequency[-1]),
        interpolated=interpolated,
        magnitude_max=float(magnitude[loudest]),
        magnitude_max_at=float(frequency[loudest]),
        magnitude_rms=float(np.sqrt(np.mean(magnitude**2))),
        phase_max=float(phase[furthest]),
        phase_max_at=float(frequency[furthest]),
        phase_rms=float(np.sqrt(np.mean(phase**2))),
    )
