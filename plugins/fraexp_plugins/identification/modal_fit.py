"""The plant model of eq (1) with a dead time, from a frequency response."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar, Literal

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
from fraexp_plugins.identification.modal_model import ModalModel
from fraexp_plugins.identification.modal_order import (
    chosen_by_hold_out,
    chosen_by_information,
    greatest_order,
    of_order,
)
from fraexp_plugins.identification.modal_solver import Solution
from fraexp_plugins.identification.whiteness import whiteness

PLANT_UNIT = "m/N"
HOPELESS = 0.7
"""Root mean square of ln(G_m/Ĝ) that is no fit: a factor of two."""
NOT_WHITE = 1e-3
"""Probability below which residuals do not pass for white."""
CERTAIN = 2.0
"""Standard deviations from which a dead time counts as negative."""


class ModalFit(Estimator, name="modal_fit", version=1):
    """P_d(s) e^{-Ls} of the paper's eq (1), fitted to the response of `method`: rigid body, modes and dead time.

    Minimises Σ w_k |ln(G_m(jω_k)/Ĝ_k)|², the weighted logarithmic residual (J. D. Sidman, F. E. DeAngelis and
    G. C. Verghese, IEEE Trans. Automatic Control 36(9), 1991; R. Pintelon et al., IEEE Trans. Automatic Control 39(11),
    1994, doi 10.1109/9.333769), with 1/w_k the variance of ln Ĝ_k by noise and `floor`, or all points alike. No start
    values are needed. The covariance of the parameters is that which the covariance of the response causes; where that
    is unknown, or does not explain the residuals, it is taken from them.

    A dead time that is not given is found. It takes half a sample time with it where the response still has a hold: let
    the method take off the hold (`remove_delay`), and its magnitude is taken off as well. Rigid body and modes then are
    `gain`, `frequencies`, `damping_ratios` and `residues` of the plant `modal`.

    Metrics: the parameters, whose covariance is in the fit; `residual` is the root mean square of ln(G_m/Ĝ), `cost` the
    weighted sum of squares over what noise and `floor` explain (1 if the model is right; not given where noise is
    unknown), `beyond` the share of points off by more than their 95 % limit, `whiteness` the probability of residuals
    as correlated along the frequencies as these, by chance. The error by a wrong friction model is no noise, and known
    to none of them.

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
            (_curve(solution, response.unit),),
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
        solution = self._solved(model, data)
        remarks = []
        if self.viscous and solution.model.rate(solution.p) < 0:
            solution = self._solved(replace(model, viscous=False), data)
            remarks.append("the viscous coefficient comes out negative, and is held at 0")
        return solution, "; ".join([*remarks, *_remarks(solution)])

    def _solved(self, model: ModalModel, data: LogResponse) -> Solution:
        greatest = greatest_order(data, model)
        if greatest < model.modes:
            told = f"tell {greatest} modes at most" if greatest >= 0 else "are too few even for a rigid body"
            raise RecordError(
                f"modal_fit: the {data.frequency.size} settled points from {model.lowest:.4g} to {model.highest:.4g} "
                f"Hz {told}; record more, widen the band, or ask for fewer modes"
            )
        if self.modes is not None:
            solution: Solution | None = of_order(model, data)
        else:
            choose = chosen_by_information if self.criterion == "information" else chosen_by_hold_out
            solution = choose(model, data, min(greatest, self.greatest))
        if solution is None:
            raise RecordError(
                "modal_fit: no number of modes gives a fit of which all parameters are told; fix 'modes' to learn why"
            )
        if solution.untold:
            raise RecordError(
                f"modal_fit: the response does not tell {', '.join(solution.untold)}: ask for fewer modes, hold the "
                "dead time, or record more points around the modes"
            )
        left = _root_mean_square(solution)
        if left > HOPELESS:
            raise RecordError(
                f"modal_fit: the model is off by {left:.2g} in the logarithm, which is no fit: the response must be "
                "position over force; look at the channels, or choose another band or more modes"
            )
        return solution

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
        yield Metric("residual", _root_mean_square(solution), "1")
        if data.covariance is not None:
            yield Metric("cost", solution.excess, "1")
        yield Metric("beyond", float(np.mean(_normalised(solution) > 1)), "1")
        yield Metric("whiteness", _whiteness(solution), "1")


def _values(solution: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return values and covariance of the parameters in SI units."""
    slopes = solution.model.slopes(solution.p)
    return solution.model.values(solution.p), slopes @ solution.covariance @ slopes.T


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


def _curve(solution: Solution, unit: str) -> Curve:
    """Return the fitted response and what it leaves, over frequency."""
    data, model = solution.data, solution.model
    log_model = model.log_response(solution.p, data.s)
    columns: dict[str, Any] = {"frequency": data.frequency, "magnitude": np.exp(log_model.real)}
    units = {"frequency": "Hz", "magnitude": unit, "phase": "deg", "magnitude error": "1", "phase error": "deg"}
    if data.parts == 2:
        columns["phase"] = np.angle(np.exp(1j * log_model.imag), deg=True)
    columns["magnitude error"] = np.expm1(solution.error.real)
    if data.parts == 2:
        columns["phase error"] = np.degrees(solution.error.imag)
    columns["error over 95 % limit"] = _normalised(solution)
    units["error over 95 % limit"] = "1"
    return Curve("plant fit", columns, {name: units[name] for name in columns})


def _remarks(solution: Solution) -> Iterator[str]:
    """Yield what speaks against the fit."""
    left = _root_mean_square(solution)
    if solution.errs:
        explained = np.sqrt(solution.data.expected / np.sum(solution.data.weight))
        yield (
            f"the model leaves {left:.2g} of the response, where noise and 'floor' explain {explained:.2g}: try more "
            "modes or a narrower band, and mind friction"
        )
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


def _root_mean_square(solution: Solution) -> float:
    """Return the root mean square of ln(G_m/Ĝ), of its real part alone if the magnitude alone is fitted."""
    error = np.stack([solution.error.real, solution.error.imag][: solution.data.parts])
    return float(np.sqrt(np.mean(np.sum(error**2, axis=0))))


def _whiteness(solution: Solution) -> float:
    return whiteness(solution.data.stacked(solution.error), solution.data.parts)
