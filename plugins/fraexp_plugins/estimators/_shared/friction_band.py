"""The band of a response to the effective input: an uncertain friction model, and standstill.

The response is moved to the errors of the model that harmonics show. The error law 1/P̂ - 1/P = N - N̂ is linear in the
model's force, so that its covariance is that of 1/P̂.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    NORMAL_QUANTILE,
    Estimator,
    Finding,
    FrequencyResponse,
    FrictionModel,
    Metric,
    Quantity,
    Result,
    Signals,
    at_worst,
)
from fraexp_plugins.estimators._shared.delayed_estimator import LoopDelays
from fraexp_plugins.estimators._shared.friction_posterior import (
    FrictionPosterior,
    SineRecord,
    Stiffness,
    friction_posterior,
)

SCALES = ("force_scale", "displacement_scale")
PRIOR_STD = 0.1
"""Relative standard deviation of force and deflections of a friction model about which nothing is stated: the size that
the paper varies (Figs 12, 14 and 15) and calls unavoidable in practice."""
UNSTATED = "if it is not given 0.1, and 0 where the model is the simulated machine's own"
MIN_FACTOR = 0.1
"""Factor of a scale by its error, at least."""
CONTACTS_REMEDY = "raise the amplitude, or estimate plant and friction along the whole record (maximum_likelihood)"
"""What helps where one of several contacts stands."""

CONTRADICTED_REMEDY = (
    "check gains, signs and dead times, and identify the friction law (friction_identification with several laws, or "
    "maximum_likelihood)"
)
"""What helps where the harmonics contradict the friction model."""

Sizes = NDArray[np.float64]
"""Errors in their standard deviations, shape (p,)."""


class UncertainNumber(NamedTuple):
    """A number of an estimator that is uncertain by itself."""

    value: float
    std: float
    """Standard deviation."""
    unit: str
    least: float = -np.inf
    """Value below which it is not taken."""


class ModelErrors(NamedTuple):
    """What is uncertain of the models of an estimator: numbers first, then other errors."""

    numbers: Mapping[str, UncertainNumber]
    """Scales and a dead time that are uncertain, by their names."""
    others: int
    """Number of the other errors."""
    force_terms: Callable[[Sizes], Sequence[NDArray[np.complex128]]]
    """See `friction_posterior.ForceTerms`."""
    inverse_with: Callable[[Sizes], NDArray[np.complex128]]
    """Returns 1/P̂ of models with such errors, shape (n,)."""
    stiffness: Stiffness

    @property
    def size(self) -> int:
        """How many errors there are."""
        return len(self.numbers) + self.others

    def metrics(self, posterior: FrictionPosterior) -> tuple[Metric, ...]:
        """Return the numbers that the harmonics show, with 95 % intervals."""
        deviations = np.sqrt(np.sum(posterior.root**2, axis=1))
        found = []
        for (name, of), mean, size in zip(
            self.numbers.items(), posterior.mean.tolist(), deviations.tolist(), strict=False
        ):
            found.append(Metric(f"{name} by harmonics", max(of.value + of.std * mean, of.least), of.unit))
            found.append(Metric(f"{name} by harmonics, 95 %", NORMAL_QUANTILE * of.std * size, of.unit))
        return tuple(found) if posterior.harmonics else ()

    def contradiction(self, posterior: FrictionPosterior) -> Finding | None:
        """Return what harmonics say against the models as they are stated."""
        if not posterior.is_far:
            return None
        stated = zip(self.numbers.items(), posterior.mean.tolist(), strict=False)
        moved = [Quantity(of.value + of.std * mean, of.unit, f"{name} by harmonics") for (name, of), mean in stated]
        far = Quantity(posterior.distance, "", "standard deviations from what is stated")
        return Finding("misfit", (*moved, far), place="friction model", remedy=CONTRADICTED_REMEDY)


def knows_friction(estimator: Estimator, friction: object, signals: Signals) -> bool:
    """Return whether an estimator has the friction model of the simulated machine, unscaled."""
    if any(getattr(estimator, scale, 1.0) != 1 for scale in SCALES):
        return False
    return _are_machines_own({"friction": friction}, signals)


def knows_delays(estimator: Estimator, signals: Signals) -> bool:
    """Return whether an estimator has the dead times and lags of the simulated machine."""
    return _are_machines_own({name: getattr(estimator, name) for name in LoopDelays._fields}, signals)


def _are_machines_own(values: Mapping[str, object], signals: Signals) -> bool:
    if signals.verification is None:
        return False
    machine = signals.verification.machine
    return all(_plain(value) == _plain(machine[name]) for name, value in values.items() if name in machine)


def _plain(value: object) -> object:
    """Return friction models, alone or by the names of contacts, as data that can be compared."""
    if isinstance(value, Mapping):
        return {name: _plain(model) for name, model in value.items()}
    return value.spec() if isinstance(value, FrictionModel) else value


def prior_std(stated: float | None, model: FrictionModel, *, is_known: bool) -> float:
    """Return the relative standard deviation of a scale of a friction model."""
    unstated = 0.0 if is_known else PRIOR_STD
    return (unstated if stated is None else stated) if model.state_size else 0.0


def scale_factors(stds: Sequence[float], sizes: Sizes) -> list[float]:
    """Return the factors of scales with these relative standard deviations and errors."""
    return [max(1 + std * size, MIN_FACTOR) for std, size in zip(stds, sizes.tolist(), strict=False)]


def with_model_errors(
    found: Result, record: SineRecord | None, errors: ModelErrors | None, *, corrects: bool = True
) -> Result:
    """Return a result with the errors of its models in the band, and moved by those that its harmonics show.

    Nothing is uncertain without `errors`; without a record the prior stands. If it is not to correct the response, the
    band contains what is known to be wrong of it.
    """
    if found.response is None or errors is None:
        return found
    none, posterior = np.zeros(errors.size), FrictionPosterior.prior(errors.size)
    if record is not None:
        posterior = friction_posterior(record, errors.force_terms, errors.stiffness, errors.size)
    covariance = np.zeros((found.response.frequency.size, 2, 2))
    for column in posterior.root.T:
        sides = [errors.inverse_with(posterior.mean + side * NORMAL_QUANTILE * column) for side in (1.0, -1.0)]
        covariance += outer_parts((sides[0] - sides[1]) / (2 * NORMAL_QUANTILE))
    change = np.zeros(len(covariance), dtype=complex)
    if posterior.harmonics:
        change = errors.inverse_with(posterior.mean) - errors.inverse_with(none)
        force = np.abs([terms[0] for terms in errors.force_terms(posterior.mean)])
        with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
            covariance += ((posterior.law_error * force / found.response.output_amplitude) ** 2 / 2)[
                :, None, None
            ] * np.eye(2)
    if not corrects:
        covariance, change = covariance + outer_parts(change), 0 * change
    untold = None
    if errors.size and not posterior.examined:
        untold = Finding("no harmonics", frequencies=tuple(found.response.frequency.tolist()))
    metrics = (*found.metrics, *errors.metrics(posterior))
    found = replace(found, response=with_inverse(found.response, change, covariance), metrics=metrics)
    return found.with_findings(untold).with_findings(errors.contradiction(posterior), is_doubt=True)


def inverse_response(result: Result) -> NDArray[np.complex128]:
    """Return 1/P̂, complex, shape (n,)."""
    response = result.response.response if result.response else np.empty(0)
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        return np.asarray(1 / response)


def outer_parts(change: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the products of (real, imaginary) part of each change, shape (n, 2, 2)."""
    parts = np.stack([change.real, change.imag], axis=1)
    return np.asarray(parts[:, :, None] * parts[:, None, :])


