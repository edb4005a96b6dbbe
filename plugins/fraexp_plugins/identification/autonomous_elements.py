"""The friction elements that make P̂ the same in all records: a convex problem without start values."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.autonomous_lines import SpectralLines

PRIOR = 0.3
"""Standard deviation of ΣF_m over the greatest thrust before anything is seen, by elements that are independent."""
REACH = 3
"""Places of the grid around an element that is found at which others may be in its place."""


@dataclass(frozen=True)
class AutonomousElements:
    """Stiffnesses on a grid of thresholds, and the inverse plant 1/P̂ that they leave at each line."""

    thresholds: np.ndarray
    """Y_i [m], ascending, shape (N,)."""
    stiffness: np.ndarray
    """K_i [N/m], shape (N,); 0 for most."""
    covariance: np.ndarray
    """Of K_i [N²/m²], shape (N, N)."""
    inverse: np.ndarray
    """1/P̂ [N/m], complex, shape (L,)."""
    slopes: np.ndarray
    """∂(1/P̂)/∂K_i, complex, shape (L, N)."""
    noise: np.ndarray
    """E|d(1/P̂)|² by noise [N²/m²], shape (L,)."""
    excess: float
    """Sum of squares over its expectation by noise and floor."""
    scatter: np.ndarray
    """Relative scatter of Y/Û_e from record to record, shape (L,); NaN where there is one record."""
    floor: np.ndarray
    """The same as noise explains it, shape (L,)."""

    @property
    def forces(self) -> np.ndarray:
        """F_mi [N], shape (N,)."""
        return self.stiffness * self.thresholds

    @cached_property
    def columns(self) -> np.ndarray:
        """Errors of K_i [N/m], one standard deviation in each of uncorrelated directions, shape (N, N)."""
        values, vectors = np.linalg.eigh(self.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    @property
    def inverse_columns(self) -> np.ndarray:
        """What these errors do to 1/P̂ [N/m], complex, shape (L, N)."""
        return self.slopes @ self.columns

    @cached_property
    def merging(self) -> np.ndarray:
        """Which element of the model each place of the grid belongs to, shape (n, N) of 0 and 1.

        An element between two thresholds of the grid comes out as both: neighbours are one element.
        """
        places = np.flatnonzero(self.stiffness)
        runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
        pairs = [run[first : first + 2] for run in runs for first in range(0, run.size, 2)]
        return np.array([np.isin(np.arange(self.stiffness.size), pair) for pair in pairs], dtype=float)

    @property
    def model_values(self) -> np.ndarray:
        """K_i, then F_mi of the merged elements, shape (2 n,)."""
        return np.concatenate([self.merging @ self.stiffness, self.merging @ self.forces])

    @property
    def model_covariance(self) -> np.ndarray:
        """Covariance of `model_values`, shape (2 n, 2 n)."""
        linear = np.concatenate([self.merging, self.merging * self.thresholds])
        return linear @ self.covariance @ linear.T

    def model(self) -> Rolling:
        """Return the friction model."""
        stiffness, force = np.split(self.model_values, 2)
        return Rolling(stiffness=stiffness.tolist(), limit_force=force.tolist())

    def virgin_curve(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return g(x) = Σ K_i min(x, Y_i) [N] and its standard deviation at x [m], each of the shape of x."""
        reach = np.minimum(x[:, None], self.thresholds)
        variance = np.einsum("ij,jk,ik->i", reach, self.covariance, reach)
        return reach @ self.stiffness, np.sqrt(np.maximum(variance, 0.0))

    @property
    def coulomb(self) -> tuple[float, float]:
        """ΣF_m [N] and its standard deviation."""
        force, deviation = self.virgin_curve(self.thresholds[-1:])
        return float(force[0]), float(deviation[0])


