"""Friction as a sum of columns with coefficients: rows of the regression, constrained least squares, covariance."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.identification.friction_record import Stretch

REACH = 4.0
"""Half length of the low-pass filter, in its standard deviations."""
HAT = np.array([1.0, 4.0, 1.0]) / 6
"""What a force that is linear between samples adds to the second difference of the position."""
FREE = ("offset", "asymmetry")
"""Coefficients of either sign; all others are at least 0."""
SAME = 1e-6
"""Singular value, relative to the greatest, of columns that are the same."""
MEDIAN, ORDER = 0.6745, 8
"""Median of |x| of a normal distribution of variance 1, and order of the differences that show noise."""
WINDOW = 5.0
"""Lags, in correlation times, over which a residual's autocorrelation is summed (A. D. Sokal, 1997)."""


@dataclass(frozen=True)
class Observation:
    """How a force is seen: directly, or by the thrust that it leaves for a moving mass.

    The second difference of the position of a mass M obeys M (y₊ - 2y + y₋)/Ts² = the mean of thrust less friction
    over two samples, weighted by a triangle: exactly, for a held thrust and a friction that is linear between samples.
    Both sides are filtered alike, so that the noise of a differentiated scale does not enter.
    """

    inertia: bool
    """Whether the force is a thrust that moves a mass."""
    delay: float = 0.0
    """Time by which the held thrust reaches the position's samples late [s]."""
    highest: float = 5.0
    """Frequency up to which both are compared [Hz]."""

    def force(self, stretch: Stretch) -> np.ndarray:
        """Return what the columns are to explain [N], shape (rows, 1)."""
        if not self.inertia:
            return stretch.force[:, None]
        late = self.delay / stretch.sample_time
        whole = int(np.floor(late + 1e-9))
        part = max(late - whole, 0.0)
        weights = ((1 - part) ** 2 / 2, 0.5 + part - part**2, part**2 / 2)
        shifted = [weight * np.roll(stretch.force, whole + step) for step, weight in enumerate(weights)]
        return self._filtered(stretch, np.sum(shifted, axis=0)[:, None])

    def friction(self, stretch: Stretch, columns: np.ndarray) -> np.ndarray:
        """Return columns of friction forces, shape (n, p), as the force sees them, shape (rows, p)."""
        if not self.inertia:
            return columns
        before, after = np.roll(columns, 1, axis=0), np.roll(columns, -1, axis=0)
        return self._filtered(stretch, HAT[0] * before + HAT[1] * columns + HAT[2] * after)

    def acceleration(self, stretch: Stretch) -> np.ndarray:
        """Return the column of the mass [m/s²], shape (rows, 1)."""
        if stretch.acceleration is not None:
            return self.friction(stretch, stretch.acceleration[:, None])
        y = stretch.displacement
        second = (np.roll(y, -1) - 2 * y + np.roll(y, 1)) / stretch.sample_time**2
        return self._filtered(stretch, second[:, None])

    def noise(self, stretch: Stretch, mass: float) -> float:
        """Return the standard deviation of a row's force [N] that the white noise of the channels makes."""
        if not self.inertia:
            return white_noise(stretch.force)
        taps, step = self._taps(stretch), np.array([1.0, -2.0, 1.0]) / stretch.sample_time**2
        by_force = white_noise(stretch.force) * np.linalg.norm(taps)
        if stretch.acceleration is not None:
            return float(np.hypot(by_force, mass * white_noise(stretch.acceleration) * np.linalg.norm(taps)))
        return float(
            np.hypot(by_force, mass * white_noise(stretch.displacement) * np.linalg.norm(np.convolve(taps, step)))
        )

    def _taps(self, stretch: Stretch) -> np.ndarray:
        """Return the Gaussian low-pass, -3 dB at `highest`."""
        deviation = np.sqrt(np.log(2)) / (2 * np.pi * self.highest) / stretch.sample_time
        reach = self._sizes(stretch)[0]
        taps = np.exp(-((np.arange(-reach, reach + 1) / deviation) ** 2) / 2)
        return np.asarray(taps / taps.sum())

    def rows(self, stretch: Stretch, known_from: int) -> np.ndarray:
        """Return the samples of the rows whose elements are known, shape (rows,) of int."""
        samples = np.arange(stretch.displacement.size)
        if not self.inertia:
            return samples[known_from:]
        reach, step, margin = self._sizes(stretch)
        inner = samples[margin + reach : samples.size - margin - reach : step]
        return inner[inner >= known_from + reach]

    def _sizes(self, stretch: Stretch) -> tuple[int, int, int]:
        """Return half length and step of the filter, and what the ends of a stretch lack, in samples."""
        deviation = np.sqrt(np.log(2)) / (2 * np.pi * self.highest) / stretch.sample_time
        late = int(np.ceil(abs(self.delay) / stretch.sample_time))
        return int(np.ceil(REACH * deviation)), max(int(deviation), 1), late + 2

    def _filtered(self, stretch: Stretch, columns: np.ndarray) -> np.ndarray:
        """Return columns after the low-pass at the rows, all of them."""
        reach, step, margin = self._sizes(stretch)
        inner = columns[margin : len(columns) - margin]
        if len(inner) <= 2 * reach:
            raise RecordError(
                f"a stretch of {len(columns) * stretch.sample_time:g} s is too short for a low-pass of "
                f"{self.highest:g} Hz; record for longer, or raise highest"
            )
        taps = self._taps(stretch)
        windows = np.lib.stride_tricks.sliding_window_view(inner, taps.size, axis=0)[::step]
        found: np.ndarray = np.einsum("rpt,t->rp", windows, taps)
        return found

    def kept(self, stretch: Stretch, filtered: np.ndarray, known_from: int) -> np.ndarray:
        """Return those of all rows whose elements are known."""
        count = self.rows(stretch, known_from).size
        return filtered[len(filtered) - count :]


