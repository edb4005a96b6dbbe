"""The weighted log-residual least-squares fit of a modal model, with the covariance of its parameters."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CURVE_POINTS,
    MAX_ITERATIONS,
    NORMAL_QUANTILE,
    ROUNDING,
    SIGNIFICANCE,
    RecordError,
    significant_deviation,
)
from fraexp_plugins.identification._least_squares import inverse_square, minimise
from fraexp_plugins.identification._modal_model import FREQUENCY_MARGIN, LogResponse, ModalModel, resonators


def whiteness(residuals: NDArray[np.float64], parts: int) -> float:
    """Return the probability that white residuals are as correlated as these or more: small for a wrong model.

    `residuals` holds n real parts, and n imaginary ones if there are two parts. The portmanteau statistic
    n(n + 2) Σ |ρ_k|²/(n - k) over the first lags, doubled for circular complex residuals, is χ² distributed with one
    degree of freedom for each lag and part: G. M. Ljung and G. E. P. Box, Biometrika 65(2), 1978,
    doi 10.1093/biomet/65.2.297.
    """
    from scipy.special import chdtrc  # slow to import: only when something is estimated

    values = _as_sequence(residuals, parts)
    n = values.size
    power = float(np.sum(np.abs(values) ** 2))
    lags = min(10, n // 4)
    if power == 0 or lags == 0:
        return float("nan")
    statistic = 0.0
    for lag in range(1, lags + 1):
        correlation = np.sum(values[lag:] * np.conj(values[:-lag])) / power
        statistic += abs(correlation) ** 2 / (n - lag)
    return float(chdtrc(parts * lags, parts * n * (n + 2) * statistic))


def neighbour_correlation(residuals: NDArray[np.float64], parts: int) -> tuple[float, float]:
    """Return the correlation of neighbouring residuals, and the probability of this or a larger one if they are white.

    The correlation of n white residuals is normally distributed with the variance 1/(parts n).
    """
    from scipy.special import ndtr

    values = _as_sequence(residuals, parts)
    power = float(np.sum(np.abs(values) ** 2))
    if power == 0:
        return 0.0, 1.0
    correlation = float(np.sum((values[1:] * np.conj(values[:-1])).real)) / power
    return correlation, float(ndtr(-correlation * np.sqrt(parts * values.size)))


def _as_sequence(residuals: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    rows = residuals.reshape(parts, -1)
    return rows[0] + 1j * rows[1] if parts == 2 else rows[0]


MAX_DELAY_TURNS, STEPS_PER_TURN = 2, 4
"""Largest dead time that is tried, in turns of the phase at the upper frequency limit, and steps for each turn."""
LOW_FREQUENCY_RATIO = 10.0
"""Range in frequency of the lowest points, from which the forces of ground are guessed."""
FIRST_DAMPING_RATIO, RELOCATIONS = 0.02, 5
"""Damping ratio of the poles with which a search begins, and how often they are moved."""


class ModelEnd(NamedTuple):
    """What acts beside rigid body and modes."""

    ground: NDArray[np.float64]
    """Forces of ground [N s/m, N/m], as many as are free."""
    ground_std: NDArray[np.float64]
    """Their standard deviations."""
    delay: float
    """Dead time [s]."""
    lag: float = 0.0
    """Time constant [s]."""


def start_vectors(
    model: ModalModel, data: LogResponse, end: ModelEnd, poles: NDArray[np.float64], relocations: int = RELOCATIONS
) -> Iterator[NDArray[np.float64]]:
    """Yield the start vector p to which poles (f [Hz], ζ), shape (model.modes, 2), lead, if its k0 is positive.

    For given poles, ground and dead time the response is linear in k0 and k0 r_i. Relative errors are weighted, so that
    antiresonances tell as much as resonances.
    """
    undelayed = data.response * np.exp(data.s * end.delay) * (1 + data.s * end.lag)
    # k0 S = G/(1 - (D s + K) G): as an equation for S that is linear, and does not divide by a small difference
    factor = 1 - model.ground_columns(data.s) @ end.ground * undelayed
    doubt = np.abs(model.ground_columns(data.s)) @ end.ground_std * np.abs(undelayed / factor)
    error = np.sqrt(1 / data.weight + doubt**2)
    weight = 1 / (np.abs(data.response) * error)
    found = _relocated(data.s, undelayed, factor, weight, poles, relocations)
    rows = np.vstack([1 / data.s**2, resonators(data.s, 2 * np.pi * found[:, 0], found[:, 1])])
    gains = _coefficients(_real(rows * weight * factor), _real(undelayed * weight))
    if gains[0] > 0:
        yield _vector(model, gains, found, end)


def _relocated(
    s: NDArray[np.complex128],
    response: NDArray[np.complex128],
    factor: NDArray[np.complex128],
    weight: NDArray[np.float64],
    poles: NDArray[np.float64],
    relocations: int,
) -> NDArray[np.float64]:
    """Return the poles (f [Hz], ζ), shape (m, 2), of a rational function like response/factor, from poles near them.

    Vector fitting: B. Gustavsen and A. Semlyen, IEEE Trans. Power Delivery 14(3), 1999, doi 10.1109/61.772353. With
    known poles numerator and denominator are linear in the residues; the zeros of the denominator are the next poles.
    Pairs of poles are those of s² + a s + b, so that real ones are no exception.
    """
    size, unit = len(poles), float(np.abs(s).max())
    s = s / unit
    omega, zeta = 2 * np.pi * poles[:, 0] / unit, poles[:, 1]
    for _ in range(relocations if size else 0):
        squares, dampings = omega**2, 2 * zeta * omega
        simple = resonators(s, omega, zeta)
        basis = np.concatenate([simple, s * simple])
        rows: NDArray[np.complex128] = np.concatenate(
            [np.stack([1 / s**2, 1 / s]) * factor, basis * factor, -response * basis]
        )
        of_zeros = _coefficients(_real(rows * weight), _real(response * weight))[-2 * size :]
        chain = np.block([[np.zeros((size, size)), np.eye(size)], [-np.diag(squares), -np.diag(dampings)]])
        chain[size:] -= of_zeros
        omega, zeta = _pairs(np.linalg.eigvals(chain))
    return np.column_stack([omega * unit / (2 * np.pi), zeta])


def _pairs(roots: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return natural frequencies and damping ratios > 0 of the conjugate pairs of roots, then of pairs of real ones."""
    upper, real = roots[roots.imag > 0], np.sort(np.abs(roots[roots.imag == 0].real))
    omega = np.concatenate([np.abs(upper), np.sqrt(real[::2] * real[1::2])])
    half = np.concatenate([np.abs(upper.real), (real[::2] + real[1::2]) / 2])
    omega = np.maximum(omega, ROUNDING)
    return omega, np.maximum(half / omega, ROUNDING)


