"""Local models of spectra: least squares over the bins around each excited line, for all lines at once.

A record of a linear system that is not in its periodic state obeys Y(k) = G(k) U(k) + T(k) + V(k) exactly, with a
transient T as smooth as G (R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed.
2012, section 6.3.2, doi:10.1002/9781118287422). Around a line both are polynomials in the distance r, or ratios of
such with a common denominator D(r) = 1 + d_1 r + d_2 r² + ...
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from fraexp.api import ROUNDING, SIGNIFICANCE, RecordError, Segment, record_spectrum


@dataclass(frozen=True)
class LineWindows:
    """The bins around each line that a local model describes."""

    bins: NDArray[np.int64]
    """Bins of the record's spectrum, ascending, shape (lines, window) of int."""
    lines: NDArray[np.int64]
    """Bin of each line, shape (lines,) of int."""
    distance: NDArray[np.float64]
    """Distance r from the line, scaled to a maximum of 1, shape (lines, window)."""

    @property
    def center(self) -> NDArray[np.bool_]:
        """Whether a bin is the line itself, shape (lines, window)."""
        return self.bins == self.lines[:, None]


@dataclass(frozen=True)
class LocalEstimate:
    """Output and input of one record at each line, estimated from the bins around it."""

    output: NDArray[np.complex128]
    """The part Y of the output that follows the drive, complex, shape (lines,)."""
    input: NDArray[np.complex128]
    """The same part U of the input, complex, shape (lines,)."""
    square: NDArray[np.float64]
    """Sum of squared residuals of output less Y/U times input, shape (lines,)."""
    freedom: NDArray[np.float64]
    """Complex degrees of freedom of that sum, shape (lines,)."""
    leverage: NDArray[np.float64]
    """Variance of Y - (Y/U) U over that of one equation, shape (lines,)."""

    @property
    def variance(self) -> NDArray[np.float64]:
        """E|dY - (Y/U) dU|², shape (lines,)."""
        return self.square / self.freedom * self.leverage


