"""The plant model of eq (1) with a dead time, from a frequency response."""

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from fraexp.api import (
    Curve,
    Estimator,
    Fit,
    FrequencyResponse,
    Metric,
    Outcome,
    ParameterError,
    RecordError,
    Result,
    Signals,
    param,
)
from fraexp_plugins.identification.log_response import LogResponse, Weighting, log_response
from fraexp_plugins.identification.modal_doubts import doubts
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_order import (
    Choice,
    chosen_by_hold_out,
    chosen_by_information,
    greatest_order,
    of_order,
)
from fraexp_plugins.identification.modal_solver import NOT_WHITE, Solution, counted
from fraexp_plugins.identification.whiteness import whiteness

PLANT_UNIT = "m/N"
HOPELESS = 0.5
"""Root mean square of ln(G_m/Ĝ) that is no fit: a factor of 1.6."""
CERTAIN = 2.0
"""Standard deviations from which a dead time counts as negative."""
WIDENED = (
    "the intervals are widened for what of it may hide in the parameters, but do not know what friction does to the "
    "whole band; try more modes or a narrower band, or a method that takes friction off"
)
DRAWN = 400
"""Frequencies of the fitted model's curve: enough for a resonance with 1 % damping."""


class ModalFit(Estimator, name="modal_fit", version=3):
    """P_d(s) e^{-Ls} of the paper's eq (1), fitted to the response of `method`: rigid body, modes and dead time.

    Minimises Σ w_k |ln(G_m(jω_k)/Ĝ_k)|², the weighted logarithmic residual (J. D. Sidman, F. E. DeAngelis and
    G. C. Verghese, IEEE Trans. Automatic Control 36(9), 1991; R. Pintelon et al., IEEE Trans. Automatic Control 39(11),
    1994, doi 10.1109/9.333769), with 1/w_k the variance of ln Ĝ_k by noise and `floor`, or all points alike. No start
    values are needed. The covariance of the parameters is that which the covariance of the response causes; where that
    is unknown, or does not explain the residuals, it is taken from them; what is no noise does not average out, and
    counts as one residual for each parameter. An error that is alike at all frequencies shows in no residual.

    A dead time that is not given is found. It takes half a sample time with it where the response still has a hold: let
    the method take off the hold (`remove_delay`), and its magnitude is taken off as well. Rigid body and modes then are
    `gain`, `frequencies`, `damping_ratios` and `residues` of the plant `modal`.

    Metrics: the parameters, whose covariance is in the fit; `residual` is the root mean square of ln(G_m/Ĝ), `cost` the
    weighted sum of squares over what noise and `floor` explain (1 if the model is right; not given where noise is
    unknown), `beyond` the share of points off by more than their 95 % limit, `whiteness` the probability of residuals
    as correlated along the frequencies as these, by chance. The error by a wrong friction model is no noise, and known
    to none of them.

    A number of modes that is found holds none that the data do not carry: outside of the band, damped so much that it
    has no peak, or with a residue that leaving out points may make 0. The message says what was dropped. Where
    residuals are alike at neighbouring frequencies they count as fewer, for the covariance and for `criterion`.

    Not to be used where friction has left its mark in the response, unless that is what shall be shown: the fit follows
    the response, not the plant.
    """

    fits: ClassVar[str] = "plant"

    method: Estimator = param("", "estimator of the response that is fitted")
    modes: int | None = param("1", "number of modes; by `criterion` if none is given", None, at_least=0, at_most=12)
    greatest: int = param("1", "greatest number of modes that is tried where none is given", 6, at_least=0, at_most=12)
    criterion: Literal["information", "hold_out"] = param(
        "", "what the number of modes is chosen by: information (extended BIC) or hold_out", "information"
    )
    lowest: float = param("Hz", "lower limit of the band that is fitted", 0.0, at_least=0)
    highest: float | None = param("Hz", "upper limit of the band; none if none is given", None, above=0)
    dead_time: float | None = param("s", "dead time L that is held; found if none is given", None)
    viscous: bool = param("", "whether a viscous coefficient of the rigid body is fitted", False)
    quantity: Literal["complex", "magnitude"] = param(
        "", "what is fitted: complex, or magnitude alone, which knows no dead time", "complex"
    )
    weighting: Weighting = param(
        "", "noise (1/σ), relative (all points alike), or automatic: noise where it is known", "automatic"
    )
    floor: float = param("1", "relative error of the model that is allowed for besides noise", 1e-3, above=0)

    def model_post_init(self, context: object) -> None:
        """Check the band."""
        if self.highest is not None and self.highest <= self.lowest:
            raise ParameterError(f"modal_fit.highest is {self.highest:g} Hz; expected more than lowest")

    def estimate(self, signals: Signals) -> Result:
        """Return the response of `method`, and the plant that is fitted to it."""
        found = self.method.estimate(signals)
        if found.response is None:
            if found.outcome is Outcome.OK:
                raise RecordError(f"modal_fit: {self.method.name} gives no response to fit; choose another method")
            return found
        try:
            fit = self.fit_of(found.response)
        except RecordError as error:
            if found.outcome is Outcome.OK:
                raise
            return replace(found, message=f"{found.message}; {error}")  # it is the signals that are at fault
        return replace(
            found,
            message="; ".join(text for text in (found.message, fit.message) if text),
            metrics=(*found.metrics, *fit.metrics),
            curves=(*fit.curves, *found.curves),
            fits=(*found.fits, *fit.fits),
        )

    def fit_of(self, response: FrequencyResponse) -> Result:
        """Return a response with the plant that is fitted to it; RecordError if there is none."""
        solution, remark = self._fitted(response)
        return Result(
            Outcome.OK,
            remark,
            response,
            tuple(self._metrics(solution, response.unit)),
            (_model(solution, response.unit), _errors(solution)),
            (self._fit(solution, response.unit),),
        )

    def _fitted(self, response: FrequencyResponse) -> tuple[Solution, str]:
        """Return the fit to a response, and what is to be said of it."""
        band = (self.lowest, np.inf if self.highest is None else self.highest)
        data = log_response(response, band, self.weighting, self.floor, 1 if self.quantity == "magnitude" else 2)
        dead_time = 0.0 if self.quantity == "magnitude" and self.dead_time is None else self.dead_time
        if not data.frequency.size:
            raise RecordError("modal_fit: no settled point lies within the band; widen it by 'lowest' and 'highest'")
        limits = float(data.frequency[0]), float(data.frequency[-1])
        model = ModalModel(self.modes or 0, *limits, self.viscous, dead_time)
        solution, doubtful = self._solved(model, data)
        remarks = []
        if self.viscous and solution.model.rate(solution.p) < 0:
            solution, doubtful = self._solved(replace(model, viscous=False), data)
            remarks.append("the viscous coefficient comes out negative, and is held at 0")
        if doubtful:
            remarks.append(doubtful)
        return solution, "; ".join([*remarks, *_remarks(solution)])

    def _solved(self, model: ModalModel, data: LogResponse) -> tuple[Solution, str]:
        """Return the fit, and what is to be said of modes that the data do not carry."""
        greatest = greatest_order(data, model)
        if greatest < model.modes:
            told = f"tell {counted(greatest, 'mode')} at most" if greatest >= 0 else "are too few even for a rigid body"
            raise RecordError(
                f"modal_fit: the {data.frequency.size} settled points from {model.lowest:.4g} to {model.highest:.4g} "
                f"Hz {told}; record more, widen the band, or ask for fewer modes"
            )
        if self.modes is not None:
            solution = of_order(model, data)
            against = "; ".join(doubts(solution))
            advice = "ask for fewer modes or another band" if self.modes else "choose another band, or more modes"
            remark = f"the data do not carry {against}: {advice}" if against else ""
        else:
            choose = chosen_by_information if self.criterion == "information" else chosen_by_hold_out
            choice = choose(model, data, min(greatest, self.greatest))
            solution, remark = (
                _sound(choice),
                f"dropped, for the data do not carry it: {choice.dropped}" * bool(choice.dropped),
            )
        if solution.untold:
            raise RecordError(
                f"modal_fit: the response does not tell {', '.join(solution.untold)}: ask for fewer modes, hold the "
                "dead time, or record more points around the modes"
            )
        left = solution.left
        if left > HOPELESS:
            raise RecordError(
                f"modal_fit: the model is off by {left:.2g} in the logarithm, which is no fit: choose by 'lowest' and "
                "'highest' the band that was excited and in which friction has left no mark, or more modes; the "
                "response must be position over force" + f" ({remark})" * bool(remark)
            )
        return solution, remark

    def _fit(self, solution: Solution, unit: str) -> Fit:
        """Return the plant with the covariance of its parameters; a dead time that is held has none."""
        model, values, covariance = solution.model, *_values(solution)
        names, units = model.names(), _units(model, unit)
        if self.dead_time is not None:
            names, units, values = (*names, "dead_time"), (*units, "s"), np.append(values, self.dead_time)
            covariance = np.pad(covariance, (0, 1))
        return Fit("plant", model.plant(solution.p).spec(), names, units, values, covariance)

    def _metrics(self, solution: Solution, unit: str) -> Iterator[Metric]:
        model, data = solution.model, solution.data
        for name, value, of in zip(model.names(), model.values(solution.p), _units(model, unit), strict=True):
            yield Metric(_symbol(name), float(value), of)
        yield Metric("modes", float(model.modes), "1")
        yield Metric("points", float(data.frequency.size), "1")
        yield Metric("residual", solution.left, "1")
        if data.covariance is not None:
            yield Metric("cost", solution.excess, "1")
        yield Metric("beyond", float(np.mean(_normalised(solution) > 1)), "1")
        yield Metric("whiteness", _whiteness(solution), "1")


