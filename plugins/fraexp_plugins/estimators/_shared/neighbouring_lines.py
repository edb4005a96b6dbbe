"""Noise of a response, from the lines of the record's spectrum beside the excited one, which nothing else excites.

The scatter over periods takes all noise within a fundamental's distance for the noise at the line, and takes it for
circular. Friction modulates noise with the motion: its power then gathers at the excited line, so that neighbouring
periods are correlated and their mean scatters more than they show, and its error lies along one direction. The nearest
lines show how much noise there is; its direction follows from all pairs of lines on either side, which are correlated.
Sines one at a time only: on a measured multisine the scatter is what other programs state, and lines have neighbours.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import FrequencyResponse, Segment, record_spectrum

PERIODS_PER_LINE = 4
"""Periods for each line on either side that shows the size of the noise, and the least number of them; twice as many
lines show its direction. Half of it takes lines farther away, where friction modulates the noise less."""
MIN_LINES = 2
"""Lines on either side, at least. Half of them make the band a quarter wider."""


def with_noise_of_neighbours(
    response: FrequencyResponse, segments: Sequence[Segment], channels: tuple[str, str]
) -> FrequencyResponse:
    """Return a response with a covariance by the lines beside those excited, where a record has several periods.

    `channels` are input and output. The noise of the ratio G is that of y' - G u. Each line has two degrees of freedom.
    One is lost for the direction, and the band is wider: H. Hotelling, Ann. Math. Stat. 2, 360, 1931. The direction
    counts as far as it is clearer than chance makes it.
    """
    count = response.frequency.size
    freedom = np.full(count, np.inf) if response.freedom is None else np.array(response.freedom, dtype=float)
    covariance, begin = response.covariance.copy(), 0
    for segment in segments:
        lines = slice(begin, begin + segment.lines.size)
        begin = lines.stop
        periods = len(segment.channels[channels[1]])
        if periods < PERIODS_PER_LINE or segment.lines.size > 1 or segment.stated is not None:
            continue  # between the lines of a multisine there is what each of them leaves
        reach = max(MIN_LINES, periods // PERIODS_PER_LINE)
        relative = _relative_covariance(segment, channels, periods, reach)
        turned = _as_matrices(response.response[lines])
        degrees = 4 * reach
        covariance[lines] = np.einsum("nij,njk,nlk->nil", turned, relative, turned) * (degrees / (degrees - 1))
        freedom[lines] = degrees - 1
    return replace(response, covariance=covariance, freedom=freedom)


def _relative_covariance(segment: Segment, channels: tuple[str, str], periods: int, reach: int) -> NDArray[np.float64]:
    """Return the covariance of the response's error, relative to the response, at each line, shape (lines, 2, 2)."""
    given, moved = (record_spectrum(segment, channel) for channel in channels)
    widest = min(2 * reach, periods - 1)
    at, distance = segment.lines * periods, np.arange(1, widest + 1)
    above, below = (np.clip(at[:, None] + sign * distance, 1, moved.size - 1) for sign in (1, -1))
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        ratio = (moved[at] / given[at])[:, None]
        upper, lower = ((moved[beside] - ratio * given[beside]) / moved[at][:, None] for beside in (above, below))
        size = _mean_power(upper[:, :reach], lower[:, :reach])
    # The mean square of the error as a complex number, relative to its power: 0 if the noise is circular.
    upper, lower = upper[:, :widest], lower[:, :widest]
    power, square = _mean_power(upper, lower), np.add.reduce(upper * lower, axis=1) / widest
    direction = np.divide(square, power, out=np.zeros_like(square), where=power > 0)
    by_chance = np.divide(1 / widest, np.abs(direction) ** 2, out=np.ones_like(power), where=direction != 0)
    direction *= np.maximum(0.0, 1 - by_chance)
    parts = [1 + direction.real, direction.imag, direction.imag, 1 - direction.real]
    return np.asarray(size[:, None, None] / 2 * np.stack(parts, axis=1).reshape(-1, 2, 2))


def _mean_power(upper: NDArray[np.complex128], lower: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the mean squared magnitude of lines on both sides, which lie along the second axis."""
    power = upper.real**2 + upper.imag**2 + lower.real**2 + lower.imag**2
    return np.asarray(np.add.reduce(power, axis=1) / (2 * upper.shape[1]))


def _as_matrices(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the matrices that multiply (real, imaginary) part by complex values, shape (n, 2, 2)."""
    return np.stack([values.real, -values.imag, values.imag, values.real], axis=1).reshape(-1, 2, 2)