def fitted(lines: SpectralLines, thresholds: np.ndarray, total: np.ndarray, peak: float) -> AutonomousElements:
    """Return the elements with Σ w_a |G U_a - Σ K_i Z_i,a - Y_a/P̂|² least over K_i >= 0 and 1/P̂ at each line.

    1/P̂ enters linearly and is eliminated by projection; what is left is a non-negative least-squares problem. `total`
    is the variance 1/w_a [N²], shape (L, M), and `peak` the greatest thrust [N]: it tells how large F_mi may be, each
    by itself, where nothing else does, such as that of elements that hardly slip (ridge regression: A. E. Hoerl and
    R. W. Kennard, Technometrics 12(1), 1970, doi 10.1080/00401706.1970.10488634).
    """
    from scipy.optimize import nnls  # scipy: imported only when something is estimated

    weight = np.where(lines.known, 1 / np.sqrt(np.where(lines.known, total, 1.0)), 0.0)
    u, y, z = weight * lines.thrust, weight * lines.motion, weight[..., None] * lines.deflection
    power = np.sum(np.abs(y) ** 2, axis=1)
    share = np.conj(y) / power[:, None]
    slopes = -np.einsum("la,lan->ln", share, z)
    matrix = _parts((z + y[..., None] * slopes[:, None]).reshape(-1, thresholds.size))
    wanted = _parts((u - y * np.sum(share * u, axis=1)[:, None]).ravel())
    prior = PRIOR * peak / np.sqrt(thresholds.size) / thresholds
    scaled = np.concatenate([matrix * prior, np.eye(thresholds.size)])
    relative, _ = nnls(scaled, np.append(wanted, np.zeros(thresholds.size)), maxiter=100 * thresholds.size)
    stiffness = relative * prior
    inverse = np.sum(share * u, axis=1) + slopes @ stiffness
    inner = scaled[: len(matrix)].T @ scaled[: len(matrix)]
    used = float(np.trace(np.linalg.solve(inner + np.eye(thresholds.size), inner)))  # parameters that the data tell
    left = float(np.sum((matrix @ stiffness - wanted) ** 2))
    excess = left / max(lines.equations - used, 1.0)
    possible = _possible(stiffness)
    posterior = np.zeros_like(inner)
    posterior[np.ix_(possible, possible)] = np.linalg.inv(
        inner[np.ix_(possible, possible)] / max(excess, 1.0) + np.eye(possible.size)
    )
    effective = lines.thrust - lines.deflection @ stiffness
    return AutonomousElements(
        thresholds,
        stiffness,
        posterior * np.outer(prior, prior),
        inverse,
        slopes,
        max(excess, 1.0) / power,
        excess,
        scatter_of(lines, effective),
        _expected(lines, effective, total),
    )


def _possible(stiffness: np.ndarray) -> np.ndarray:
    """Return the places of the elements that may be there: those found, and neighbours, which would do nearly as well.

    The stiffness of all others is 0: it cannot be less, and the records would differ more if it were greater.
    """
    found = np.flatnonzero(stiffness)
    near = np.unique(found[:, None] + np.arange(-REACH, REACH + 1))
    return near[(near >= 0) & (near < stiffness.size)]


def _parts(values: np.ndarray) -> np.ndarray:
    return np.concatenate([values.real, values.imag])


def scatter_of(lines: SpectralLines, effective: np.ndarray) -> np.ndarray:
    """Return the relative scatter of Y/U for inputs [N] from record to record at each line, shape (L,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(lines.known, lines.motion / effective, 0)
        count = lines.known.sum(axis=1)
        middle = ratio.sum(axis=1) / count
        away = np.where(lines.known, np.abs(ratio - middle[:, None]) ** 2, 0.0)
        return np.asarray(np.sqrt(away.sum(axis=1) / np.where(count > 1, count - 1, np.nan)) / np.abs(middle))


def _expected(lines: SpectralLines, effective: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return the relative scatter that noise and floor explain, shape (L,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(lines.known, variance / np.abs(effective) ** 2, 0.0)
        return np.asarray(np.sqrt(relative.sum(axis=1) / lines.known.sum(axis=1)))
