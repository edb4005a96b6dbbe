"""Resonances and antiresonances of a fitted plant: frequency, damping ratio and magnitude with 95 % intervals."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve
from fraexp_plugins.identification.plant._shared.modal_doubts import MAX_PEAK_DAMPING, NORMAL_QUANTILE
from fraexp_plugins.identification.plant._shared.modal_model import ModalModel
from fraexp_plugins.identification.plant._shared.modal_solver import Solution

PairsOf = Callable[[ModalModel, NDArray[np.float64]], NDArray[np.float64]]
"""Returns natural frequency [Hz] and damping ratio of poles or zeros, shape (m, 2), for p."""
QUANTITIES = ("frequency", "Hz"), ("damping ratio", "1"), ("magnitude", "")
"""Columns and their units; that of the magnitude is the response's."""
DERIVATIVE_STEP = 1e-5
"""Step of p in central differences; all of p is of the order of 1."""


def extremum_curves(solution: Solution, unit: str) -> tuple[Curve, ...]:
    """Return the curves ``resonances`` and ``antiresonances`` in the frequency range, as far as there are any.

    Each has frequency, damping ratio and magnitude with the half widths of their 95 % intervals.
    """
    found = (("resonances", resonances), ("antiresonances", antiresonances))
    curves = (_curve(name, _with_intervals(solution, pairs), unit) for name, pairs in found)
    return tuple(curve for curve in curves if curve.columns["frequency"].size)


def resonances(model: ModalModel, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return natural frequency [Hz] and damping ratio of the poles of the modes, shape (m, 2)."""
    return model.poles(p)


def antiresonances(model: ModalModel, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return natural frequency [Hz] and damping ratio of the complex zeros, ascending, shape (m, 2).

    Without collocation a zero may lie to the right, with a negative damping ratio, or be real.
    """
    scale = 2 * np.pi * np.sqrt(model.min_frequency * model.max_frequency)
    poles = [np.array([1.0, model.rate(p) / scale, 0.0])]
    for frequency, zeta in model.poles(p):
        omega = 2 * np.pi * frequency / scale
        poles.append(np.array([1.0, 2 * zeta * omega, omega**2]))
    gains = np.concatenate([[1.0], p[3 : model.damping_place : 3]])
    zeros = np.roots(sum(_product(poles, at) * gain for at, gain in enumerate(gains)))
    upper = zeros[zeros.imag > 0]
    upper = upper[np.argsort(np.abs(upper))]
    return np.column_stack([np.abs(upper) * scale / (2 * np.pi), -upper.real / np.abs(upper)])


def _product(factors: list[NDArray[np.float64]], without: int) -> NDArray[np.float64]:
    """Return the product of all polynomials but one."""
    total = np.ones(1, dtype=np.float64)
    for at, factor in enumerate(factors):
        total = total if at == without else np.convolve(total, factor)
    return total


def _with_intervals(solution: Solution, pairs_of: PairsOf) -> NDArray[np.float64]:
    """Return frequency, damping ratio and magnitude within the range, each with its half width, shape (m, 6)."""
    model, p = solution.model, solution.p
    pairs = pairs_of(model, p)

    def log_values(moved: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithms of the values, shape (m, 3): relative errors are normal, and the values positive."""
        found = pairs_of(model, moved)
        nearest = found[np.abs(found[:, :1] - pairs[:, 0]).argmin(axis=0)]
        log_model = model.log_response(moved, 2j * np.pi * nearest[:, 0])
        return np.column_stack([np.log(nearest), log_model.real])

    is_known = (pairs[:, 0] >= model.min_frequency) & (pairs[:, 0] <= model.max_frequency)
    is_known &= (pairs[:, 1] > 0) & (pairs[:, 1] < MAX_PEAK_DAMPING)
    pairs = pairs[is_known]
    if not pairs.size:
        return np.empty((0, 6))
    steps = DERIVATIVE_STEP * np.eye(p.size)
    slopes = np.array([log_values(p + step) - log_values(p - step) for step in steps]) / (2 * DERIVATIVE_STEP)
    variance = np.einsum("pmi,pq,qmi->mi", slopes, solution.reported_covariance, slopes)
    values = np.exp(log_values(p))
    return np.concatenate([values, NORMAL_QUANTILE * np.sqrt(variance) * values], axis=1)


def _curve(name: str, rows: NDArray[np.float64], unit: str) -> Curve:
    columns: dict[str, NDArray[np.float64]] = {}
    for at, (quantity, _) in enumerate(QUANTITIES):
        columns |= {quantity: rows[:, at], f"{quantity}, ± 95 %": rows[:, at + len(QUANTITIES)]}
    units = {quantity: own or unit for quantity, own in QUANTITIES}
    return Curve(name, columns, {column: units[column.partition(",")[0]] for column in columns})
