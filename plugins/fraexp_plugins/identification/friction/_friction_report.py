"""The result of friction identification: elements, errors, metrics and curves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Curve, Finding, Fit, Metric, Outcome, Result, Signals
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification._shared.friction_curves import NORMAL_QUANTILE, virgin_curve
from fraexp_plugins.identification.friction._friction_regression import RegressionRows

MAX_ERROR, MAX_UNEXPLAINED_ERROR = 0.1, 0.03
"""Errors over the Coulomb force above which the model is wrong: in any case, and if noise does not explain it."""
MAX_NOISE_RATIO = 3.0
"""Error over that by the channels' noise up to which noise explains it."""
VIRGIN_CURVE_POINTS = 60
MAX_CURVE_SAMPLES = 2000
"""Samples of the curve of forces."""


@dataclass(frozen=True)
class ReportedElements:
    """Identified elements, and the terms that were identified with them."""

    stiffness: NDArray[np.float64]
    """K_i [N/m], shape (N,)."""
    limit_force: NDArray[np.float64]
    """F_mi [N], shape (N,)."""
    damping: NDArray[np.float64]
    """D_i [N s/m], shape (N,), or empty."""
    terms: Mapping[str, float]
    """Offset [N], asymmetry and viscous coefficient [N s/m] and mass [kg], those that were fitted or are known."""
    covariance: NDArray[np.float64]
    """Covariance of the K_i, F_mi, D_i and terms, in this order."""

    @property
    def virgin_curve(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return displacement x [m], g(x) = Σ K_i min(x, Y_i) [N] and its standard deviation [N], each (n,)."""
        widths = self.limit_force / self.stiffness
        x = np.unique(
            np.concatenate([np.geomspace(widths.min() / 10, 1.2 * widths.max(), VIRGIN_CURVE_POINTS), widths])
        )
        sticks = x[:, None] < widths
        gradient = np.concatenate([np.where(sticks, x[:, None], 0.0), np.where(sticks, 0.0, 1.0)], axis=1)
        force = gradient @ np.concatenate([self.stiffness, self.limit_force])
        size = gradient.shape[1]
        variance = np.einsum("ij,jk,ik->i", gradient, self.covariance[:size, :size], gradient)
        return x, force, np.sqrt(np.maximum(variance, 0.0))

    @property
    def coulomb(self) -> tuple[float, float]:
        """Return ΣF_mi [N] and its standard deviation."""
        size = self.limit_force.size
        block = self.covariance[size : 2 * size, size : 2 * size]
        return float(self.limit_force.sum()), float(np.sqrt(max(block.sum(), 0.0)))

    def std(self, term: str) -> float:
        """Return the standard deviation of a term."""
        place = len(self.covariance) - len(self.terms) + list(self.terms).index(term)
        return float(np.sqrt(max(self.covariance[place, place], 0.0)))


@dataclass(frozen=True)
class Errors:
    """The errors of the model's force."""

    fitted: float
    """Root mean square error over the cycles that were fitted [N]."""
    held_out: float
    """Root mean square error over the cycles that were held out [N]."""
    residuals: Sequence[NDArray[np.float64]]
    """Residuals of all rows of each record [N]."""

    @property
    def worst(self) -> float:
        """The larger of both errors."""
        return float(np.nanmax([self.fitted, self.held_out]))


def report(
    signals: Signals,
    found: ReportedElements,
    rows: Sequence[RegressionRows],
    errors: Errors,
    cycles: tuple[int, int],
    remarks: Sequence[Finding | str],
) -> Result:
    """Return the result: parameters, errors and energy as metrics, virgin curve and forces as curves, and the fit.

    `cycles` are the numbers of fitted and of held-out cycles.
    """
    metrics = [*_parameters(found), *_quality(found, rows, errors), *_counts(cycles, found), *_deviations(found)]
    curves = (virgin_curve(*found.virgin_curve), force_curve(rows, errors))
    outcome = outcome_of_fit(signals.outcome, found.coulomb[0], errors.worst)
    result = Result(outcome, signals.findings, metrics=tuple(metrics), curves=curves, fits=(rolling_fit(found),))
    return result.with_findings(*remarks)


def has_model_error(coulomb: float, error: float, noise: float) -> bool:
    """Return whether an error [N] is too large for a right model, given the error by the channels' noise [N]."""
    return error > MAX_ERROR * coulomb or error > max(MAX_UNEXPLAINED_ERROR * coulomb, MAX_NOISE_RATIO * noise)


def outcome_of_fit(outcome: Outcome, coulomb: float, error: float) -> Outcome:
    """Return the outcome of a fit: it is not ok if its parameters are unreliable."""
    return Outcome.INACCURATE if outcome is Outcome.OK and error > MAX_ERROR * coulomb else outcome


def model_error_remarks(coulomb: float, error: float, noise: float) -> list[str]:
    """Return a remark if an error [N] is too large for a right model with this Coulomb force [N]."""
    if not has_model_error(coulomb, error, noise):
        return []
    relative = error / coulomb
    causes = (
        "a standstill below the encoder's resolution, noise, another force or a wrong dead time; see the curve "
        "'friction force'"
    )
    if relative > MAX_ERROR:
        return [
            f"the error is {relative:.0%} of the Coulomb force, so its parameters are unreliable; possible causes: "
            f"{causes}"
        ]
    return [
        f"the error is {relative:.1%} of the Coulomb force, of which noise explains {noise / coulomb:.1g}: the "
        f"intervals are widened, but may not cover the true values; possible causes: {causes}"
    ]


UNITS = {"mass": "kg", "viscous": "N s/m", "offset": "N", "asymmetry": "N s/m"}
TITLES = {
    "mass": "mass",
    "viscous": "viscous coefficient",
    "offset": "offset",
    "asymmetry": "viscous asymmetry",
    "coulomb_force": "Coulomb force",
}


def _parameters(found: ReportedElements) -> list[Metric]:
    force = found.coulomb[0]
    stiffness = float(found.stiffness.sum())
    return [
        Metric("Coulomb force", force, "N"),
        Metric("presliding deflection", force / stiffness, "m"),
        *(Metric(TITLES[term], value, UNITS[term]) for term, value in found.terms.items()),
        Metric("presliding stiffness", stiffness, "N/m"),
    ]


def _deviations(found: ReportedElements) -> list[Metric]:
    terms = [Metric(f"{TITLES[term]}, 95 %", NORMAL_QUANTILE * found.std(term), UNITS[term]) for term in found.terms]
    return [Metric("Coulomb force, 95 %", NORMAL_QUANTILE * found.coulomb[1], "N"), *terms]


def _quality(found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors) -> list[Metric]:
    metrics = []
    if np.isfinite(errors.held_out):
        metrics.append(Metric("rms error, held-out cycles", errors.held_out, "N"))
    measured, model = energies(found, rows, errors)
    metrics += [Metric("energy per cycle", measured, "N m"), Metric("energy per cycle, model", model, "N m")]
    metrics.append(Metric("rms error, fitted cycles", errors.fitted, "N"))
    if np.isfinite(errors.held_out):
        share = errors.held_out / found.coulomb[0]
        metrics.append(Metric("rms error, held-out cycles, over the Coulomb force", share, "1"))
    return metrics


def energies(found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors) -> tuple[float, float]:
    """Return the friction's work per cycle [N m], measured and by the model."""
    measured = model = 0.0
    for each, residual in zip(rows, errors.residuals, strict=True):
        work = each.velocity * each.duration
        force = each.force - _inertia(found, each)
        measured += float(np.add.reduce(work * force))
        model += float(np.add.reduce(work * (force - residual)))
    sizes = np.unique(np.concatenate([each.cycle for each in rows]), return_counts=True)[1]
    count = float(sizes.sum() / np.median(sizes))  # only a part of the first cycle may be known
    return measured / count, model / count


def _inertia(found: ReportedElements, rows: RegressionRows) -> NDArray[np.float64]:
    if "mass" not in rows.names:
        return np.zeros_like(rows.force)
    return found.terms["mass"] * rows.columns[:, rows.names.index("mass")]


def _counts(cycles: tuple[int, int], found: ReportedElements) -> list[Metric]:
    return [
        Metric("elements", float(found.stiffness.size), "1"),
        Metric("cycles fitted", float(cycles[0]), "1"),
        Metric("cycles held out", float(cycles[1]), "1"),
    ]


def force_curve(rows: Sequence[RegressionRows], errors: Errors) -> Curve:
    """Return measured force and model over the first cycles."""
    first, residual = rows[0], errors.residuals[0]
    time = first.duration * np.arange(first.force.size)
    table = np.stack([time, first.force, first.force - residual])[:, :MAX_CURVE_SAMPLES]
    columns = dict(zip(("time", "force", "model"), table, strict=True))
    return Curve("friction force", columns, {"time": "s", "force": "N", "model": "N"})


def rolling_fit(found: ReportedElements) -> Fit:
    """Return the rolling model with the covariance of its parameters."""
    viscous = found.terms.get("viscous", 0.0)
    model = Rolling(
        stiffness=tuple(found.stiffness.tolist()),
        limit_force=tuple(found.limit_force.tolist()),
        damping=tuple(found.damping.tolist()),
        viscous_coefficient=viscous,
    )
    count = found.stiffness.size
    names = [f"stiffness.{number}" for number in range(count)] + [f"limit_force.{number}" for number in range(count)]
    names += [f"damping.{number}" for number in range(found.damping.size)]
    units = ["N/m"] * count + ["N"] * count + ["N s/m"] * found.damping.size
    values = [*found.stiffness, *found.limit_force, *found.damping]
    places = list(range(len(names)))
    if "viscous" in found.terms:
        names, units, values = [*names, "viscous_coefficient"], [*units, "N s/m"], [*values, viscous]
        places.append(len(found.covariance) - len(found.terms) + list(found.terms).index("viscous"))
    covariance = found.covariance[np.ix_(places, places)]
    return Fit("friction", model.spec(), tuple(names), tuple(units), np.array(values), covariance)
