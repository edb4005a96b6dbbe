"""The paper's FRA method: measured position over the effective control input that a friction model leaves."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Self

import numpy as np

from fraexp.api import Estimator, FrequencyResponse, ParameterError, Result, Signals, param, phasors, response_result
from fraexp_plugins.estimators.effective_input import EFFECTIVE_INPUT, EffectiveInputEstimator
from fraexp_plugins.estimators.friction_uncertainty import Deviation, check_deviations, perturbed

STEPS = 2.0
"""Standard deviations on either side over which differences are taken: about as far as the band's edge."""
LEAST_SCALE = 0.9
"""Part of a scale that is taken off it at most."""


class Proposed(EffectiveInputEstimator, name="proposed", version=1):
    """P̂ = y'/û_e with û_e = G_di G_do u - f̂: the effective control input observer, eqs (2)-(5).

    The friction model is driven by y' in the time domain, the delays are applied at each frequency. With the right
    friction model P̂ is P at any amplitude; the error of a wrong one is 1/P̂ - 1/P = N - N̂, largest where 1/P is
    small. Not to be used where the friction model is only guessed, unless the guess's uncertainty is stated.

    `method` is the estimator from û_e to y', Fourier sums over whole periods if none is given. A best linear
    approximation takes off noise, a local polynomial a transient; the error of the friction model stays, but for the
    moving axis: there f̂ is a constant, whatever the model.

    A stated uncertainty of the friction model gives the covariance of 1/P̂ by the error law, with central differences
    of N̂ along each column of a square root of the parameters' covariance, over two standard deviations on either side
    where bounds allow it, and from it a band that knows of friction. Without one the band shows noise alone: that of y'
    and of the friction model that follows it. Where friction is most of the input that noise is an ellipse, and a
    circle holds less of it: of four periods 89 % at worst.
    """

    method: Estimator | None = param("", "estimator from û_e to y'; Fourier sums if none is given", None)
    force_deviation: float = param(
        "1", "relative standard deviation of the model's force ΣF_m", 0.0, at_least=0, below=1
    )
    width_deviation: float = param(
        "1", "relative standard deviation of the model's deflections Y_m, at the same ΣF_m", 0.0, at_least=0, below=1
    )
    deviations: tuple[Deviation, ...] = param(
        "", "standard deviations of single parameters, such as { parameter = 'curve.coulomb', deviation = 0.5 }", ()
    )
    correlation: tuple[tuple[float, ...], ...] = param(
        "1", "correlation matrix of `deviations`, row by row, as identification gives it; none if independent", ()
    )

    def model_post_init(self, context: object) -> None:
        """Check that the method can be given û_e, and that what deviates is there."""
        if self.method is not None and getattr(
            self.method, "takes_friction_off", isinstance(self.method, EffectiveInputEstimator)
        ):
            raise ParameterError(
                f"proposed.method is {self.method.name}, which takes friction off itself: use it alone"
            )
        if self.method is not None and "input" not in type(self.method).model_fields:
            raise ParameterError(
                f"proposed.method is {self.method.name}, which has no parameter 'input' to take û_e by"
            )
        try:
            check_deviations(self.friction, self.deviations, self.correlation)
        except ParameterError as error:
            raise ParameterError(f"proposed.{error}") from None

    def estimate(self, signals: Signals) -> Result:
        """Return y'/û_e, frequency by frequency."""
        if not signals.segments:
            return Result(signals.outcome, signals.message)
        found = self._found(signals)
        if found.response is None or not self._is_uncertain:
            return found
        covariance = self._model_covariance(signals, found.response.frequency.size)
        return replace(found, response=_with_model(found.response, covariance))

    def _found(self, signals: Signals) -> Result:
        if self.method is not None:
            given = {"input": EFFECTIVE_INPUT, "output": self.output, "remove_delay": False}
            fields = type(self.method).model_fields
            method = self.method.model_copy(update={key: value for key, value in given.items() if key in fields})
            return method.estimate(self.with_effective_input(signals))
        units = (signals.unit(self.input), signals.unit(self.output))
        inputs = self.effective_phasors(signals.segments)
        outputs = [phasors(segment, self.output) for segment in signals.segments]
        return response_result(signals, inputs, outputs, names=(EFFECTIVE_INPUT, self.output), units=units)

    @property
    def _is_uncertain(self) -> bool:
        return bool(self.force_deviation or self.width_deviation or self.deviations)

    def _model_covariance(self, signals: Signals, count: int) -> np.ndarray:
        """Return the covariance of (real, imaginary) part of 1/P̂ by the friction model, shape (n, 2, 2)."""
        total = np.zeros((count, 2, 2))
        for above, below, steps in self._neighbours():
            inverses = [_inverse(neighbour._found(signals)) for neighbour in (above, below)]
            change = (inverses[0] - inverses[1]) / (2 * steps)
            parts = np.stack([change.real, change.imag], axis=1)
            total += parts[:, :, None] * parts[:, None, :]
        return total

    def _neighbours(self) -> Iterator[tuple[Self, Self, float]]:
        """Yield the estimator with the friction model so many standard deviations above and below, error by error."""
        for scale, deviation in (("force_scale", self.force_deviation), ("width_scale", self.width_deviation)):
            if deviation:
                steps = min(STEPS, LEAST_SCALE / deviation)
                change = getattr(self, scale) * deviation * steps * np.array([1, -1])
                above, below = (self.model_copy(update={scale: float(size)}) for size in getattr(self, scale) + change)
                yield above, below, steps
        for upper, lower, steps in perturbed(self.friction, self.deviations, self.correlation, STEPS):
            yield self.model_copy(update={"friction": upper}), self.model_copy(update={"friction": lower}), steps


def _inverse(result: Result) -> np.ndarray:
    response = result.response.response if result.response else np.empty(0)
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(1 / response)


def _with_model(response: FrequencyResponse, covariance: np.ndarray) -> FrequencyResponse:
    """Return the response with the covariance by the friction model; where that of noise is unknown it is all."""
    freedom = response.freedom
    if freedom is not None:
        freedom = np.where(np.isfinite(response.covariance).all(axis=(1, 2)), freedom, np.inf)
    return replace(response, freedom=freedom, model_covariance=covariance)
