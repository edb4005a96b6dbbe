"""The plant model of eq (1) with a dead time, from a frequency response."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CURVE_POINTS,
    DIFFERENCE,
    NORMAL_QUANTILE,
    ROUNDING,
    SIGNIFICANCE,
    Curve,
    Estimator,
    Finding,
    Fit,
    FrequencyResponse,
    Metric,
    Outcome,
    ParameterError,
    Quantity,
    RecordError,
    Result,
    Signals,
    degrees_of_freedom,
    param,
    remarks,
    significant_deviation,
)
from fraexp_plugins.identification._modal_model import (
    GROUND,
    LogResponse,
    ModalModel,
    Weighting,
    log_response,
    parameter_symbol,
)
from fraexp_plugins.identification._modal_solver import (
    MAX_PEAK_DAMPING,
    Solution,
    chosen_order,
    count_text,
    fit_of_order,
    information_criterion,
    low_ground,
    mode_limit,
    shows_lag,
    unsupported_parts,
)

PairsOf = Callable[[ModalModel, NDArray[np.float64]], NDArray[np.float64]]
"""Returns natural frequency [Hz] and damping ratio of poles or zeros, shape (m, 2), for p."""
QUANTITIES = ("frequency", "Hz"), ("damping ratio", "1"), ("magnitude", "")
"""Columns and their units; that of the magnitude is the response's."""


def extremum_curves(solution: Solution, unit: str) -> tuple[Curve, ...]:
    """Return the curves ``resonances`` and ``antiresonances`` in the frequency range, as far as there are any.

    Each has frequency, damping ratio and magnitude with the half widths of their 95 % intervals.
    """
    found = (("resonances", resonances), ("antiresonances", antiresonances))
    curves = (_curve(name, _with_intervals(solution, pairs), unit) for name, pairs in found)
    return tuple(curve for curve in curves if curve.columns["frequency"].size)