def free_windows(segment: Segment, half_width: int) -> LineWindows:
    """Return each line with the 2n nearest bins that are not excited: n below and n above it, if possible."""
    periods, samples = segment.channels[next(iter(segment.channels))].shape
    free = np.arange(1, (periods * samples + 1) // 2)
    free = free[free % periods != 0]
    if free.size < 2 * half_width:
        raise RecordError(
            f"{periods} periods of {samples} samples have {free.size} bins between the lines; expected "
            f"{2 * half_width} or more: record more periods, or lower 'half_width' and 'order'"
        )
    lines = segment.lines * periods
    around = _nearest_bins(free, lines, 2 * half_width)
    return _line_windows(np.sort(np.concatenate([around, lines[:, None]], axis=1), axis=1), lines)


def all_windows(segment: Segment, half_width: int) -> LineWindows:
    """Return the 2n + 1 bins around each line: n below and n above it, if possible."""
    periods, samples = segment.channels[next(iter(segment.channels))].shape
    bins = np.arange(1, (periods * samples + 1) // 2)
    if bins.size < 2 * half_width + 1:
        raise RecordError(
            f"a record of {periods * samples} samples has {bins.size} bins; expected {2 * half_width + 1} or more: "
            "record for longer, or lower 'half_width' and 'order'"
        )
    lines = segment.lines * periods
    return _line_windows(_nearest_bins(bins, lines, 2 * half_width + 1), lines)


def _nearest_bins(candidates: NDArray[np.int64], lines: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    first = np.searchsorted(candidates, lines) - count // 2
    return candidates[np.clip(first, 0, candidates.size - count)[:, None] + np.arange(count)]


def _line_windows(bins: NDArray[np.int64], lines: NDArray[np.int64]) -> LineWindows:
    distance = (bins - lines[:, None]).astype(float)
    return LineWindows(bins, lines, distance / np.abs(distance).max(axis=1, keepdims=True))


def drive_smoothness(segment: Segment, drive: str, windows: LineWindows, order: int) -> NDArray[np.float64]:
    """Return the share of a drive's power around each line that a polynomial of an order follows, shape (lines,)."""
    values = record_spectrum(segment, drive)[windows.bins]
    basis, _ = np.linalg.qr(windows.distance[:, :, None] ** np.arange(order + 1))
    followed = np.einsum("lwc,lw->lc", basis, values)
    power = np.sum(np.abs(values) ** 2, axis=1)
    return np.asarray(np.sum(np.abs(followed) ** 2, axis=1) / np.where(power > 0, power, np.inf))


@dataclass(frozen=True)
class LocalModel:
    """The orders of the model of spectra around a line."""

    order: int
    """Order of the polynomials."""
    denominator_order: int
    """Order of the denominator, 0 for polynomials only."""
    iterations: int
    """Number of Sanathanan-Koerner iterations of the denominator."""
    integrators: int
    """Order of the plant's pole at s = 0."""

    @property
    def unknowns(self) -> int:
        """Number of unknowns of a transient around a line."""
        return self.order + 1 + self.denominator_order

    def fit(self, segment: Segment, names: tuple[str, str], drive: str | None, windows: LineWindows) -> LocalEstimate:
        """Return the parts of output and input, by `names`, that follow the drive: a channel, or None for the lines.

        The position y of a plant with n integrators grows; Δⁿy with Δ = 1 - z⁻¹ has a smooth spectrum. White noise of y
        is not white in Δⁿy, so the equations are weighted by 1/|Δ|ⁿ, relative to the line, at which Δ is 1.
        """
        spectra = [record_spectrum(segment, name)[windows.bins] for name in names]
        turns = 2j * np.pi / segment.channels[names[0]].size
        difference = ((1 - np.exp(-turns * windows.bins)) / (1 - np.exp(-turns * windows.lines))[:, None]) ** (
            self.integrators
        )
        signals = np.stack([spectra[0] * difference, spectra[1]], axis=2)
        columns = _columns(segment, drive, windows, self.order)
        weights = 1 / np.abs(difference)[:, :, None]
        found = _polynomial_fit(signals * weights, columns * weights)
        if not self.denominator_order:
            return found
        denominator = self._denominator(signals * weights, columns * weights, windows.distance)
        rational = _rational_fit(
            signals * weights, columns * weights, denominator, windows.distance, self.denominator_order
        )
        return _significant_fit(found, rational)

    def _denominator(
        self, signals: NDArray[np.complex128], columns: NDArray[np.complex128], distance: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return D(r), the same for output and input, shape (lines, window).

        D Z = A R + I is linear in all coefficients (Levy, 1959); each iteration divides the equations by the last D
        (C. K. Sanathanan and J. Koerner, IEEE Trans. Automatic Control 8(1), 1963, doi:10.1109/TAC.1963.1105517).
        """
        powers = distance[:, :, None] ** np.arange(1, self.denominator_order + 1)
        largest = np.abs(signals).max(axis=1)  # output and input count alike relative to it, and rounding does not
        signals = signals / np.where(largest > 0, largest, 1.0)[:, None, :]
        denominator = np.ones(distance.shape, dtype=complex)
        for _ in range(self.iterations + 1):
            basis, _ = np.linalg.qr(columns / denominator[:, :, None])
            weighted = signals / denominator[:, :, None]
            both = range(signals.shape[2])
            residuals = np.concatenate([_projected_out(basis, weighted[:, :, k, None]) for k in both], axis=1)
            slopes = np.concatenate([_projected_out(basis, powers * weighted[:, :, k, None]) for k in both], axis=1)
            found = -np.einsum("lkw,lw->lk", np.linalg.pinv(slopes), residuals[:, :, 0])
            denominator = 1 + np.einsum("lwk,lk->lw", powers, found)
        return denominator


def _columns(segment: Segment, drive: str | None, windows: LineWindows, order: int) -> NDArray[np.complex128]:
    """Return the columns of the linear equations, shape (lines, window, columns): the last is the drive at the line."""
    powers = windows.distance[:, :, None] ** np.arange(order, -1, -1) + 0j
    if drive is None:  # all at the line except the transient
        return np.concatenate([powers, windows.center[:, :, None]], axis=2)
    values = record_spectrum(segment, drive)[windows.bins]
    size = np.abs(values).max(axis=1, keepdims=True)
    if np.any(np.sum(np.abs(values) > ROUNDING * size, axis=1) <= order):
        raise RecordError(
            f"the channel '{drive}' excites {order} bins or fewer around a line; expected {order + 1} or more: record "
            "two periods or more, excite neighbouring bins, lower 'order', or raise 'half_width'"
        )
    return np.concatenate([powers, powers * values[:, :, None]], axis=2)


def _polynomial_fit(signals: NDArray[np.complex128], columns: NDArray[np.complex128]) -> LocalEstimate:
    """Return the least squares fit of signals, shape (lines, window, 2), by columns."""
    basis, triangle = np.linalg.qr(columns)
    last = triangle[:, -1, -1]
    inside = np.einsum("lwc,lws->lcs", basis.conj(), signals)
    output, input_ = (inside[:, -1, :] / last[:, None]).T
    residuals = signals - np.einsum("lwc,lcs->lws", basis, inside)
    error = residuals[:, :, 0] - _ratio(output, input_)[:, None] * residuals[:, :, 1]
    return _local_estimate(output, input_, error, columns, last)


def _rational_fit(
    signals: NDArray[np.complex128],
    columns: NDArray[np.complex128],
    denominator: NDArray[np.complex128],
    distance: NDArray[np.float64],
    denominator_order: int,
) -> LocalEstimate:
    """Return the fit with a denominator, after a Gauss-Newton step of all unknowns on the residuals of Y - G U."""
    divided = columns / denominator[:, :, None]
    start = _polynomial_fit(signals, divided)
    error = signals[:, :, :1] - _ratio(start.output, start.input)[:, None, None] * signals[:, :, 1:]
    basis, _ = np.linalg.qr(divided)
    fitted = error - _projected_out(basis, error)
    slopes = distance[:, :, None] ** np.arange(1, denominator_order + 1) * (fitted / denominator[:, :, None])
    widened = np.concatenate([slopes, divided], axis=2)
    basis, triangle = np.linalg.qr(widened)
    last = triangle[:, -1, -1]
    step = np.einsum("lw,lw->l", basis[:, :, -1].conj(), error[:, :, 0]) / last
    return _local_estimate(start.output + step, start.input, _projected_out(basis, error)[:, :, 0], widened, last)


def _local_estimate(
    output: NDArray[np.complex128],
    input_: NDArray[np.complex128],
    residuals: NDArray[np.complex128],
    columns: NDArray[np.complex128],
    last: NDArray[np.complex128],
) -> LocalEstimate:
    """Return a fit from the residuals of its equations, shape (lines, window)."""
    freedom = np.full(len(output), float(columns.shape[1] - columns.shape[2]))
    return LocalEstimate(output, input_, np.sum(np.abs(residuals) ** 2, axis=1), freedom, 1 / np.abs(last) ** 2)


def _significant_fit(polynomial: LocalEstimate, rational: LocalEstimate) -> LocalEstimate:
    """Return the rational fit at lines where it is significantly better (F-test), elsewhere the polynomial one.

    A denominator that only follows the noise would make the response and its confidence band worse.
    """
    from scipy.special import fdtri  # slow to import: listing plugins must stay fast

    spent = polynomial.freedom - rational.freedom
    limit = fdtri(2 * spent, 2 * rational.freedom, 1 - SIGNIFICANCE / polynomial.square.size)
    chosen = (polynomial.square - rational.square) * rational.freedom > limit * rational.square * spent
    names = [field.name for field in fields(LocalEstimate)]
    return LocalEstimate(*(np.where(chosen, getattr(rational, name), getattr(polynomial, name)) for name in names))


def _projected_out(basis: NDArray[np.complex128], values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return values, shape (lines, window, n), less their projection onto an orthonormal basis."""
    return values - np.einsum("lwc,lcn->lwn", basis, np.einsum("lwc,lwn->lcn", basis.conj(), values))


def _ratio(output: NDArray[np.complex128], input_: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return output / np.where(input_ == 0, np.nan, input_)
