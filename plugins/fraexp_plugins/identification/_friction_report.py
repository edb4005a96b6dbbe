"""The result of friction identification: numbers with their intervals, errors, curves, doubts and the model."""

from collections.abc import Iterator, Sequence

import numpy as np

from fraexp.api import CURVE_POINTS, Curve, Finding, Fit, Metric, Quantity, Result, Signals, significant_deviation
from fraexp_plugins.friction._shared.element_model import ElementModel
from fraexp_plugins.identification._friction_fit import FrictionFit
from fraexp_plugins.identification._friction_rows import TERM_UNITS
from fraexp_plugins.identification._law_forces import force_over_velocity, virgin_curve

MIN_DEFLECTION_STEPS = 10.0
"""Quantisation steps that the presliding deflection should have."""
MIN_REMARKED_SHARE = 0.05
"""Part of a sample that a further dead time is, or of the viscous force at the largest speed that a quadratic term is,
from which there is a remark. Half of it remarks on friction whose D_v is right within 3 % at all velocities."""
MAX_CURVE_SAMPLES = 2000
"""Samples of the curve of forces."""
TITLES = {
    "viscous": "viscous coefficient",
    "asymmetry": "viscous asymmetry",
    "coulomb_force": "Coulomb force",
    "dead_time": "further dead time",
}


def report(signals: Signals, fit: FrictionFit, remarks: Sequence[Finding] = ()) -> Result:
    """Return the result: numbers, errors and energy as metrics, forces as curves, and the friction model."""
    result = Result(
        signals.outcome, signals.findings, metrics=tuple(_metrics(fit)), curves=tuple(_curves(fit)), fits=(_model(fit),)
    )
    return result.with_findings(*remarks, *fit.problem.findings, *_findings(fit))


def _findings(fit: FrictionFit) -> Iterator[Finding | str]:
    if isinstance(fit.model, ElementModel):
        deflection, resolution = fit.coulomb_force / _stiffness(fit), fit.problem.resolution
        if resolution * MIN_DEFLECTION_STEPS > deflection:
            steps = Quantity(resolution, "m", "encoder step"), Quantity(deflection, "m", "presliding deflection")
            yield Finding("not identifiable", steps, place="stiffness", remedy="use a finer encoder")
    else:
        pairs = zip(fit.numbers, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)
        loose = [n.name for n, std in pairs if n.name not in TERM_UNITS and not fit.quantile * std < abs(n.value)]
        if loose:
            remedy = "vary the speed from presliding to sliding"
            yield Finding("not identifiable", place=", ".join(loose), remedy=remedy)
    if "viscous" in fit.problem.terms and fit.term("viscous") <= 0 and fit.problem.is_sliding:
        yield "friction falls with the velocity: a Stribeck effect, or a wrong dead time; fit a law with such an effect"
    if fit.problem.is_sliding and _is_curved(fit):
        yield "friction is not linear in the velocity (Stribeck effect?): D_v is valid between these velocities only"
    if fit.stroke is not None:
        text = (
            "a force along the stroke, such as cogging or the ripple of a screw, is fitted too; the offset contains "
            "its mean"
        )
        size = float(np.std(fit.stroke.force))
        yield Finding("remark", (Quantity(size, "N", "rms"),), text=text)
    dead_time, sample_time = fit.term("dead_time"), fit.problem.records[0].sample_time
    if abs(dead_time) > max(_half_widths(fit).get("dead_time", 0.0), MIN_REMARKED_SHARE * sample_time):
        text = "the thrust acts at another time than one that is held between samples and delayed as stated"
        remedy = "if you know better, set input_dead_time, or zero_order_hold"
        yield Finding("remark", (Quantity(dead_time, "s", "further dead time"),), text=text, remedy=remedy)
    half_width, force = fit.half_width(fit.is_coulomb), fit.coulomb_force
    if half_width > 0:
        known = Quantity(100 * half_width / force, "%", "known to")
        yield Finding("not identifiable", (known,), place="Coulomb force", error=half_width / force)
    if fit.has_model_error:
        yield _model_error(fit)


def _is_curved(fit: FrictionFit) -> bool:
    """Return whether a force v |v| explains a significant part of what the terms leave, and changes D_v by it."""
    residual, slopes, velocity = fit.residuals, fit.slopes, fit.rows.velocity
    basis, _ = np.linalg.qr(slopes)
    own = velocity * np.abs(velocity)
    own = own - basis @ (basis.T @ own)
    value, freedom = own @ residual / (own @ own), max(residual.size - slopes.shape[1] - 1, 1)
    left = residual - value * own
    std = np.sqrt(left @ left / freedom * fit.problem.rows_per_noise / (own @ own))
    change = abs(value) * float(np.abs(velocity).max())
    return bool(abs(value) > significant_deviation() * std and change > MIN_REMARKED_SHARE * abs(fit.term("viscous")))