@dataclass(frozen=True)
class RegressionRows:
    """Rows of a regression: columns, what they are to explain, and where they come from."""

    names: tuple[str, ...]
    """Name of each column: those of FREE first."""
    columns: np.ndarray
    """Shape (rows, p)."""
    force: np.ndarray
    """Shape (rows,) [N]."""
    velocity: np.ndarray
    """Shape (rows,) [m/s]."""
    duration: float
    """Time for which a row stands [s]."""
    cycle: np.ndarray
    """Shape (rows,) of int."""

    @property
    def free(self) -> int:
        """Number of columns whose coefficient may have either sign."""
        return sum(name in FREE for name in self.names)


def rows_of(
    stretch: Stretch, observation: Observation, terms: Sequence[str], elements: np.ndarray, known_from: int
) -> RegressionRows:
    """Return the rows of a stretch: the terms' columns, then those of the elements, shape (n, N)."""
    velocity = stretch.velocity()
    plain = {"offset": np.ones_like(velocity), "asymmetry": np.abs(velocity), "viscous": velocity}
    parts = [
        observation.acceleration(stretch) if term == "mass" else observation.friction(stretch, plain[term][:, None])
        for term in terms
    ]
    parts.append(observation.friction(stretch, elements))
    samples = observation.rows(stretch, known_from)
    step = int(samples[1] - samples[0]) if samples.size > 1 else 1
    return RegressionRows(
        names=(*terms, *(f"element {number}" for number in range(elements.shape[1]))),
        columns=observation.kept(stretch, np.concatenate(parts, axis=1), known_from),
        force=observation.kept(stretch, observation.force(stretch), known_from)[:, 0],
        velocity=velocity[samples],
        duration=step * stretch.sample_time,
        cycle=stretch.cycle[samples],
    )


