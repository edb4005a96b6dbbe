"""The friction elements with which P̂ is the same in all records: a convex problem without start values."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.autonomous._autonomous_lines import SpectralLines

PRIOR_FORCE_RATIO = 0.3
"""Prior standard deviation of ΣF_m over the peak thrust, for independent elements."""
FREE_BODY_TERMS = 4
"""Terms of the power series of 1/P̂ far below the first mode."""
NEIGHBOURHOOD = 3
"""Places on the grid around an element at which another one may be in its place."""


@dataclass(frozen=True)
class AutonomousElements:
    """Stiffnesses on a grid of thresholds, and the inverse plant 1/P̂ beside them at each line."""

    thresholds: NDArray[np.float64]
    """Y_i [m], ascending, shape (N,)."""
    stiffness: NDArray[np.float64]
    """K_i [N/m], shape (N,); most are 0."""
    covariance: NDArray[np.float64]
    """Covariance of K_i [N²/m²], shape (N, N)."""
    inverse: NDArray[np.complex128]
    """1/P̂ [N/m], complex, shape (L,)."""
    slopes: NDArray[np.complex128]
    """∂(1/P̂)/∂K_i, complex, shape (L, N)."""
    noise: NDArray[np.float64]
    """E|d(1/P̂)|² by noise [N²/m²], shape (L,)."""
    excess: float
    """Sum of squares over its expectation by noise and model error."""
    scatter: NDArray[np.float64]
    """Relative scatter of Y/Û_e over the records, shape (L,); NaN if there is one record."""
    noise_floor: NDArray[np.float64]
    """The relative scatter that noise explains, shape (L,)."""

    @property
    def forces(self) -> NDArray[np.float64]:
        """F_mi [N], shape (N,)."""
        return self.stiffness * self.thresholds

    @cached_property
    def error_columns(self) -> NDArray[np.float64]:
        """Errors of K_i [N/m], one standard deviation in each of uncorrelated directions, shape (N, N)."""
        values, vectors = np.linalg.eigh(self.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    @property
    def inverse_columns(self) -> NDArray[np.complex128]:
        """The effect of these errors on 1/P̂ [N/m], complex, shape (L, N)."""
        return self.slopes @ self.error_columns

    @cached_property
    def merge_matrix(self) -> NDArray[np.float64]:
        """The element of the model to which each place of the grid belongs, shape (n, N) of 0 and 1.

        An element between two thresholds of the grid appears at both: neighbours are one element.
        """
        places = np.flatnonzero(self.stiffness)
        runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
        pairs = [run[first : first + 2] for run in runs for first in range(0, run.size, 2)]
        return np.array([np.isin(np.arange(self.stiffness.size), pair) for pair in pairs], dtype=float)

    @property
    def model_values(self) -> NDArray[np.float64]:
        """K_i, then F_mi of the merged elements, shape (2 n,)."""
        return np.concatenate([self.merge_matrix @ self.stiffness, self.merge_matrix @ self.forces])

    @property
    def model_covariance(self) -> NDArray[np.float64]:
        """Covariance of `model_values`, shape (2 n, 2 n)."""
        linear = np.concatenate([self.merge_matrix, self.merge_matrix * self.thresholds])
        return linear @ self.covariance @ linear.T

    def model(self) -> Rolling:
        """Return the friction model."""
        stiffness, force = np.split(self.model_values, 2)
        return Rolling(stiffness=stiffness.tolist(), limit_force=force.tolist())

    def virgin_curve(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return g(x) = Σ K_i min(x, Y_i) [N] and its standard deviation at x [m], each of the shape of x."""
        deflection = np.minimum(x[:, None], self.thresholds)
        variance = np.einsum("ij,jk,ik->i", deflection, self.covariance, deflection)
        return deflection @ self.stiffness, np.sqrt(np.maximum(variance, 0.0))

    @property
    def coulomb(self) -> tuple[float, float]:
        """ΣF_m [N] and its standard deviation."""
        force, std = self.virgin_curve(self.thresholds[-1:])
        return float(force[0]), float(std[0])