def _model_error(fit: FrictionFit) -> Finding:
    share, by_noise = fit.worst_error / fit.coulomb_force, fit.noise / fit.coulomb_force
    causes = (
        "check for a standstill below the encoder's resolution, another force, a Stribeck effect, a mode below ten "
        "times max_frequency, and a wrong gain or dead time: see the curve of the forces"
    )
    sizes = Quantity(100 * share, "%", "error over the Coulomb force"), Quantity(100 * by_noise, "%", "by noise")
    return Finding("misfit", sizes, remedy=causes, error=share)


def _stiffness(fit: FrictionFit) -> float:
    """Return ΣK_i [N/m]."""
    return sum(each.value for each in fit.numbers if each.name.startswith("stiffness"))


def _half_widths(fit: FrictionFit) -> dict[str, float]:
    """Return half of the 95 % interval of each number by its name."""
    return {each.name: fit.half_width(row) for each, row in zip(fit.numbers, np.eye(len(fit.numbers)), strict=True)}


def _metrics(fit: FrictionFit) -> Iterator[Metric]:
    """Yield the numbers, those of a list of elements but as their sums, and how well they explain the record."""
    widths, is_of_elements = _half_widths(fit), isinstance(fit.model, ElementModel)
    if is_of_elements:
        yield from _with_interval("Coulomb force", "N", fit.coulomb_force, fit.half_width(fit.is_coulomb))
        yield Metric("presliding deflection", fit.coulomb_force / _stiffness(fit), "m")
        yield Metric("presliding stiffness", _stiffness(fit), "N/m")
        yield Metric("elements", float(len(fit.sizes)), "1")
    for number in fit.numbers:
        if not is_of_elements or number.name in TERM_UNITS:
            title = TITLES.get(number.name, number.name.replace("_", " "))
            yield from _with_interval(title, number.unit, number.value, widths[number.name])
    if fit.problem.viscous is not None:
        yield Metric(TITLES["viscous"], fit.problem.viscous, TERM_UNITS["viscous"])
    elif "viscous" in widths:
        bound = np.sqrt(np.diag(fit.inverse)[fit.shape.size + fit.problem.terms.index("viscous")] * fit.white_variance)
        yield Metric(f"{TITLES['viscous']}, 95 %, Cramér-Rao bound", fit.quantile * float(bound), TERM_UNITS["viscous"])
    if fit.stroke is not None:
        yield Metric("force along the stroke, rms", float(np.std(fit.stroke.force)), "N")
    yield Metric("rms error, fitted cycles", fit.error, "N")
    if np.isfinite(fit.held_out_error):
        yield Metric("rms error, held-out cycles", fit.held_out_error, "N")
        yield Metric("rms error, held-out cycles, over the Coulomb force", fit.held_out_error / fit.coulomb_force, "1")
    yield Metric(fit.problem.observation.rows_name, float(fit.rows.force.size), "1")


def _with_interval(title: str, unit: str, value: float, half_width: float) -> Iterator[Metric]:
    yield Metric(title, value, unit)
    yield Metric(f"{title}, 95 %", half_width, unit)


def _curves(fit: FrictionFit) -> Iterator[Curve]:
    """Yield the virgin curve, force over velocity of sliding, or measured force and model over time."""
    rows, terms, residual = fit.rows, fit.problem.terms, fit.residuals
    if fit.problem.is_sliding:
        inertia = fit.term("mass") * rows.columns[:, terms.index("mass")] if "mass" in terms else 0.0
        force = rows.force - inertia - (fit.stroke.force if fit.stroke else 0.0)
        yield force_over_velocity(rows.velocity, force, force - residual)
        return
    thresholds = fit.problem.thresholds
    x = np.geomspace(float(thresholds[0]) / 10, 1.2 * float(thresholds[-1]), CURVE_POINTS)
    yield virgin_curve(x, *fit.virgin_curve(x))
    first = np.flatnonzero(rows.record == rows.record[0])[:MAX_CURVE_SAMPLES]
    time, force = rows.time[first] - rows.time[first[0]], rows.force[first]
    columns = {"time": time, "force": force, "model": force - residual[first]}
    yield Curve("friction force", columns, {"time": "s", "force": "N", "model": "N"})


def _model(fit: FrictionFit) -> Fit:
    """Return the friction model with the covariance of its numbers."""
    inside = [place for place, each in enumerate(fit.numbers) if each.name not in TERM_UNITS or each.name == "viscous"]
    chosen = [fit.numbers[place] for place in inside]
    return Fit(
        "friction",
        fit.model.spec(),
        tuple("viscous_coefficient" if each.name == "viscous" else each.name for each in chosen),
        tuple(each.unit for each in chosen),
        np.array([each.value for each in chosen]),
        fit.covariance[np.ix_(inside, inside)],
    )
