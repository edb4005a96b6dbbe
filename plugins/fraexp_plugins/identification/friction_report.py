"""What friction identification reports, whichever way the elements were found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fraexp.api import Curve, Fit, Metric, Result, Signals
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.friction_regression import RegressionRows

NORMAL = 1.959963984540054
"""Standard deviations on either side of a 95 % interval."""
UNEXPLAINED, DOUBTED = 0.1, 0.03
"""Error over the Coulomb force from which the model is not believed, and from which it is doubted if it is no noise."""
NOISY = 3.0
"""Error over what the channels' noise makes up to which it is noise."""
POINTS = 60
"""Points of the virgin curve."""
MOST_DRAWN = 2000
"""Samples of the curve of forces."""


@dataclass(frozen=True)
class ReportedElements:
    """Identified elements and what was identified beside them."""

    stiffness: np.ndarray
    """K_i [N/m], shape (N,)."""
    limit_force: np.ndarray
    """F_mi [N], shape (N,)."""
    damping: np.ndarray
    """D_i [N s/m], shape (N,), or empty."""
    terms: Mapping[str, float]
    """Offset [N], asymmetry and viscous coefficient [N s/m] and mass [kg], those that were fitted or are known."""
    covariance: np.ndarray
    """Of the K_i, F_mi, D_i and terms, in this order."""

    @property
    def virgin_curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return displacement x [m], g(x) = Σ K_i min(x, Y_i) [N] and its standard deviation [N], each (n,)."""
        widths = self.limit_force / self.stiffness
        x = np.unique(np.concatenate([np.geomspace(widths.min() / 10, 1.2 * widths.max(), POINTS), widths]))
        sticking = x[:, None] < widths
        gradient = np.concatenate([np.where(sticking, x[:, None], 0.0), np.where(sticking, 0.0, 1.0)], axis=1)
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

    def deviation(self, term: str) -> float:
        """Return the standard deviation of a term."""
        place = len(self.covariance) - len(self.terms) + list(self.terms).index(term)
        return float(np.sqrt(max(self.covariance[place, place], 0.0)))


@dataclass(frozen=True)
class Errors:
    """How well the force is met."""

    fitted: float
    """Root mean square error over the cycles that were fitted [N]."""
    held_out: float
    """The same over those that were not [N]."""
    residuals: Sequence[np.ndarray]
    """Of all rows, stretch by stretch [N]."""

    @property
    def worst(self) -> float:
        """The greater of both."""
        return float(np.nanmax([self.fitted, self.held_out]))


def report(
    signals: Signals,
    found: ReportedElements,
    rows: Sequence[RegressionRows],
    errors: Errors,
    cycles: tuple[int, int],
    remarks: Sequence[str],
    whole: bool = True,
) -> Result:
    """Return the result: parameters, errors and energy as metrics, virgin curve and forces as curves, and the fit.

    `cycles` are the numbers of those fitted and of those held out; the rows tell of work where they are the `whole`
    force along all of the motion.
    """
    metrics = [*_parameters(found), *_quality(found, rows, errors, whole), *_counts(cycles, found), *_deviations(found)]
    curves = (virgin_curve(*found.virgin_curve), _forces(rows, errors))
    message = "; ".join([*([signals.message] if signals.message else []), *remarks])
    return Result(signals.outcome, message, metrics=tuple(metrics), curves=curves, fits=(rolling_fit(found),))


def errs(coulomb: float, error: float, noise: float) -> bool:
    """Return whether an error [N] is too large for the model to be right, with what the channels' noise makes [N]."""
    return error > UNEXPLAINED * coulomb or error > max(DOUBTED * coulomb, NOISY * noise)


def unexplained(coulomb: float, error: float, noise: float) -> list[str]:
    """Return the remark that the force is not that of the model of this Coulomb force [N], if it is so."""
    if not errs(coulomb, error, noise):
        return []
    share = error / coulomb
    why = "noise, another force or a wrong dead time; see the curve 'friction force'"
    if share > UNEXPLAINED:
        return [
            f"the model misses {share:.0%} of the Coulomb force, so its parameters mean little: standstill that the "
            f"scale does not resolve, {why}"
        ]
    return [
        f"the model misses {share:.1%} of the Coulomb force, where noise explains {noise / coulomb:.1g}: intervals are "
        f"widened, but may not hold the truth: standstill that the scale does not resolve, {why}"
    ]