def with_inverse(
    response: FrequencyResponse, change: NDArray[np.complex128], covariance: NDArray[np.float64]
) -> FrequencyResponse:
    """Return the response whose inverse is changed, shape (n,), and has this covariance by the model, shape (n, 2, 2).

    The band by noise keeps its size in 1/response. Where it is unknown, all of the covariance is that by the model.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        ratio = 1 / (1 + change * response.response)
    freedom = response.freedom
    if freedom is not None:
        freedom = np.where(np.isfinite(response.covariance).all(axis=(1, 2)), freedom, np.inf)
    turn = np.moveaxis(np.array([[ratio.real, -ratio.imag], [ratio.imag, ratio.real]]), -1, 0)
    turn = turn @ turn  # 1/response changes by δ where response changes by -δ response²
    return replace(
        response,
        response=response.response * ratio,
        covariance=turn @ response.covariance @ np.swapaxes(turn, 1, 2),
        input_amplitude=response.input_amplitude / np.abs(ratio),
        freedom=freedom,
        model_covariance=covariance,
    )


def with_standstill(
    found: Result, error: NDArray[np.float64] | NDArray[np.complex128], share: float, contacts: Sequence[str] = ()
) -> Result:
    """Return a result whose band contains the relative error by standstill as a standard deviation, shape (n,).

    A finding says where that is the greatest part of the band. `share` is the largest share of the time for which the
    machine, or one of the contacts, stands.
    """
    response = found.response
    if response is None:
        return found
    error = np.where(np.isfinite(error), error, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        unseen = (np.abs(error / response.response) ** 2 / 2)[:, None, None] * np.eye(2)
        model = unseen if response.model_covariance is None else response.model_covariance + unseen
        size, others = np.abs(response.response), np.trace(model - unseen, axis1=1, axis2=2)
        where = np.abs(error) ** 2 > np.nan_to_num(response.standard_deviation / size) ** 2 + others * size**2
    found = replace(found, response=replace(response, model_covariance=model))
    if not where.any():
        return found
    finding = at_worst(
        "hidden by standstill",
        response.frequency,
        where,
        error,
        "response off by up to",
        quantities=(Quantity(100 * share, "%", "standstill"),),
        place=f"contact {' or '.join(contacts)}" if contacts else "",
        remedy=CONTACTS_REMEDY if contacts else "",
    )
    return found.with_findings(finding)