def resonances(model: ModalModel, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return natural frequency [Hz] and damping ratio of the complex poles, ascending, shape (m, 2)."""
    zeros, poles = _polynomials(model, p)
    scale = _scale(model)
    ground = zip(model.ground, model.ground_forces(p).tolist(), strict=True)
    terms = {GROUND[name]: value * np.exp(p[0]) / scale ** (2 - GROUND[name]) for name, value in ground}
    fed_back = np.convolve(zeros, np.array([terms.get(1, 0.0), terms.get(0, 0.0)]))
    return _pairs(poles + np.pad(fed_back, (poles.size - fed_back.size, 0)), scale)


def antiresonances(model: ModalModel, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return natural frequency [Hz] and damping ratio of the complex zeros, ascending, shape (m, 2).

    Without collocation a zero may lie to the right, with a negative damping ratio, or be real.
    """
    return _pairs(_polynomials(model, p)[0], _scale(model))


def _scale(model: ModalModel) -> float:
    """Return an angular frequency within the frequency range [rad/s], over which roots are of the order of 1."""
    return float(2 * np.pi * np.sqrt(model.min_frequency * model.max_frequency))


def _polynomials(model: ModalModel, p: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return numerator and denominator of P/k0 by s over the scale, the highest power first."""
    factors, scale = [np.array([1.0, 0.0, 0.0])], _scale(model)
    for frequency, zeta in model.poles(p):
        omega = 2 * np.pi * frequency / scale
        factors.append(np.array([1.0, 2 * zeta * omega, omega**2]))
    gains = np.concatenate([[1.0], p[3 : model.ground_place : 3]])
    zeros = np.sum([_product(factors, at) * gain for at, gain in enumerate(gains)], axis=0)
    return zeros, _product(factors, len(factors))


def _pairs(polynomial: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Return natural frequency [Hz] and damping ratio of the complex roots, ascending, shape (m, 2)."""
    roots = np.roots(polynomial)
    upper = roots[roots.imag > ROUNDING]
    upper = upper[np.argsort(np.abs(upper))]
    return np.column_stack([np.abs(upper) * scale / (2 * np.pi), -upper.real / np.abs(upper)])


def _product(factors: list[NDArray[np.float64]], without: int) -> NDArray[np.float64]:
    """Return the product of all polynomials but the one in this place."""
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
        positive = np.maximum(nearest, np.finfo(float).tiny)  # of a damping ratio that may vanish
        return np.column_stack([np.log(positive), log_model.real])

    is_known = (pairs[:, 0] >= model.min_frequency) & (pairs[:, 0] <= model.max_frequency)
    is_known &= (pairs[:, 1] > 0) & (pairs[:, 1] < MAX_PEAK_DAMPING)
    pairs = pairs[is_known]
    if not pairs.size:
        return np.empty((0, 6))
    steps = DIFFERENCE * np.eye(p.size)
    slopes = np.array([log_values(p + step) - log_values(p - step) for step in steps]) / (2 * DIFFERENCE)
    variance = np.einsum("pmi,pq,qmi->mi", slopes, solution.reported_covariance, slopes)
    values = np.exp(log_values(p))
    return np.concatenate([values, NORMAL_QUANTILE * np.sqrt(variance) * values], axis=1)


def _curve(name: str, rows: NDArray[np.float64], unit: str) -> Curve:
    columns: dict[str, NDArray[np.float64]] = {}
    for at, (quantity, _) in enumerate(QUANTITIES):
        columns |= {quantity: rows[:, at], f"{quantity}, ± 95 %": rows[:, at + len(QUANTITIES)]}
    units = {quantity: own or unit for quantity, own in QUANTITIES}
    return Curve(name, columns, {column: units[column.partition(",")[0]] for column in columns})


PLANT_UNIT = "m/N"
MAX_RESIDUAL = 0.5
"""Root mean square of ln(G_m/Ĝ) above which a fit is refused: a factor of 1.6."""
INTERVAL_ADVICE = (
    "the intervals are widened for the part of it that may be in the parameters, but not for a bias by friction at all "
    "frequencies; try more modes, a narrower frequency range, or a method that compensates friction"
)


HELD = (
    "a spring or viscous friction holds the mass (ground_stiffness, viscous_coefficient); friction looks alike at one "
    "amplitude"
)


class CheckedFit(NamedTuple):
    """A fit, and what it leaves out."""

    solution: Solution
    causes: tuple[str, ...]
    fall: float
    """Standard deviations by which the viscous coefficient was below 0 before it was fixed at 0."""


class ModalFit(Estimator, name="modal_fit", version=12):
    """P_d(s) e^{-Ls} of the paper's eq (1), fitted to the response of `method`: rigid body, modes and dead time.

    Minimises Σ w_k |ln(G_m(jω_k)/Ĝ_k)|², the weighted logarithmic residual (J. D. Sidman, F. E. DeAngelis and
    G. C. Verghese, IEEE Trans. Automatic Control 36(9), 1991; R. Pintelon et al., IEEE Trans. Automatic Control 39(11),
    1994, doi 10.1109/9.333769), with 1/w_k the variance of ln Ĝ_k by noise and `floor`, or all points alike. No start
    values are needed. The covariance of the parameters follows from that of the response. If the latter is unknown, or
    does not explain the residuals, the residuals give it; an error of the model does not average out, so the residuals
    then count as one for each parameter. An error that is the same at all frequencies shows in no residual.

    A dead time that is not given is estimated. It includes half a sample time if the response still contains the hold:
    set `refer_to_plant` in the method, which removes delay and magnitude of the hold. Rigid body and modes are then the
    `rigid_body_gain`, `frequencies`, `damping_ratios` and `modal_gain_ratios` of the plant `modal`.

    Where the response is inaccurate outside the frequency range of the fit only, the fit is ok.

    A fit that leaves more of the response unexplained by noise than the accuracy of the study is inaccurate. Where
    nothing else tells the scatter of the response, such as one that another program measured, the residuals do.

    The curves `resonances` and `antiresonances` list poles and complex zeros within the frequency range: frequency,
    damping ratio, and magnitude of the fitted model.

    Metrics: the parameters, whose covariance is in the fit; `residual`, the root mean square of ln(G_m/Ĝ); `cost`, the
    weighted sum of squares over its expectation by noise and `model_error` (1 if the model is right; missing if the
    noise is unknown); `beyond`, the fraction of points outside of their 95 % limit; `whiteness`, the probability of
    residuals as correlated along the frequencies as these. None of them includes the error by a wrong friction model.

    A number of modes that is not given is chosen such that the data support all modes: none lies outside of the
    frequency range unless its natural frequency is known to 5 %, has too much damping for a peak, or a modal gain that
    may vanish without a few points. The message names the modes that were dropped. Residuals that are correlated with
    their neighbours count as fewer in the covariance and in the criterion.

    With `fit_ground`, or where a free body does not explain the response, a viscous force D v and a spring K y act on
    the mass in addition, which move together with the measured position: G = e^{-Ls}/(1/P + D s + K), which is
    1/(M s² + D s + K) for a mass without modes.

    Do not use it if the response is biased by friction, unless to show that bias: the fit follows the response, not
    the plant.
    """

    fits: ClassVar[str] = "plant"
    takes_responses: ClassVar[bool] = True

    method: Estimator = param("", "estimator of the response that is fitted")
    modes: int | None = param(
        "1",
        "number of modes; chosen by the extended Bayesian information criterion if it is not given",
        None,
        at_least=0,
        at_most=12,
    )
    max_modes: int = param("1", "largest number of modes to try if it is not given", 6, at_least=0, at_most=12)
    min_frequency: float = param("Hz", "lower limit of the frequency range of the fit", 0.0, at_least=0)
    max_frequency: float | None = param(
        "Hz", "upper limit of the frequency range of the fit; none if it is not given", None, above=0
    )
    dead_time: float | None = param("s", "fixed dead time L; estimated if it is not given", None)
    fit_ground: bool | None = param(
        "",
        "whether viscous friction and a significant spring between mass and ground are fitted too; if not given, it is "
        "chosen together with the number of modes, where that is not given either",
        None,
    )
    quantity: Literal["complex", "magnitude"] = param(
        "", "quantity that is fitted: complex, or magnitude, which has no dead time", "complex"
    )
    weighting: Weighting = param(
        "", "noise (1/σ), relative (all points alike), or automatic: noise if it is known", "automatic"
    )
    model_error: float = param("1", "relative error of the model that is allowed for besides noise", 1e-3, above=0)

    def model_post_init(self, context: object) -> None:
        """Check the frequency range."""
        if self.max_frequency is not None and self.max_frequency <= self.min_frequency:
            raise ParameterError(
                f"modal_fit.max_frequency is {self.max_frequency:g} Hz; expected more than min_frequency, "
                f"{self.min_frequency:g} Hz"
            )

    def estimate(self, signals: Signals) -> Result:
        """Return the response of `method`, and the plant that is fitted to it."""
        found = self.method.estimate(signals)
        if found.response is None:
            if found.outcome is Outcome.OK:
                raise RecordError(
                    f"modal_fit: the method {self.method.name} returns no response to fit; choose another one"
                )
            return found
        try:
            fit = self.fit_response(found.response)
        except RecordError as error:
            if found.outcome is Outcome.OK:
                raise
            return found.with_findings(str(error))  # the signals are the cause
        own = [each for each in found.findings if each not in signals.findings]
        if signals.outcome is Outcome.OK and not any(self._concerns_range(each) for each in own):
            outside = [replace(each, place=f"outside the fit's range {each.place}".rstrip()) for each in own]
            found = replace(found, outcome=Outcome.OK, findings=(*signals.findings, *outside))
        return replace(
            found,
            response=fit.response,
            outcome=fit.outcome if found.outcome is Outcome.OK else found.outcome,
            findings=(*found.findings, *fit.findings),
            metrics=(*found.metrics, *fit.metrics),
            curves=(*fit.curves, *found.curves),
            fits=(*found.fits, *fit.fits),
        )

    def relies_on(self, frequency: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which frequencies are fitted."""
        high = np.inf if self.max_frequency is None else self.max_frequency
        return np.asarray((frequency >= self.min_frequency) & (frequency <= high))

    def _concerns_range(self, finding: Finding) -> bool:
        """Return whether a finding concerns frequencies that are fitted."""
        return not finding.frequencies or bool(self.relies_on(np.array(finding.frequencies)).any())

    def fit_response(self, response: FrequencyResponse) -> Result:
        """Return a response with the plant that is fitted to it; RecordError if there is none."""
        found = self._free_or_held(response)
        return self.report(found.solution, found.causes, response)

    def _free_or_held(self, response: FrequencyResponse) -> CheckedFit:
        """Return the fit of a free body, or if that does not explain the response and is less likely, of a held one."""
        try:
            free = self.solve(response)
            if self.fit_ground is not None or self.modes is not None or not next(_remarks(free.solution), None):
                return free
        except RecordError as error:
            if self.fit_ground is not None or self.modes is not None:
                raise
            free, refusal = None, error
        try:
            held = self.model_copy(update={"fit_ground": True}).solve(response)
        except RecordError:
            held = None
        if free is not None and (
            held is None or information_criterion(free.solution) <= information_criterion(held.solution)
        ):
            return free
        if held is None or not held.solution.model.ground:
            raise refusal
        return held._replace(causes=(*held.causes, HELD))

    def report(self, solution: Solution, causes: tuple[str, ...], response: FrequencyResponse) -> Result:
        """Return a response with the plant of a solution."""
        return Result(
            Outcome.OK,
            remarks(*causes, *_remarks(solution)),
            self._with_scatter(response, solution),
            tuple(self._metrics(solution, response.unit)),
            (_model_curve(solution, response.unit), _error_curve(solution), *extremum_curves(solution, response.unit)),
            (self._fit(solution, response.unit),),
        )

    def _with_scatter(self, response: FrequencyResponse, solution: Solution) -> FrequencyResponse:
        """Return a response whose scatter, where it is unknown and fitted, is that of the residuals."""
        unknown = ~np.isfinite(response.covariance).all(axis=(1, 2)) & self.relies_on(response.frequency)
        variance = (solution.residual * np.abs(response.response)) ** 2 / solution.data.parts
        covariance = np.where(unknown[:, None, None], variance[:, None, None] * np.eye(2), response.covariance)
        freedom = np.where(unknown, max(solution.data.count - solution.p.size, 1), degrees_of_freedom(response))
        return replace(response, covariance=covariance, freedom=freedom) if unknown.any() else response

    def log_data(self, response: FrequencyResponse, common: NDArray[np.complex128] | None = None) -> LogResponse:
        """Return what is fitted; `common` are relative errors that all frequencies share, shape (n, k)."""
        band = (self.min_frequency, np.inf if self.max_frequency is None else self.max_frequency)
        parts = 1 if self.quantity == "magnitude" else 2
        return log_response(response, band, self.weighting, self.model_error, parts, common)

    def solve(
        self, response: FrequencyResponse, common: NDArray[np.complex128] | None = None, may_lag: bool = False
    ) -> CheckedFit:
        """Return the fit to a response, with a first-order lag if it `may_lag` and shows one.

        `common` are relative errors that all frequencies share, shape (n, k).
        """
        data = self.log_data(response, common)
        dead_time = 0.0 if self.quantity == "magnitude" and self.dead_time is None else self.dead_time
        if not data.frequency.size:
            raise RecordError(
                "modal_fit: no settled point lies within the frequency range; widen it by min_frequency and "
                "max_frequency"
            )
        limits = float(data.frequency[0]), float(data.frequency[-1])
        model = ModalModel(self.modes or 0, *limits, (), dead_time, None if may_lag else 0.0)
        if self.fit_ground:
            sizes = zip(GROUND, *low_ground(replace(model, ground=tuple(GROUND)), data), strict=True)
            kept = [
                name
                for name, value, std in sizes
                if name == "viscous_coefficient" or value > significant_deviation() * std
            ]
            model = replace(model, ground=tuple(kept))
        solution, unsupported = self._fit_modes(model, data)
        if model.time_constant is None and not shows_lag(solution):
            model = replace(model, time_constant=0.0)
            solution, unsupported = self._fit_modes(model, data)
        negative, fall = "", 0.0
        for name in reversed(model.ground):
            place = solution.model.names().index(name)
            size = float(solution.p[place] / np.sqrt(solution.covariance[place, place]))
            if size >= (0.0 if name == "viscous_coefficient" else significant_deviation()):
                continue
            if name == "viscous_coefficient":
                negative, fall = "the viscous coefficient would be negative and is fixed at 0", -size
            others = tuple(each for each in solution.model.ground if each != name)
            solution, unsupported = self._fit_modes(replace(model, ground=others), data)
        return CheckedFit(solution, (negative, unsupported), fall)

    def _fit_modes(self, model: ModalModel, data: LogResponse) -> tuple[Solution, str]:
        """Return the fit, and a remark on modes that the data do not support."""
        possible = mode_limit(data, model)
        if possible < model.modes:
            most = f"for more than {count_text(possible, 'mode')}" if possible >= 0 else "even for a rigid body"
            raise RecordError(
                f"modal_fit: {data.frequency.size} settled points from {model.min_frequency:.4g} to "
                f"{model.max_frequency:.4g} Hz are too few {most}; record more, widen the frequency range, or "
                "use fewer modes"
            )
        if self.modes is not None:
            solution = fit_of_order(model, data)
            unsupported = "; ".join(unsupported_parts(solution))
            advice = f"use {'fewer' if self.modes else 'more'} modes or another frequency range"
            remark = f"the data do not support {unsupported}: {advice}" if unsupported else ""
        else:
            chosen, dropped = chosen_order(model, data, min(possible, self.max_modes))
            if chosen is None:
                raise RecordError(
                    "modal_fit: the response does not support a fit, whatever its number of modes"
                    + (f": {dropped}" if dropped else "")
                    + "; expected a response of position over force: choose a frequency range (min_frequency, "
                    "max_frequency) that is free of friction and noise, or a method that compensates friction"
                    f"{self._ground_advice}"
                )
            solution, remark = chosen, f"dropped, because the data do not support it: {dropped}" if dropped else ""
        if solution.unidentifiable:
            raise RecordError(
                f"modal_fit: not identifiable from this response: {', '.join(solution.unidentifiable)}; use fewer "
                "modes, fix the dead time, or record more points around the modes"
            )
        residual = solution.residual
        if residual > MAX_RESIDUAL:
            raise RecordError(
                f"modal_fit: the residual is {residual:.2g} in the logarithm; expected {MAX_RESIDUAL:g} or less, for a "
                "response of position over force: choose a frequency range (min_frequency, max_frequency) that is "
                f"excited and free of friction, or more modes{self._ground_advice}" + (f" ({remark})" if remark else "")
            )
        return solution, remark

    @property
    def _ground_advice(self) -> str:
        return "" if self.fit_ground is not False else ", or fit_ground if a spring or viscous friction holds the mass"

    def _fit(self, solution: Solution, unit: str) -> Fit:
        """Return the plant with the covariance of its parameters; that of a fixed dead time is 0."""
        model, values, covariance = solution.model, *_values(solution)
        names, units = model.names(), _units(model, unit)
        if self.dead_time is not None:
            names, units, values = (*names, "dead_time"), (*units, "s"), np.append(values, self.dead_time)
            covariance = np.pad(covariance, (0, 1))
        return Fit("plant", model.plant(solution.p).spec(), names, units, values, covariance)

    def _metrics(self, solution: Solution, unit: str) -> Iterator[Metric]:
        model, data = solution.model, solution.data
        for name, value, own_unit in zip(model.names(), model.values(solution.p), _units(model, unit), strict=True):
            yield Metric(parameter_symbol(name), float(value), own_unit)
        yield Metric("modes", float(model.modes), "1")
        yield Metric("points", float(data.frequency.size), "1")
        yield Metric("residual", solution.residual, "1")
        if data.covariance is not None:
            yield Metric("cost", solution.excess, "1")
        yield Metric("beyond", float(np.mean(_relative_errors(solution) > 1)), "1")
        yield Metric("whiteness", solution.whiteness, "1")


def _values(solution: Solution) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return values and covariance of the parameters in SI units."""
    slopes = solution.model.slopes(solution.p)
    return solution.model.values(solution.p), slopes @ solution.reported_covariance @ slopes.T


def _units(model: ModalModel, unit: str) -> tuple[str, ...]:
    """Return the units of the parameters for a response in this unit."""
    plant = unit == PLANT_UNIT
    ground = (
        {"viscous_coefficient": "N s/m", "ground_stiffness": "N/m"}
        if plant
        else {"viscous_coefficient": f"s/({unit})", "ground_stiffness": f"1/({unit})"}
    )
    ends = [*(ground[name] for name in model.ground), *["s"] * len(model.path)]
    return ("m/(N s**2)" if plant else f"({unit})/s**2", *["Hz", "1", "1"] * model.modes, *ends)


def _relative_errors(solution: Solution) -> NDArray[np.float64]:
    """Return |ln(G_m/Ĝ)| over its 95 % limit, shape (n,)."""
    data = solution.data
    scale = solution.excess if data.covariance is None else 1.0
    limit = -2 * np.log(0.05) if data.parts == 2 else NORMAL_QUANTILE**2
    squared = np.sum(data.weighted_parts(solution.error).reshape(data.parts, -1) ** 2, axis=0)
    return np.asarray(np.sqrt(squared / max(scale * limit, 1e-300)))


def _model_curve(solution: Solution, unit: str) -> Curve:
    """Return the fitted model with its extrema; without a phase if only the magnitude is fitted."""
    data, model = solution.data, solution.model
    low, high = float(data.frequency[0]), float(data.frequency[-1])
    modes = np.concatenate([model.poles(solution.p), antiresonances(model, solution.p)])[:, 0]
    inside = modes[(low < modes) & (modes < high)]
    frequency = np.unique(np.concatenate([np.geomspace(low, high, CURVE_POINTS), inside]))
    log_model = model.log_response(solution.p, 2j * np.pi * frequency)
    columns = {"frequency": frequency, "magnitude": np.exp(log_model.real)}
    if data.parts == 2:
        columns["phase"] = np.angle(np.exp(1j * log_model.imag), deg=True)
    units = {"frequency": "Hz", "magnitude": unit, "phase": "deg"}
    return Curve("plant fit", columns, {name: units[name] for name in columns})


def _error_curve(solution: Solution) -> Curve:
    """Return the errors of the fitted model over the frequencies of its points."""
    data = solution.data
    columns = {"frequency": data.frequency, "magnitude error": np.expm1(solution.error.real)}
    if data.parts == 2:
        columns["phase error"] = np.degrees(solution.error.imag)
    columns["error over 95 % limit"] = _relative_errors(solution)
    units = {"frequency": "Hz", "phase error": "deg"}
    return Curve("plant fit error", columns, {name: units.get(name, "1") for name in columns})


def _remarks(solution: Solution) -> Iterator[Finding | str]:
    """Yield reasons to doubt the fit."""
    residual = solution.residual
    if solution.unexplained:
        worst = float(solution.data.frequency[np.argmax(np.abs(solution.error))])
        share = Quantity(100 * solution.unexplained, "%", "of the response unexplained, most", worst)
        remedy = "do not use its parameters: take more modes, or a narrower frequency range"
        yield Finding("misfit", (share,), remedy=remedy, error=solution.unexplained)
    if solution.has_model_error:
        yield (
            f"the residual is {np.sqrt(solution.excess):.2g} times what noise and model_error explain ({residual:.2g} "
            f"of the response): {INTERVAL_ADVICE}"
        )
    elif solution.whiteness < SIGNIFICANCE:
        yield (
            f"the residual ({residual:.2g} of the response) is not white, hence no noise: try more modes or another "
            "frequency range, and check the friction model"
        )
    if solution.model.dead_time is None:
        (values, covariance), place = _values(solution), solution.model.path_place
        if values[place] < -significant_deviation() * np.sqrt(covariance[place, place]):
            yield (
                f"the dead time is {values[place]:.3g} s: the method removes more delay than there is; lower its dead "
                "times, or fix dead_time"
            )