def _real(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return real parts and then imaginary parts along the last axis."""
    return np.concatenate([values.real, values.imag], axis=-1)


def _ends(model: ModalModel, data: LogResponse) -> Iterator[ModelEnd]:
    """Yield the ends to try: each dead time without ground, and with the ground that the lowest points show.

    A lag is tried in place of a dead time as long.
    """
    lags = (0.0, model.time_unit) if model.time_constant is None else (0.0,)
    for delay, lag in product(_dead_times(model, data), lags):
        yield ModelEnd(np.zeros(len(model.ground)), np.zeros(len(model.ground)), delay - lag, lag)
        if model.ground:
            yield ModelEnd(*low_ground(model, data, delay), delay - lag, lag)


def _dead_times(model: ModalModel, data: LogResponse) -> list[float]:
    """Return the dead times [s] to try."""
    if model.dead_time is not None:
        return [model.dead_time]
    steps = np.arange(-1, MAX_DELAY_TURNS * STEPS_PER_TURN + 1) / (STEPS_PER_TURN * data.frequency[-1])
    return [float(each) for each in steps]


def low_ground(
    model: ModalModel, data: LogResponse, delay: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ground in 1/G = K + D s + m s² + c s³ at the lowest points, and its standard deviations.

    No mode is near them. Beyond what noise explains the residuals count as errors.
    """
    count = len(model.ground)
    points = int(np.sum(data.frequency < LOW_FREQUENCY_RATIO * data.frequency[0]))
    low = slice(max(points, 2 * (count + 2)))  # twice as many as there are numbers
    s, inverse = data.s[low], np.exp(-data.s[low] * delay) / data.response[low]
    weight = np.sqrt(data.weight[low]) / np.abs(inverse)
    series = np.stack([s**2, s**3], axis=1)
    powers: NDArray[np.complex128] = np.concatenate([model.ground_columns(s), series], axis=1)
    columns = _real((powers * weight[:, None]).T).T
    scale, target = np.linalg.norm(columns, axis=0), _real(inverse * weight)
    solver = np.linalg.pinv(columns / scale) / scale[:, None]
    residual = target - columns @ (solver @ target)
    spread = float(np.sum(residual**2)) / max(target.size - scale.size, 1)
    spread = spread if data.covariance is None else max(spread, 1.0)
    return (solver @ target)[:count], np.sqrt(spread) * np.linalg.norm(solver[:count], axis=1)


def _coefficients(basis: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    scale = np.linalg.norm(basis, axis=1)
    coefficients, *_ = np.linalg.lstsq((basis / scale[:, None]).T, target, rcond=None)
    return np.asarray(coefficients / scale)


def _vector(
    model: ModalModel, gains: NDArray[np.float64], poles: NDArray[np.float64], end: ModelEnd
) -> NDArray[np.float64]:
    modes = np.column_stack([np.log(poles), gains[1:] / gains[0]])
    known = {"dead_time": end.delay, "time_constant": end.lag}
    path = [known[name] / model.time_unit for name in model.path]
    ground = end.ground * gains[0] / model.ground_units
    return model.sort_modes(np.concatenate([[np.log(gains[0])], modes.ravel(), ground, path]))


TRIALS = 2
"""Trial fits from each way to a start, of which only the best one goes on."""


@dataclass(frozen=True)
class Solution:
    """A least-squares fit: the vector p of a model, and its residuals."""

    model: ModalModel
    data: LogResponse
    p: NDArray[np.float64]

    @property
    def poles(self) -> NDArray[np.float64]:
        """Pairs (f [Hz], ζ) of the modes, shape (modes, 2)."""
        return self.model.poles(self.p)

    @cached_property
    def error(self) -> NDArray[np.complex128]:
        """ln(G_m/Ĝ), complex, shape (n,)."""
        return self.data.error(self.model.log_response(self.p, self.data.s))

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squared errors Σ w|e|²."""
        return float(np.sum(self.data.weighted_parts(self.error) ** 2))

    @cached_property
    def jacobian(self) -> NDArray[np.float64]:
        """Weighted derivative of the residuals by p, shape (count, size)."""
        return self.data.weighted_parts(self.model.jacobian(self.p, self.data.s))

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of p, shape (size, size): A⁻¹ B A⁻¹ with A = JᵀWJ and B = JᵀW C W J, common errors included.

        If the covariance C of the response is unknown, the residuals give it. If the residuals exceed by far what C
        explains, the model is wrong, and C is scaled up to them. Residuals that are correlated with their neighbours
        count as fewer.
        """
        if self.data.covariance is None:
            return self._inverse * self.excess * self.correlation_factor
        middle = self.data.scatter(self.model.jacobian(self.p, self.data.s))
        middle = middle * (self.excess if self.has_model_error else 1.0) * self.correlation_factor
        common = self.jacobian.T @ self.data.weighted_parts(self.data.common)
        return self._inverse @ (middle + common @ common.T) @ self._inverse

    @property
    def reported_covariance(self) -> NDArray[np.float64]:
        """Covariance of p with the part of the model's error that may hide in the parameters, shape (size, size).

        An error of the model is not noise and does not average out: as much of it may be in the parameters as in the
        residuals, so that the residuals count as one for each parameter.
        """
        per_parameter = self.data.count / self.model.size
        if self.exceeds_noise:
            return self.covariance * max(per_parameter / self.correlation_factor, 1.0)
        if not self.has_model_error:
            return self.covariance
        return self.covariance + self._inverse * (self.excess - 1) * self.data.expected / self.model.size

    @property
    def residual(self) -> float:
        """Root mean square of ln(G_m/Ĝ), of its real part if only the magnitude is fitted."""
        error = np.stack([self.error.real, self.error.imag][: self.data.parts])
        return float(np.sqrt(np.mean(np.sum(error**2, axis=0))))

    @property
    def unexplained(self) -> float:
        """The part of the residual that noise does not explain; 0 where it may explain all of it."""
        if not (self.has_model_error or self.exceeds_noise):
            return 0.0
        noise = float(np.mean(np.sum(self.data.variances, axis=1)))
        return float(np.sqrt(max(self.residual**2 - noise, 0.0)))

    @property
    def exceeds_noise(self) -> bool:
        """Whether the residual is no noise, if the covariance of the response is unknown."""
        return self.data.covariance is None and self.whiteness < SIGNIFICANCE

    @cached_property
    def whiteness(self) -> float:
        """Probability of residuals as correlated along the frequencies as these, if they are noise."""
        return whiteness(self.data.weighted_parts(self.error), self.data.parts)

    @cached_property
    def jackknife(self) -> NDArray[np.float64]:
        """Covariance of p by leaving out one point after the other, to first order, shape (size, size).

        Unlike `covariance` it depends on where the residuals are large, and on parameters that a few points determine:
        J. G. MacKinnon and H. White, J. Econometrics 29(3), 1985, doi 10.1016/0304-4076(85)90158-7.
        """
        parts, points = self.data.parts, self.data.frequency.size
        rows = self.jacobian.reshape(parts, points, -1).swapaxes(0, 1)
        errors = self.data.weighted_parts(self.error).reshape(parts, points).T
        leverage = rows @ self._inverse @ rows.swapaxes(1, 2)  # the leverage of a point
        left_out = np.linalg.solve((1 + ROUNDING) * np.eye(parts) - leverage, errors[:, :, None])
        moves = (rows.swapaxes(1, 2) @ left_out)[:, :, 0] @ self._inverse
        return np.asarray(moves.T @ moves)

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """A⁻¹, shape (size, size)."""
        return inverse_square(self.jacobian)

    @cached_property
    def correlation_factor(self) -> float:
        """Number of residuals that count as one: (1 + ρ)/(1 - ρ) with the correlation ρ of neighbours, if significant.

        G. V. Bayley and J. M. Hammersley, J. R. Statistical Society Supplement 8(2), 1946, doi 10.2307/2983560.
        """
        correlation, probability = neighbour_correlation(self.data.weighted_parts(self.error), self.data.parts)
        return (1 + correlation) / (1 - correlation) if correlation > 0 and probability < SIGNIFICANCE else 1.0

    @property
    def excess(self) -> float:
        """Cost over its expectation by the known covariance; over the degrees of freedom if that is unknown."""
        freedom = self.data.count - self.model.size
        return self.cost / max(self.data.expected * freedom / self.data.count, 1e-300)

    @property
    def has_model_error(self) -> bool:
        """Whether the cost is higher than noise explains."""
        from scipy.special import chdtri

        is_known = self.data.covariance is not None
        return is_known and self.excess > chdtri(self.data.count, SIGNIFICANCE) / self.data.count

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the parameters that are not identifiable from the data.

        These are singular combinations, parameters at their limits, and modal gains k0 r_i that white noise may cause:
        noise always looks like a mode at one of all the frequencies that are tried, as many as a curve has points.
        """
        names = self.model.names()
        scale = np.linalg.norm(self.jacobian, axis=0)
        if not scale.all():
            return tuple(name for name, size in zip(names, scale, strict=True) if size == 0)
        _, singular, right = np.linalg.svd(self.jacobian / scale, full_matrices=False)
        if singular[-1] < ROUNDING * singular[0]:
            return tuple(name for name, part in zip(names, np.abs(right[-1]), strict=True) if part > 0.1)
        low, high = self.model.bounds()
        near = (self.p < low + 1e-3) | (self.p > high - 1e-3)
        for place in range(3, self.model.ground_place, 3):
            slope = np.zeros(self.p.size)
            slope[0], slope[place] = self.p[place], 1.0  # of k0 r, over k0
            near[place] |= abs(self.p[place]) < significant_deviation(CURVE_POINTS) * np.sqrt(
                slope @ self.covariance @ slope / self.correlation_factor
            )
        return tuple(name for name, is_near in zip(names, near, strict=True) if is_near)


def solve(model: ModalModel, data: LogResponse, before: Solution | None = None) -> Solution:
    """Return the best fit from its own start values and from those of a fit with fewer modes."""
    p, has_converged = descend(model, data, _search(model, data.search_points(CURVE_POINTS), before))
    if not has_converged:
        raise RecordError(
            f"modal_fit: the fit of {count_text(model.modes, 'mode')} does not converge; "
            "use fewer modes, or another frequency range (min_frequency, max_frequency)"
        )
    return Solution(model, data, model.sort_modes(p))


def _search(model: ModalModel, data: LogResponse, before: Solution | None) -> NDArray[np.float64]:
    """Return the best p of a search."""
    spread = np.geomspace(data.frequency[0], data.frequency[-1], 2 * model.modes + 1)[1::2]
    even = np.column_stack([spread, np.full(spread.size, FIRST_DAMPING_RATIO)])
    ways = [[p for end in _ends(model, data) for p in start_vectors(model, data, end, even)]]
    if before is not None:
        forces = before.model.ground_forces(before.p)
        end = ModelEnd(forces, np.zeros(forces.size), before.model.delay(before.p), before.model.lag(before.p))
        outside = np.array([[np.sqrt(FREQUENCY_MARGIN) * data.frequency[-1], FIRST_DAMPING_RATIO]])
        for added, relocations in ((even, RELOCATIONS), (outside, 0)):
            extended = [np.concatenate([before.poles, [pole] * (model.modes - len(before.poles))]) for pole in added]
            ways.append([p for poles in extended for p in start_vectors(model, data, end, poles, relocations)])
    return _best(model, data, [p for tried in ways for p in _ordered(model, data, tried)[:TRIALS]])


def _ordered(model: ModalModel, data: LogResponse, tried: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return vectors p, that of least cost first."""
    return sorted(tried, key=lambda p: Solution(model, data, p).cost)


def count_text(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}" + "s" * (number != 1)


def _best(model: ModalModel, data: LogResponse, tried: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the best p to which some start values lead."""
    if not tried:
        raise RecordError(
            "modal_fit: no start value has a positive rigid-body gain; expected position over force: change the sign "
            "of a channel, or choose a narrower frequency range"
        )
    low, high = model.bounds()
    followed = [descend(model, data, np.clip(p, low + 1e-2, high - 1e-2), MAX_ITERATIONS)[0] for p in tried]
    return _ordered(model, data, followed)[0]


def descend(
    model: ModalModel, data: LogResponse, p: NDArray[np.float64], evaluations: int | None = None
) -> tuple[NDArray[np.float64], bool]:
    """Return where least squares lead from p, and whether they have converged: in 100 evaluations for each number."""
    return minimise(
        lambda p: data.weighted_parts(data.error(model.log_response(p, data.s))),
        p,
        model.bounds(),
        evaluations,
        lambda p: data.weighted_parts(model.jacobian(p, data.s)),
    )


MAX_PEAK_DAMPING = np.sqrt(0.5)
"""Damping ratio from which a mode has no resonance peak: such a mode follows the remains of friction."""
MAX_OUTSIDE_FREQUENCY_ERROR = 0.05
"""Relative half width of the 95 % interval of a natural frequency up to which it may lie outside of the range."""


def unsupported_parts(solution: Solution) -> tuple[str, ...]:
    """Return rigid body and modes that the data do not support, each with the reason; empty if they support all.

    A modal gain ratio must be significant with points left out too; otherwise scatter at a few points makes a mode.
    A mode outside of the frequency range is supported if its natural frequency is known to 5 %, with points left out
    too, as that of a mode whose antiresonance lies within the range is.
    """
    if any(name == "rigid_body_gain" or "." not in name for name in solution.unidentifiable):
        return (f"an estimate of {', '.join(solution.unidentifiable)}",)
    return (*_rigid_body(solution), *_modes(solution))


def _rigid_body(solution: Solution) -> Iterator[str]:
    std = np.sqrt(solution.covariance[0, 0])
    if std * significant_deviation() > 1:
        gain = np.exp(solution.p[0])
        yield f"a rigid body (k0 = {gain:.2g} ± {NORMAL_QUANTILE * gain * std:.1g}: may be 0)"


def _modes(solution: Solution) -> Iterator[str]:
    model, axes = solution.model, np.eye(solution.p.size)
    for number, (frequency, zeta) in enumerate(model.poles(solution.p)):
        place = 1 + 3 * number
        ratio = solution.p[place + 2]
        half = NORMAL_QUANTILE * zeta * np.sqrt(max(solution.covariance[place + 1, place + 1], 0.0))
        scatter = _std(solution, axes[place + 2] + ratio * axes[0])  # of k0 r, over k0
        uncertainty = NORMAL_QUANTILE * _std(solution, axes[place])
        is_outside = not model.min_frequency <= frequency <= model.max_frequency
        if is_outside and not uncertainty <= MAX_OUTSIDE_FREQUENCY_ERROR:
            why = f"outside of {model.min_frequency:.4g} to {model.max_frequency:.4g} Hz, and uncertain"
            why += f" by {uncertainty:.0%}" if uncertainty < 1 else ""
        elif f"modal_gain_ratios.{number}" in solution.unidentifiable or abs(ratio) < significant_deviation() * scatter:
            why = f"its modal gain ratio {ratio:.2g} ± {NORMAL_QUANTILE * scatter:.1g} may be noise"
        elif zeta <= half:
            why = f"its damping ratio {zeta:.2g} ± {half:.1g} may be 0"
        elif zeta + half >= MAX_PEAK_DAMPING:
            why = f"its damping ratio {zeta:.2g} ± {half:.1g} may leave no resonance peak"
        else:
            continue
        yield f"a mode at {frequency:.4g} Hz ({why})"


def shows_lag(solution: Solution) -> bool:
    """Return whether the time constant of a fit is significantly above 0, with points left out too."""
    return bool(solution.p[-1] > significant_deviation() * _std(solution, np.eye(solution.p.size)[-1]))


def _std(solution: Solution, slope: NDArray[np.float64]) -> float:
    """Return the standard deviation of a quantity from its slope by p, shape (size,), with points left out too."""
    return float(np.sqrt(max(slope @ solution.covariance @ slope, slope @ solution.jackknife @ slope)))


EXTRA_MODES = 2
"""Modes that are tried after one that did not help: two modes close together may help only as a pair."""


def mode_limit(data: LogResponse, model: ModalModel) -> int:
    """Return the largest number of modes that the points can determine; -1 if they are too few for a rigid body.

    A mode needs two points of its own, and two residuals must remain.
    """
    rest = replace(model, modes=0).size
    return max(min((data.frequency.size - 3) // 2, (data.count - 2 - rest) // 3), -1)


def information_criterion(solution: Solution, correlation_factor: float = 1.0) -> float:
    """Return the extended Bayesian information criterion: M ln(χ²/M) + p ln M + 2 m ln n of m modes, M residuals.

    The last term is the price of the search: the best of n places always explains some noise. J. Chen and Z. Chen,
    Biometrika 95(3), 2008, doi 10.1093/biomet/asn034. A cost below the expectation by noise is no gain.
    `correlation_factor` is the number of correlated residuals that count as one.
    """
    data, size = solution.data, solution.model.size
    cost, count = max(solution.cost, data.expected), data.count / correlation_factor
    price = size * np.log(max(count, math.e)) + 2 * solution.model.modes * np.log(data.frequency.size)
    return float(count * np.log(cost / data.count) + price)


def chosen_order(model: ModalModel, data: LogResponse, max_order: int) -> tuple[Solution | None, str]:
    """Return the fit with the smallest information criterion among those whose modes the data support, None if none.

    With it comes what the data do not support in fits with smaller ones, and why. Each fit starts from the last.
    """
    found: list[Solution] = []
    for modes in range(max_order + 1):
        try:
            found.append(solve(replace(model, modes=modes), data, found[-1] if found else None))
        except RecordError:  # the fit with one mode more may succeed
            continue
        if modes >= min(found, key=information_criterion).model.modes + EXTRA_MODES:
            break
    factor = min(found, key=information_criterion).correlation_factor if found else 1.0
    fewest: tuple[str, ...] = ()
    for solution in sorted(found, key=lambda one: information_criterion(one, factor)):
        unsupported = unsupported_parts(solution)
        if not unsupported:
            return solution, "; ".join(fewest)
        fewest = unsupported if not fewest or len(unsupported) < len(fewest) else fewest
    return None, "; ".join(fewest)


def fit_of_order(model: ModalModel, data: LogResponse) -> Solution:
    """Return the fit of model.modes modes; RecordError if the data determine fewer."""
    if model.modes == 0:
        return solve(model, data)
    try:
        fewer = solve(replace(model, modes=model.modes - 1), data)
    except RecordError:  # only this number of modes has to succeed
        return solve(model, data)
    solution = solve(model, data, fewer)
    if information_criterion(fewer) <= information_criterion(solution):
        raise RecordError(
            f"modal_fit: the response supports fewer than {count_text(model.modes, 'mode')}: the last one improves the "
            f"fit no more than noise; set modes to {fewer.model.modes} or less, or leave it out"
        )
    return solution