def _sound(choice: Choice) -> Solution:
    """Return the fit that was chosen; RecordError if there is none."""
    if choice.solution is None:
        raise RecordError(
            "modal_fit: no number of modes gives a fit that the response carries"
            + f": {choice.dropped}" * bool(choice.dropped)
            + "; choose by 'lowest' and 'highest' the band in which friction and noise have left no mark, or a method "
            "that takes friction off; the response must be position over force"
        )
    return choice.solution


def _values(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return values and covariance of the parameters in SI units."""
    slopes = solution.model.slopes(solution.p)
    return solution.model.values(solution.p), slopes @ solution.stated @ slopes.T


def _units(model: ModalModel, unit: str) -> tuple[str, ...]:
    """Return the units of the parameters for a response in this unit."""
    plant = unit == PLANT_UNIT
    ends = ["N s/m" if plant else f"s/({unit})"] * model.viscous + ["s"] * (model.dead_time is None)
    return ("m/(N s**2)" if plant else f"({unit})/s**2", *["Hz", "1", "1"] * model.modes, *ends)


def _symbol(name: str) -> str:
    """Return the literature's letter for a parameter, such as f1 for frequencies.0."""
    head, _, number = name.partition(".")
    letters = {"gain": "k0", "frequencies": "f", "damping_ratios": "ζ", "residues": "r"}
    letters |= {"viscous_coefficient": "D", "dead_time": "L"}
    return letters[head] + (str(int(number) + 1) if number else "")


def _normalised(solution: Solution) -> np.ndarray:
    """Return |ln(G_m/Ĝ)| over its 95 % limit, shape (n,)."""
    data = solution.data
    scale = solution.excess if data.covariance is None else 1.0
    limit = -2 * np.log(0.05) if data.parts == 2 else 1.959964**2
    squared = np.sum(data.stacked(solution.error).reshape(data.parts, -1) ** 2, axis=0)
    return np.asarray(np.sqrt(squared / max(scale * limit, 1e-300)))


def _model(solution: Solution, unit: str) -> Curve:
    """Return the fitted model over the band, close enough for its resonances; no phase if none was fitted."""
    data, model = solution.data, solution.model
    low, high = float(data.frequency[0]), float(data.frequency[-1])
    modes = model.poles(solution.p)[:, 0]
    within = modes[(low < modes) & (modes < high)]
    frequency = np.unique(np.concatenate([np.geomspace(low, high, DRAWN), within]))
    log_model = model.log_response(solution.p, 2j * np.pi * frequency)
    columns = {"frequency": frequency, "magnitude": np.exp(log_model.real)}
    if data.parts == 2:
        columns["phase"] = np.angle(np.exp(1j * log_model.imag), deg=True)
    units = {"frequency": "Hz", "magnitude": unit, "phase": "deg"}
    return Curve("plant fit", columns, {name: units[name] for name in columns})


def _errors(solution: Solution) -> Curve:
    """Return what the fitted model leaves of the response, over the frequencies of its points."""
    data = solution.data
    columns = {"frequency": data.frequency, "magnitude error": np.expm1(solution.error.real)}
    if data.parts == 2:
        columns["phase error"] = np.degrees(solution.error.imag)
    columns["error over 95 % limit"] = _normalised(solution)
    units = {"frequency": "Hz", "phase error": "deg"}
    return Curve("plant fit error", columns, {name: units.get(name, "1") for name in columns})


def _remarks(solution: Solution) -> Iterator[str]:
    """Yield what speaks against the fit."""
    left = solution.left
    if solution.errs:
        yield (
            f"the model leaves {np.sqrt(solution.excess):.2g} times what noise and 'floor' explain ({left:.2g} of the "
            f"response): {WIDENED}"
        )
    elif solution.marked:
        yield f"the model leaves {left:.2g} of the response, and how much of that is noise is not known: {WIDENED}"
    elif _whiteness(solution) < NOT_WHITE:
        yield (
            f"what the model leaves ({left:.2g} of the response) is not white, so that it errs by more than the "
            "standard deviations say: try more modes or another band, and mind friction"
        )
    if solution.model.dead_time is None:
        values, covariance = _values(solution)
        if values[-1] < -CERTAIN * np.sqrt(covariance[-1, -1]):
            yield (
                f"the dead time comes out as {values[-1]:.3g} s: the method takes off more delay than there is; lower "
                "its dead times, or hold 'dead_time'"
            )


def _whiteness(solution: Solution) -> float:
    return whiteness(solution.data.stacked(solution.error), solution.data.parts)
