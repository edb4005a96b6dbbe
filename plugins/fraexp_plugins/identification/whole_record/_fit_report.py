"""What a fit to whole records tells: the response with its band, the parameters, and whether to believe them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    CURVE_POINTS,
    NORMAL_QUANTILE,
    Curve,
    Finding,
    Fit,
    FrictionModel,
    Metric,
    Result,
    Signals,
    frequency_text,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.parameter_uncertainty import parameter_unit, parameter_value
from fraexp_plugins.estimators._shared.realisations import Part, combine_parts, realisation_groups
from fraexp_plugins.identification._shared.law_numbers import (
    ScaledParameter,
    scaled_parameters,
)
from fraexp_plugins.identification.plant._modal_model import parameter_symbol
from fraexp_plugins.identification.plant._modal_solver import whiteness
from fraexp_plugins.identification.whole_record._joint_fit import SIGNIFICANCE, NoiseLevel
from fraexp_plugins.identification.whole_record._machine_fit import Fitted
from fraexp_plugins.identification.whole_record._machine_problem import DEAD_TIME, NOISE, SCALES

MIN_DITHER_RATIO = 0.5
"""Noise over the encoder's steps from which rounding is white: with half of it the mean error of rounding is 3 % of the
variance, and a slow motion looks coloured."""
RESIDUAL_RATIO = "residual over expectation"


@dataclass(frozen=True)
class FitReport:
    """A fit to whole records, and the signals to which it was fitted."""

    signals: Signals
    found: Fitted
    starts: int
    """How many starts were tried."""
    held: Sequence[str] = ()
    """Names of the parameters that the records do not tell."""
    noise: NoiseLevel | None = None
    """Noise, if it was estimated from the residual."""

    def result(self) -> Result:
        """Return P̂ with its band, the parameters with theirs, the residuals, and the verdict."""
        result = self._response().with_findings(self._complaint(), is_doubt=True).with_findings(*self._remarks())
        return replace(
            result,
            metrics=tuple(self._metrics()),
            curves=(*self._plant_curves(), self._curve()),
            fits=tuple(self._fits()),
        )

    def _response(self) -> Result:
        """Return P̂: the mean of the records that have the same lines, weighted by what each of them tells."""
        fit, inverses = self.found.fit, self.found.inverse
        bands, remaining = self.found.inverse_covariances, self.found.inverse_error
        place_of = {id(record.segment): place for place, record in enumerate(fit.records)}
        parts, errors = [], []
        for group in realisation_groups(self.signals):
            places = [place_of[id(segment)] for segment in group]
            inverse, covariance = _weighted_mean([inverses[k] for k in places], [bands[k] for k in places])
            output = np.mean([np.abs(fit.records[k].measured) for k in places], axis=0)
            band, amplitudes = _of_reciprocal(1 / inverse, covariance), (output * np.abs(inverse), output)
            parts.append(Part(group, group[0].frequency, 1 / inverse, band, np.inf, *amplitudes))
            errors.append(np.max([remaining[k] for k in places], axis=0))
        units = self.signals.unit(fit.records[0].input), self.signals.unit(fit.records[0].output)
        names = EFFECTIVE_INPUT, fit.records[0].output
        result = combine_parts(self.signals, parts, names=names, units=units)
        assert result.response is not None
        return replace(result, response=replace(result.response, numerical_error=np.concatenate(errors)))

    @property
    def _is_wrong(self) -> NDArray[np.bool_]:
        """Whether the model does not repeat a record, shape (records,)."""
        return self.found.ratios > self.found.fit.greatest_ratios

    @property
    def _shared_covariance(self) -> NDArray[np.float64]:
        """Covariance of the shared parameters, as the fit sees them, with the error of the replay's steps, (p, p)."""
        count, error = self.found.state.shared.size, self.found.shared_error
        return np.asarray(self.found.covariances[0][:count, :count] + np.outer(error, error))

    def _complaint(self) -> Finding | None:
        """Return what is wrong with the model; None if it repeats the records."""
        if self.found.explains:
            return self._colour()
        tried = f"none of {self.starts} starts led closer" if self.starts > 1 else "one start was tried"
        return Finding(
            "misfit",
            text=f"the model does not fit: what it leaves of {self._wrong_text()}, and {tried}",
            remedy="try another friction law, more frequencies or a nominal_plant, and state the dead times and the "
            "encoder's resolution",
        )

    def _colour(self) -> Finding | None:
        """Return what is wrong where residuals are no larger than expected, but not white; None if half of them are.

        Without noise they need not be: rounding of a slow motion is not white.
        """
        fit = self.found.fit
        has_dither = fit.noise > 0 and fit.noise >= MIN_DITHER_RATIO * fit.resolution
        chances = [whiteness(each.residual, 1) for each in self.found.linear.records] if has_dither else [1.0]
        if not np.nanmedian(chances) < SIGNIFICANCE:
            return None
        return Finding(
            "misfit",
            text="the model does not fit: what it leaves of most records is not white noise",
            remedy="try another friction law, or state the noise if the encoder's is not white",
        )

    def _wrong_text(self) -> str:
        wrong, ratios = self._is_wrong, self.found.ratios
        records = self.found.fit.records
        at = np.concatenate(
            [r.frequency for r, is_wrong in zip(records, wrong, strict=True) if is_wrong] or [np.empty(0)]
        )
        where = f" ({frequency_text(np.unique(at))})" if wrong.any() else ""
        return (
            f"{wrong.sum()} of {wrong.size} records{where} is up to {ratios.max():.3g} times as large as noise and "
            "rounding explain"
        )

    def _remarks(self) -> Iterator[Finding | str]:
        if self._is_wrong.any() and not self._complaint():
            yield f"what the model leaves of {self._wrong_text()}: their band is as much wider"
        if self.held:
            remedy = "raise the amplitude, or leave it out of free; it is held at its start"
            yield Finding("not identifiable", place=" and ".join(self.held), remedy=remedy)

    def _metrics(self) -> Iterator[Metric]:
        """Yield friction's parameters with their intervals, and how well they repeat the records.

        A number of the law is that of the law found: its scales are applied.
        """
        fit, logs = self.found.fit, self.found.shared
        values, units = fit.free.values(fit.start, logs), fit.free.units(fit.start)
        std = np.sqrt(np.diag(self._shared_covariance))
        std = std * np.abs(fit.free.slopes(fit.start, logs))
        names = (*fit.free.friction, *(parameter_symbol(name) for name in fit.free.plant))
        law = _values(self._friction_fit())
        for name, value, unit, each in zip(names, values, units, std, strict=True):
            of_law, error = law.get(name, (value, each))
            yield Metric(name, float(of_law), unit)
            yield Metric(f"{name}, 95 %", float(NORMAL_QUANTILE * error), unit)
        if self.noise is not None:
            yield Metric(NOISE, self.noise.value, self.signals.unit(fit.records[0].output))
            yield Metric(f"{NOISE}, 95 %", NORMAL_QUANTILE * self.noise.std, self.signals.unit(fit.records[0].output))
        yield Metric(RESIDUAL_RATIO, self.found.mean_ratio, "1")
        yield Metric("starts", float(self.starts), "1")

    def _plant_curves(self) -> Iterator[Curve]:
        """Yield the plant that all records share, over their frequencies; none if it was given, or explains too little.

        A response of a dozen points does not show the modes between them.
        """
        fit, logs = self.found.fit, self.found.shared
        if not fit.free.plant:
            return
        models = fit.free.applied_to(fit.start, logs)
        lines = np.concatenate([record.frequency for record in fit.records])
        low, high = float(lines.min()), float(lines.max())
        modes = [each for each in getattr(models.plant, "frequencies", ()) if low < each < high]
        frequency = np.unique(np.concatenate([np.geomspace(low, high, CURVE_POINTS), modes]))
        response = models.response(2 * np.pi * frequency)
        columns = {"frequency": frequency, "magnitude": np.abs(response), "phase": np.angle(response, deg=True)}
        record = fit.records[0]
        unit = f"{self.signals.unit(record.output)}/{self.signals.unit(record.input)}"
        yield Curve("plant fit", columns, {"frequency": "Hz", "magnitude": unit, "phase": "deg"})

    def _curve(self) -> Curve:
        frequency = np.array([record.frequency.min() for record in self.found.fit.records])
        rms = np.array([float(np.sqrt(np.mean(each.residual**2))) for each in self.found.linear.records])
        columns = {"frequency": frequency, "residual": rms, RESIDUAL_RATIO: self.found.ratios}
        return Curve("residual", columns, {"frequency": "Hz", "residual": "m", RESIDUAL_RATIO: "1"})

    def _fits(self) -> Iterator[Fit]:
        """Yield plant and friction as components, as far as they were estimated."""
        fit, logs, count = self.found.fit, self.found.shared, len(self.found.fit.free.friction)
        if fit.free.plant:
            values, units = fit.free.values(fit.start, logs)[count:], fit.free.units(fit.start)[count:]
            spread = np.outer(values, values) * self._shared_covariance[count:, count:]
            yield Fit("plant", self.found.models.plant.spec(), fit.free.plant, units, values, spread)
        friction = self._friction_fit()
        if friction is not None:
            yield friction

    def _friction_fit(self) -> Fit | None:
        """Return friction as a component; none for several contacts, and for a law whose parameters do not scale."""
        if not self.found.models.has_one_contact:
            return None
        free, friction = self.found.fit.free.friction, self.found.friction
        if friction is None:
            return None
        return _scaled_fit(friction, free, self._shared_covariance[: len(free), : len(free)])