UNITS = {"mass": "kg", "viscous": "N s/m", "offset": "N", "asymmetry": "N s/m"}
TITLES = {"mass": "mass", "viscous": "viscous coefficient", "offset": "offset", "asymmetry": "viscous asymmetry"}


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
    terms = [Metric(f"{TITLES[term]}, 95 %", NORMAL * found.deviation(term), UNITS[term]) for term in found.terms]
    return [Metric("Coulomb force, 95 %", NORMAL * found.coulomb[1], "N"), *terms]


def _quality(found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors, whole: bool) -> list[Metric]:
    metrics = []
    if np.isfinite(errors.held_out):
        metrics.append(Metric("rms error, held-out cycles", errors.held_out, "N"))
    if whole:
        measured, model = energies(found, rows, errors)
        metrics += [Metric("energy per cycle", measured, "N m"), Metric("energy per cycle, model", model, "N m")]
    metrics.append(Metric("rms error, fitted cycles", errors.fitted, "N"))
    if np.isfinite(errors.held_out):
        share = errors.held_out / found.coulomb[0]
        metrics.append(Metric("rms error, held-out cycles, over the Coulomb force", share, "1"))
    return metrics


def energies(found: ReportedElements, rows: Sequence[RegressionRows], errors: Errors) -> tuple[float, float]:
    """Return the friction's work per cycle [N m] as measured and as the model has it."""
    measured = model = 0.0
    for each, residual in zip(rows, errors.residuals, strict=True):
        work = each.velocity * each.duration
        force = each.force - _inertia(found, each)
        measured += float(np.add.reduce(work * force))
        model += float(np.add.reduce(work * (force - residual)))
    sizes = np.unique(np.concatenate([each.cycle for each in rows]), return_counts=True)[1]
    count = float(sizes.sum() / np.median(sizes))  # the first cycle may be known in part only
    return measured / count, model / count


def _inertia(found: ReportedElements, rows: RegressionRows) -> np.ndarray:
    if "mass" not in rows.names:
        return np.zeros_like(rows.force)
    inertia: np.ndarray = found.terms["mass"] * rows.columns[:, rows.names.index("mass")]
    return inertia


def _counts(cycles: tuple[int, int], found: ReportedElements) -> list[Metric]:
    return [
        Metric("elements", float(found.stiffness.size), "1"),
        Metric("cycles fitted", float(cycles[0]), "1"),
        Metric("cycles held out", float(cycles[1]), "1"),
    ]


def virgin_curve(x: np.ndarray, force: np.ndarray, deviation: np.ndarray) -> Curve:
    """Return the virgin curve with its 95 % limits, from ascending displacement [m], force and its deviation [N].

    It begins at 0 and never falls, and nor do its limits: what only a falling curve could reach, from or to a place
    where it is better known, is not within them.
    """
    lower, upper = force - NORMAL * deviation, force + NORMAL * deviation
    columns = {
        "displacement": x,
        "force": force,
        "lower 95 %": np.fmax.accumulate(np.maximum(lower, 0.0)),
        "upper 95 %": np.fmin.accumulate(upper[::-1])[::-1],
    }
    return Curve("virgin curve", columns, dict(zip(columns, ("m", "N", "N", "N"), strict=True)))


def force_over_velocity(velocity: np.ndarray, force: np.ndarray, model: np.ndarray) -> Curve:
    """Return force and model [N] over ascending velocity [m/s], with a gap between the two directions."""
    order = np.argsort(velocity, kind="stable")
    turn = int(np.sum(velocity < 0))
    columns = (np.insert(values[order], turn, gap) for values, gap in ((velocity, 0), (force, np.nan), (model, np.nan)))
    named = dict(zip(("velocity", "force", "model"), columns, strict=True))
    return Curve("force over velocity", named, {"velocity": "m/s", "force": "N", "model": "N"})


def _forces(rows: Sequence[RegressionRows], errors: Errors) -> Curve:
    """Return measured force and model over the first cycles."""
    first, residual = rows[0], errors.residuals[0]
    time = first.duration * np.arange(first.force.size)
    table = np.stack([time, first.force, first.force - residual])[:, :MOST_DRAWN]
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
