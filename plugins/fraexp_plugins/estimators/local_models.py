"""Local models of spectra: least squares over the bins around each excited line, for all lines at once.

A record of a linear system that is not in its periodic state obeys Y(k) = G(k) U(k) + T(k) + V(k) exactly, with a
transient T as smooth as G (R. Pintelon and J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed.
2012, section 6.3.2, doi:10.1002/9781118287422). Around a line both are polynomials in the distance r, or ratios of
such with a common denominator D(r) = 1 + d_1 r + d_2 r² + ...
"""

from dataclasses import dataclass, fields

import numpy as np

from fraexp.api import RecordError, Segment, spectrum_of

SMALL = 1e-10
"""A column that is so much smaller once the others are taken out of it is made of them."""
DOUBT = 1e-4
"""Probability at which chance alone makes a denominator look better than none."""


@dataclass(frozen=True)
class Windows:
    """The bins around each line that are looked at."""

    bins: np.ndarray
    """Bins of the record's spectrum, ascending, shape (lines, window) of int."""
    lines: np.ndarray
    """Bin of each line, shape (lines,) of int."""
    distance: np.ndarray
    """Distance r from the line, of 1 at most, shape (lines, window)."""

    @property
    def center(self) -> np.ndarray:
        """Where the line itself is, shape (lines, window) of bool."""
        return self.bins == self.lines[:, None]


@dataclass(frozen=True)
class Local:
    """What is known at each line of output and input of one record, from the bins around it."""

    output: np.ndarray
    """Its part Y that belongs to the drive, complex, shape (lines,)."""
    input: np.ndarray
    """The same of the input, U, complex, shape (lines,)."""
    square: np.ndarray
    """Sum of the squares that the equations leave of output less Y/U times input, shape (lines,)."""
    freedom: np.ndarray
    """Complex degrees of freedom of that sum, shape (lines,)."""
    leverage: np.ndarray
    """Variance of Y - (Y/U) U over that of one equation, shape (lines,)."""

    @property
    def variance(self) -> np.ndarray:
        """E|dY - (Y/U) dU|², shape (lines,)."""
        return self.square / self.freedom * self.leverage