@dataclass(frozen=True)
class ProjectedProblem:
    """The weighted equations of all records in the coefficients alone: 1/P̂ is linear, and projected out."""

    matrix: NDArray[np.float64]
    """Shape (2 L M, N)."""
    target: NDArray[np.float64]
    """Shape (2 L M,)."""
    offset: NDArray[np.complex128]
    """1/P̂ without friction [N/m], complex, shape (L,)."""
    slopes: NDArray[np.complex128]
    """Its derivative by the coefficients, complex, shape (L, N)."""
    power: NDArray[np.float64]
    """Sum of the weighted squares of the motion, shape (L,)."""

    @classmethod
    def of_lines(cls, lines: SpectralLines, total: NDArray[np.float64]) -> "ProjectedProblem":
        """Return the problem with variances `total` [N²], shape (L, M)."""
        weight = np.where(lines.known, 1 / np.sqrt(np.where(lines.known, total, 1.0)), 0.0)
        u, y, z = weight * lines.thrust, weight * lines.motion, weight[..., None] * lines.deflection
        power = np.sum(np.abs(y) ** 2, axis=1)
        projection = np.conj(y) / power[:, None]
        slopes, offset = -np.einsum("la,lan->ln", projection, z), np.sum(projection * u, axis=1)
        matrix = _real_and_imaginary((z + y[..., None] * slopes[:, None]).reshape(-1, z.shape[-1]))
        return cls(matrix, _real_and_imaginary((u - y * offset[:, None]).ravel()), offset, slopes, power)

    def with_free_body(self, frequency: NDArray[np.float64], places: NDArray[np.int64]) -> "ProjectedProblem":
        """Return the problem with equations that the axis is a free body at lines in these places, frequencies in Hz.

        1/P̂ is the series D s + m s² + c s³ + ... far below the first mode, without a spring. Its coefficients are
        projected out, too.
        """
        weight, s = np.sqrt(self.power[places, None]), 1j * frequency[places, None] / frequency[places].max()
        inverse = np.column_stack([-self.slopes[places], self.offset[places]])
        rows = _real_and_imaginary(weight * inverse)
        series, _ = np.linalg.qr(_real_and_imaginary(weight * s ** np.arange(1, FREE_BODY_TERMS + 1)))
        rows -= series @ (series.T @ rows)
        return replace(
            self, matrix=np.concatenate([self.matrix, rows[:, :-1]]), target=np.append(self.target, rows[:, -1])
        )


def fit_elements(
    lines: SpectralLines, thresholds: NDArray[np.float64], total: NDArray[np.float64], peak: float
) -> AutonomousElements:
    """Return the elements with Σ w_a |G U_a - Σ K_i Z_i,a - Y_a/P̂|² least over K_i >= 0 and 1/P̂ at each line.

    1/P̂ is linear and is eliminated by projection, which leaves a non-negative least-squares problem. `total` is the
    variance 1/w_a [N²], shape (L, M), and `peak` the peak thrust [N]: it bounds each F_mi that the records do not
    determine, such as that of elements that hardly slip (ridge regression: A. E. Hoerl and R. W. Kennard, Technometrics
    12(1), 1970, doi 10.1080/00401706.1970.10488634).
    """
    from scipy.optimize import nnls  # slow to import: only when something is estimated

    problem = ProjectedProblem.of_lines(lines, total)
    slopes, matrix, target = problem.slopes, problem.matrix, problem.target
    prior = PRIOR_FORCE_RATIO * peak / np.sqrt(thresholds.size) / thresholds
    scaled = np.concatenate([matrix * prior, np.eye(thresholds.size)])
    relative, _ = nnls(scaled, np.append(target, np.zeros(thresholds.size)), maxiter=100 * thresholds.size)
    stiffness = relative * prior
    inverse = problem.offset + slopes @ stiffness
    inner = scaled[: len(matrix)].T @ scaled[: len(matrix)]
    used = float(np.trace(np.linalg.solve(inner + np.eye(thresholds.size), inner)))  # effective number of parameters
    cost = float(np.sum((matrix @ stiffness - target) ** 2))
    excess = cost / max(lines.equations - used, 1.0)
    possible = _possible_places(stiffness)
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
        max(excess, 1.0) / problem.power,
        excess,
        relative_scatter(lines, effective),
        _noise_floor(lines, effective, total),
    )


def _possible_places(stiffness: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the places of possible elements: those found, and their neighbours, which fit nearly as well.

    The stiffness of all others is 0: it cannot be smaller, and the records would differ more if it were larger.
    """
    found = np.flatnonzero(stiffness)
    near = np.unique(found[:, None] + np.arange(-NEIGHBOURHOOD, NEIGHBOURHOOD + 1))
    return near[(near >= 0) & (near < stiffness.size)]


def _real_and_imaginary(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([values.real, values.imag])


def relative_scatter(lines: SpectralLines, effective: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the relative scatter of Y/U over the records at each line, shape (L,), for inputs [N]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(lines.known, lines.motion / effective, 0)
        count = lines.known.sum(axis=1)
        middle = ratio.sum(axis=1) / count
        squares = np.where(lines.known, np.abs(ratio - middle[:, None]) ** 2, 0.0)
        return np.asarray(np.sqrt(squares.sum(axis=1) / np.where(count > 1, count - 1, np.nan)) / np.abs(middle))


def _noise_floor(
    lines: SpectralLines, effective: NDArray[np.complex128], variance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the relative scatter that noise and model error explain, shape (L,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(lines.known, variance / np.abs(effective) ** 2, 0.0)
        return np.asarray(np.sqrt(relative.sum(axis=1) / lines.known.sum(axis=1)))