class Compressed:
    """The rows of some cycles, compressed by orthogonal transformations: small, and as well conditioned as they are."""

    def __init__(self, rows: Sequence[RegressionRows], cycles: np.ndarray) -> None:
        self.free = rows[0].free
        parts, self.count = [], 0
        for each in rows:
            chosen = np.isin(each.cycle, cycles)
            self.count += int(chosen.sum())
            parts.append(np.linalg.qr(np.column_stack([each.columns[chosen], each.force[chosen]]), mode="r"))
        self.triangle = np.asarray(np.linalg.qr(np.concatenate(parts), mode="r"))

    def solve(self, kept: np.ndarray) -> np.ndarray:
        """Return the coefficients, shape (p,), of least squared error: those not `kept` are 0, those not free ≥ 0.

        Those of either sign are eliminated: they come first, so the rows below theirs do not know them. C. L. Lawson
        and R. J. Hanson, Solving Least Squares Problems, 1974, ch. 23.
        """
        from scipy.optimize import nnls

        places = np.flatnonzero(kept)
        free = int(np.sum(places < self.free))
        scale = np.sqrt(np.add.reduce(self.triangle[:, places] ** 2, axis=0))
        scale[scale == 0] = 1.0
        both = np.column_stack([self.triangle[:, places] / scale, self.triangle[:, -1]])
        small = np.asarray(np.linalg.qr(both, mode="r"))
        try:
            positive, _ = nnls(small[free:, free:-1], small[free:, -1], maxiter=100 * (places.size + 1))
        except RuntimeError:
            raise RecordError(
                "the least squares did not converge; give fewer thresholds, or a wider range of them"
            ) from None
        either = np.linalg.solve(small[:free, :free], small[:free, -1] - small[:free, free:-1] @ positive)
        found = np.zeros(self.triangle.shape[1] - 1)
        found[places] = np.concatenate([either, positive]) / scale
        return found

    def mean_square(self, coefficients: np.ndarray) -> float:
        """Return the mean squared error [N²] of these coefficients."""
        error = self.triangle[:, :-1] @ coefficients - self.triangle[:, -1]
        return float(np.add.reduce(error**2)) / max(self.count, 1)

    def inverse(self, kept: np.ndarray) -> np.ndarray:
        """Return (AᵀA)⁻¹ of the `kept` columns, zero elsewhere, shape (p, p)."""
        places = np.flatnonzero(kept)
        scale = np.sqrt(np.add.reduce(self.triangle[:, places] ** 2, axis=0))
        scale[scale == 0] = 1.0
        root = pseudo_inverse(self.triangle[:, places] / scale) / scale[:, None]
        full = np.zeros((len(kept), len(kept)))
        full[np.ix_(places, places)] = root @ root.T
        return full


def pseudo_inverse(columns: np.ndarray) -> np.ndarray:
    """Return a root of (AᵀA)⁻¹, shape (p, p), without the directions in which columns are the same but for rounding."""
    return np.asarray(np.linalg.pinv(np.asarray(np.linalg.qr(columns, mode="r")), rcond=SAME))


def long_run_variance(residuals: Sequence[np.ndarray], parameters: int) -> float:
    """Return the variance of the residuals [N²] times their correlation time in samples: of slow columns' errors."""
    count = sum(each.size for each in residuals)
    squared = sum(float(np.add.reduce(each**2)) for each in residuals)
    if not squared:
        return 0.0
    size = 2 * max(each.size for each in residuals)
    total = np.zeros(size // 2)
    for each in residuals:
        correlation = np.fft.irfft(np.abs(np.fft.rfft(each, size)) ** 2, size)[: each.size]
        total[: each.size] += correlation
    time = 2 * np.cumsum(total / squared) - 1
    enough = np.flatnonzero(np.arange(time.size) >= WINDOW * time)
    return squared / max(count - parameters, 1) * max(float(time[enough[0]]) if enough.size else 1.0, 1.0)


def misfit_variance(count: int, parameters: int, error: float) -> float:
    """Return the variance [N²] of `count` rows whose root mean square `error` [N] is no noise.

    It does not average out: as much of it may have gone into the parameters as is left, so that the rows count as one
    for each parameter.
    """
    return error**2 * count / max(parameters, 1)


def white_noise(values: np.ndarray) -> float:
    """Return the standard deviation of white noise on a smooth signal, at most: by the median of high differences."""
    differences = np.diff(values, ORDER)
    if not differences.size:
        return 0.0
    return float(np.median(np.abs(differences))) / MEDIAN / np.sqrt(comb(2 * ORDER, ORDER))