def _values(fit: Fit | None) -> dict[str, tuple[float, float]]:
    """Return value and standard deviation of each parameter of a component by its name."""
    if fit is None:
        return {}
    std = np.sqrt(np.diag(fit.covariance))
    return dict(zip(fit.parameters, zip(fit.values.tolist(), std.tolist(), strict=True), strict=True))


def _scaled_fit(friction: FrictionModel, free: Sequence[str], covariance: NDArray[np.float64]) -> Fit:
    """Return a friction model with the covariance that its scales and free parameters, given in logarithms, cause."""
    known = list(scaled_parameters(friction))
    known += [
        ScaledParameter(name, parameter_value(friction, name), parameter_unit(friction, name), (0, 0))
        for name in free
        if name not in (*SCALES, DEAD_TIME) and name not in [each.name for each in known]
    ]
    values = np.array([each.value for each in known])
    by_scale = dict(
        zip(SCALES, np.array([each.exponents for each in known], dtype=float).reshape(-1, 2).T, strict=True)
    )
    columns = [by_scale[name] if name in SCALES else [float(each.name == name) for each in known] for name in free]
    slopes = values[:, None] * np.array(columns).reshape(len(free), len(known)).T
    names, units = tuple(each.name for each in known), tuple(each.unit for each in known)
    return Fit("friction", friction.spec(), names, units, values, slopes @ covariance @ slopes.T)


def _weighted_mean(
    values: Sequence[NDArray[np.complex128]], covariances: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the mean of complex numbers, shape (lines,) each, weighted by their information, and its covariance."""
    if len(values) == 1:
        return values[0], covariances[0]
    information = np.linalg.inv(np.array(covariances))
    covariance = np.linalg.inv(information.sum(axis=0))
    parts = np.stack([np.real(values), np.imag(values)], axis=-1)[..., None]
    mean = (covariance @ (information @ parts).sum(axis=0))[..., 0]
    return np.asarray(mean[:, 0] + 1j * mean[:, 1]), covariance


def _of_reciprocal(response: NDArray[np.complex128], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance of P̂ from that of 1/P̂: dP̂ = -P̂² d(1/P̂)."""
    factor = -(response**2)
    turn = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]]).transpose(2, 0, 1)
    return _symmetric(turn @ covariance @ turn.transpose(0, 2, 1))


def _symmetric(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance without the asymmetry of its last bits."""
    return (covariance + covariance.transpose(0, 2, 1)) / 2