def free_windows(segment: Segment, half_width: int) -> Windows:
    """Return each line with the 2n nearest bins that no period excites, n below and n above it where there are."""
    periods, samples = segment.channels[next(iter(segment.channels))].shape
    free = np.arange(1, (periods * samples + 1) // 2)
    free = free[free % periods != 0]
    if free.size < 2 * half_width:
        raise RecordError(
            f"{periods} periods of {samples} samples have {free.size} bins between the lines; expected "
            f"{2 * half_width} at least: record more periods, or lower 'half_width' and 'order'"
        )
    lines = segment.lines * periods
    around = _nearest(free, lines, 2 * half_width)
    return _windows(np.sort(np.concatenate([around, lines[:, None]], axis=1), axis=1), lines)


def all_windows(segment: Segment, half_width: int) -> Windows:
    """Return the 2n + 1 bins around each line, n below and n above it where there are."""
    periods, samples = segment.channels[next(iter(segment.channels))].shape
    bins = np.arange(1, (periods * samples + 1) // 2)
    if bins.size < 2 * half_width + 1:
        raise RecordError(
            f"a record of {periods * samples} samples has {bins.size} bins; expected {2 * half_width + 1} at least: "
            "record for longer, or lower 'half_width' and 'order'"
        )
    lines = segment.lines * periods
    return _windows(_nearest(bins, lines, 2 * half_width + 1), lines)


def _nearest(candidates: np.ndarray, lines: np.ndarray, count: int) -> np.ndarray:
    first = np.searchsorted(candidates, lines) - count // 2
    chosen: np.ndarray = candidates[np.clip(first, 0, candidates.size - count)[:, None] + np.arange(count)]
    return chosen


def _windows(bins: np.ndarray, lines: np.ndarray) -> Windows:
    distance = (bins - lines[:, None]).astype(float)
    return Windows(bins, lines, distance / np.abs(distance).max(axis=1, keepdims=True))


@dataclass(frozen=True)
class LocalModel:
    """How spectra are described around a line."""

    order: int
    """Order of the polynomials."""
    poles: int
    """Order of the denominator, 0 for polynomials alone."""
    iterations: int
    """How often the denominator is computed again with the last one as weight."""
    integrators: int
    """Order of the plant's pole at s = 0."""

    @property
    def unknowns(self) -> int:
        """Numbers that describe a transient around a line."""
        return self.order + 1 + self.poles

    def fit(self, segment: Segment, names: tuple[str, str], drive: str | None, windows: Windows) -> Local:
        """Return what of output and input, by `names`, follows the drive: a channel, or None for the periodic part.

        The position y of a plant with n integrators grows; Δⁿy with Δ = 1 - z⁻¹ has a smooth spectrum. Noise that is
        white in y is not so in Δⁿy: the equations are weighted by 1/|Δ|ⁿ, relative to the line, at which Δ is 1.
        """
        spectra = [spectrum_of(segment, name)[windows.bins] for name in names]
        turns = 2j * np.pi / segment.channels[names[0]].size
        difference = ((1 - np.exp(-turns * windows.bins)) / (1 - np.exp(-turns * windows.lines))[:, None]) ** (
            self.integrators
        )
        signals = np.stack([spectra[0] * difference, spectra[1]], axis=2)
        columns = _columns(segment, drive, windows, self.order)
        weights = 1 / np.abs(difference)[:, :, None]
        found = _polynomial(signals * weights, columns * weights)
        if not self.poles:
            return found
        denominator = self._denominator(signals * weights, columns * weights, windows.distance)
        rational = _rational(signals * weights, columns * weights, denominator, windows.distance, self.poles)
        return _better(found, rational)

    def _denominator(self, signals: np.ndarray, columns: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return D(r), the same for output and input, shape (lines, window).

        D Z = A R + I is linear in all coefficients (Levy, 1959); each iteration divides the equations by the last D
        (C. K. Sanathanan and J. Koerner, IEEE Trans. Automatic Control 8(1), 1963, doi:10.1109/TAC.1963.1105517).
        """
        powers = distance[:, :, None] ** np.arange(1, self.poles + 1)
        largest = np.abs(signals).max(axis=1)  # relative to it both count alike, and rounding does not count
        signals = signals / np.where(largest > 0, largest, 1.0)[:, None, :]
        denominator = np.ones(distance.shape, dtype=complex)
        for _ in range(self.iterations + 1):
            basis, _ = np.linalg.qr(columns / denominator[:, :, None])
            weighted = signals / denominator[:, :, None]
            both = range(signals.shape[2])
            rest = np.concatenate([_outside(basis, weighted[:, :, k, None]) for k in both], axis=1)
            slopes = np.concatenate([_outside(basis, powers * weighted[:, :, k, None]) for k in both], axis=1)
            found = -np.einsum("lkw,lw->lk", np.linalg.pinv(slopes), rest[:, :, 0])
            denominator = 1 + np.einsum("lwk,lk->lw", powers, found)
        return denominator


def _columns(segment: Segment, drive: str | None, windows: Windows, order: int) -> np.ndarray:
    """Return what the equations are linear in, shape (lines, window, columns): last the drive at the line."""
    powers = windows.distance[:, :, None] ** np.arange(order, -1, -1) + 0j
    if drive is None:  # what is at the line besides the transient, whatever it is
        return np.concatenate([powers, windows.center[:, :, None]], axis=2)
    values = spectrum_of(segment, drive)[windows.bins]
    size = np.abs(values).max(axis=1, keepdims=True)
    if np.any(np.sum(np.abs(values) > SMALL * size, axis=1) <= order):
        raise RecordError(
            f"around a line the channel '{drive}' excites {order} bins or fewer; expected {order + 1} at least: record "
            "two periods or more, or excite neighbouring bins, or lower 'order', or raise 'half_width'"
        )
    return np.concatenate([powers, powers * values[:, :, None]], axis=2)


def _polynomial(signals: np.ndarray, columns: np.ndarray) -> Local:
    """Return the least squares fit of signals by columns; `signals` has shape (lines, window, 2)."""
    basis, triangle = np.linalg.qr(columns)
    last = triangle[:, -1, -1]
    inside = np.einsum("lwc,lws->lcs", basis.conj(), signals)
    output, given = (inside[:, -1, :] / last[:, None]).T
    rest = signals - np.einsum("lwc,lcs->lws", basis, inside)
    return _local(output, given, rest[:, :, 0] - _ratio(output, given)[:, None] * rest[:, :, 1], columns, last)


def _rational(
    signals: np.ndarray, columns: np.ndarray, denominator: np.ndarray, distance: np.ndarray, poles: int
) -> Local:
    """Return the fit with a denominator, after a Gauss-Newton step of all unknowns for what is left of Y - G U."""
    divided = columns / denominator[:, :, None]
    start = _polynomial(signals, divided)
    error = signals[:, :, :1] - _ratio(start.output, start.input)[:, None, None] * signals[:, :, 1:]
    basis, _ = np.linalg.qr(divided)
    fitted = error - _outside(basis, error)
    slopes = distance[:, :, None] ** np.arange(1, poles + 1) * (fitted / denominator[:, :, None])
    widened = np.concatenate([slopes, divided], axis=2)
    basis, triangle = np.linalg.qr(widened)
    last = triangle[:, -1, -1]
    step = np.einsum("lw,lw->l", basis[:, :, -1].conj(), error[:, :, 0]) / last
    return _local(start.output + step, start.input, _outside(basis, error)[:, :, 0], widened, last)


def _local(output: np.ndarray, given: np.ndarray, rest: np.ndarray, columns: np.ndarray, last: np.ndarray) -> Local:
    """Return a fit whose equations leave `rest`, shape (lines, window)."""
    freedom = np.full(len(output), float(columns.shape[1] - columns.shape[2]))
    return Local(output, given, np.sum(np.abs(rest) ** 2, axis=1), freedom, 1 / np.abs(last) ** 2)


def _better(polynomial: Local, rational: Local) -> Local:
    """Return the rational model where it leaves less than chance explains (F-test), else the polynomial one.

    A denominator that only follows the noise would make the response, and its band, worse than none.
    """
    from scipy.special import fdtri  # listing plugins must stay fast

    spent = polynomial.freedom - rational.freedom
    limit = fdtri(2 * spent, 2 * rational.freedom, 1 - DOUBT)
    chosen = (polynomial.square - rational.square) * rational.freedom > limit * rational.square * spent
    names = [field.name for field in fields(Local)]
    return Local(*(np.where(chosen, getattr(rational, name), getattr(polynomial, name)) for name in names))


def _outside(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return what of values, shape (lines, window, n), an orthonormal basis does not describe."""
    return values - np.einsum("lwc,lcn->lwn", basis, np.einsum("lwc,lwn->lcn", basis.conj(), values))


def _ratio(output: np.ndarray, given: np.ndarray) -> np.ndarray:
    return output / np.where(given == 0, np.nan, given)
