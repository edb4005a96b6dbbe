"""The fit of plant and friction to all records of an experiment: where it begins, where it ends, and what it tells."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    COARSE_DIFFERENCE,
    CURVE_POINTS,
    NORMAL_QUANTILE,
    SIGNIFICANCE,
    Curve,
    Finding,
    Fit,
    FrictionModel,
    Metric,
    RecordError,
    Result,
    Signals,
    frequency_text,
)
from fraexp_plugins.estimators._shared.effective_input_observer import EFFECTIVE_INPUT
from fraexp_plugins.estimators._shared.realisations import Part, combine_parts, realisation_groups
from fraexp_plugins.identification._law_comparison import fit_each
from fraexp_plugins.identification._law_numbers import numbers_of, scaled_friction
from fraexp_plugins.identification._likelihood import LinearRecord, NoiseLevel, greatest_ratio, likely_noise
from fraexp_plugins.identification._machine_problem import NOISE, SCALES, MachineProblem, Models
from fraexp_plugins.identification._modal_model import GROUND, parameter_symbol
from fraexp_plugins.identification._modal_solver import whiteness
from fraexp_plugins.identification._motion_start import (
    PLANT_MODEL_ERROR,
    MotionFit,
    MotionRecords,
    fits_along_motion,
    spread_records,
)
from fraexp_plugins.identification._record_fit import HOPELESS_RATIO, SMALL_STEP, LinearisedFit, RecordFit, State
from fraexp_plugins.identification._replayed_record import Trial, positions_of
from fraexp_plugins.plants.modal import Modal

STEPS_FACTOR = 4
"""Factor on the steps of the finer replay, whose error is a fifteenth of the coarser one's. Half of it moves parameters
by a twentieth of their intervals."""
REMAINING_SMOOTH, REMAINING_WITH_EVENTS = 2.0 / (STEPS_FACTOR**2 - 1), 1.0 / (STEPS_FACTOR - 1)
"""Error of the finer replay over its difference to the coarser one: twice that of second order, and, for laws with
events, which are not replayed in lanes, that of first order."""


class ReplayError(NamedTuple):
    """Changes by a finer replay, and how much of an error it leaves."""

    shared_change: NDArray[np.float64]
    """Those of the shared parameters, shape (p,)."""
    inverse_change: tuple[NDArray[np.complex128], ...]
    """Those of 1/P̂ of each record [N/m], shape (lines,) each."""
    remaining: float
    """Error that the finer replay may have, over the changes; NaN if it diverges, with changes of 0."""


def replay_error(found: "Fitted", joint: "Fitted | None" = None) -> ReplayError:
    """Return how a finer replay changes parameters and 1/P̂: by one Newton step towards its greatest likelihood.

    The shared parameters are those of a joint fit, if it is given: the finer replay moves its records alike.
    """
    fit, state, linear = found.fit, found.state, found.linear
    finer = fit.with_more_steps(STEPS_FACTOR)
    model = finer.free.applied_to(finer.start, state.shared)
    positions = positions_of([Trial(r, model.replay, own) for r, own in zip(fit.records, state.own, strict=True)])
    if not all(np.isfinite(position).all() for position in positions):
        return ReplayError(np.zeros(state.shared.size), tuple(np.zeros_like(each) for each in linear.inverse), np.nan)
    pairs = zip(linear.records, fit.records, state.own, positions, strict=True)
    changes = [record.residual(own, position) - each.residual for each, record, own, position in pairs]
    still = np.zeros(state.shared.size)
    shared = still if joint is None else joint.fit.newton_step(_moved(joint.linear, changes), still).shared
    after = fit.newton_step(_moved(linear, changes), shared)
    inverse = []
    for place, (record, own, position) in enumerate(zip(fit.records, state.own, positions, strict=True)):
        parameters = np.concatenate([after.shared, after.own[place]])
        direct = record.inverse_response(model, own, position) - linear.inverse[place]
        inverse.append(direct + linear.inverse_slopes[place] @ parameters)
    is_smooth = all(friction.is_vectorisable for friction in model.replay.frictions.values())
    return ReplayError(after.shared, tuple(inverse), REMAINING_SMOOTH if is_smooth else REMAINING_WITH_EVENTS)


def _moved(linear: LinearisedFit, changes: Sequence[NDArray[np.float64]]) -> list[LinearRecord]:
    """Return linearised records whose residuals have changed."""
    return [a._replace(residual=a.residual + b) for a, b in zip(linear.records, changes, strict=True)]


@dataclass(frozen=True)
class Fitted:
    """A fit, the state of greatest likelihood, and the records around it."""

    fit: RecordFit
    state: State
    linear: LinearisedFit
    error: ReplayError | None = None
    """How the replay's steps falsify it; None for a fit that is no result."""

    @property
    def shared(self) -> NDArray[np.float64]:
        """Logarithms of the shared factors, shape (p,), without the known error of the replay's steps where models
        allow that.
        """
        if self.error is None:
            return self.state.shared
        changed = self.fit.free.limit(self.state.shared + self.error.shared_change)
        return self.state.shared if self.fit.model_at(changed) is None else changed

    @property
    def inverse(self) -> list[NDArray[np.complex128]]:
        """1/P̂ of each record [N/m], likewise, shape (lines,) each."""
        assert self.error is not None
        return [a + b for a, b in zip(self.linear.inverse, self.error.inverse_change, strict=True)]

    @property
    def shared_error(self) -> NDArray[np.float64]:
        """What the replay's steps may still falsify of the shared logarithms, shape (p,), and what is not corrected."""
        assert self.error is not None
        uncorrected = self.state.shared + self.error.shared_change - self.shared
        return np.asarray(self.error.remaining * self.error.shared_change + uncorrected)

    @property
    def inverse_error(self) -> list[NDArray[np.float64]]:
        """What they may still falsify of 1/P̂ of each record, relatively, shape (lines,) each."""
        assert self.error is not None
        pairs = zip(self.error.inverse_change, self.inverse, strict=True)
        return [self.error.remaining * np.abs(change / inverse) for change, inverse in pairs]

    @property
    def is_exact(self) -> bool:
        """Whether the replay's steps falsify most responses by less than samples leave open."""
        covariances = np.concatenate(self.inverse_covariances)
        std = np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1]) / np.abs(np.concatenate(self.inverse))
        return float(np.median(np.concatenate(self.inverse_error) / std)) < 1

    @cached_property
    def covariances(self) -> tuple[NDArray[np.float64], ...]:
        """Covariance of shared parameters and those of one record, for each, shape (p + m, p + m)."""
        return self.fit.covariances(self.linear)

    @cached_property
    def inverse_covariances(self) -> list[NDArray[np.float64]]:
        """Covariance of (real, imaginary) part of 1/P̂ of each record [N²/m²], shape (lines, 2, 2)."""
        found = []
        for slopes, covariance in zip(self.linear.inverse_slopes, self.covariances, strict=True):
            parts = np.stack([slopes.real, slopes.imag], axis=1)
            found.append(parts @ covariance @ parts.transpose(0, 2, 1))
        return found

    def with_noise(self, noise: float) -> "Fitted":
        """Return the fit with another noise [m] in the likelihood, at its greatest; what is expected stays the same."""
        expected = self.fit.noise if self.fit.expected_noise is None else self.fit.expected_noise
        fit = replace(self.fit, noise=noise, expected_noise=expected)
        state, linear = fit.converge(self.state, self.linear)
        return replace(self, fit=fit, state=state, linear=linear)

    @property
    def models(self) -> Models:
        """Machine with the parameters that were found."""
        return self.fit.free.applied_to(self.fit.start, self.shared)

    @property
    def friction(self) -> FrictionModel | None:
        """Friction model that was found; None if the parameters of its law cannot express the scales."""
        stroke = max(float(np.ptp(record.position)) for record in self.fit.records)
        return scaled_friction(self.models.friction, self.models.scales, stroke)

    @property
    def ratios(self) -> NDArray[np.float64]:
        """Residual of each record over what noise and rounding explain of it, shape (records,)."""
        return self.fit.residual_ratios(self.linear)

    @property
    def mean_ratio(self) -> float:
        """Geometric mean of the ratios."""
        return self.fit.mean_ratio(self.linear)

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood per sample, with the noise that suits the records best."""
        return likely_noise(self.linear.records, float(self.fit.freedom.sum())).log_likelihood

    def criterion(self, parameters: int) -> float:
        """Return the Bayesian information criterion, of which the least is best, for so many parameters.

        (G. Schwarz, Annals of Statistics 6(2), 1978.)
        """
        samples = sum(record.residual.size for record in self.linear.records)
        return parameters * float(np.log(samples)) - 2 * samples * self.log_likelihood

    @property
    def explains(self) -> bool:
        """Whether it leaves of all records together no more than noise and rounding."""
        return self.mean_ratio <= float(greatest_ratio(float(self.fit.freedom.sum())))


def along_directions(found: Fitted) -> Fitted:
    """Return the fit with derivatives along the principal directions of its covariance, if parameters act alike.

    The derivatives by two such parameters are nearly the same, and their errors, divided by the little that is left,
    end a search anywhere in the valley that the likelihood has there, with a band that is too narrow.
    """
    if not found.explains or not found.state.shared.size:
        return found
    covariance = found.covariances[0][: found.state.shared.size, : found.state.shared.size]
    information = np.linalg.inv(covariance)
    scale = np.sqrt(np.diag(information))
    # in units of what each tells alone: the derivatives are right to about as much
    if np.linalg.eigvalsh(information / np.outer(scale, scale))[0] > COARSE_DIFFERENCE:
        return found
    squares, directions = np.linalg.eigh(covariance)
    sizes = np.clip(np.sqrt(np.maximum(squares, 0)), COARSE_DIFFERENCE, SMALL_STEP)
    fit = replace(found.fit, directions=directions * sizes)
    return Fitted(fit, *fit.converge(found.state))


def without_plant(fit: RecordFit, shared: NDArray[np.float64], effective: Sequence[NDArray[np.complex128]]) -> Fitted:
    """Return the fit in which each record has its own response, at first the observer's: the plant may lack a mode."""
    own = tuple(
        record.parameters_for(each, fit.start.plant) for record, each in zip(fit.records, effective, strict=True)
    )
    return Fitted(fit, *fit.converge(State(shared, own)))


def with_own_responses(found: Fitted) -> Fitted:
    """Return the fit in which each record has a response of its own; what all share stays that of the joint fit.

    The joint fit is efficient: samples that told the shared parameters once would move them off it the second time.
    """
    count = found.state.shared.size
    known = found.covariances[0][:count, :count] if count else None
    stds = np.array([record.std for record in found.linear.records])
    own = replace(found.fit, has_own_forces=True, shared_covariance=known, prior_stds=stds)
    whole = Fitted(own, *own.converge(found.state, found.linear))
    return replace(whole, error=replay_error(whole, found))


MAX_REFINEMENTS = 2
"""How often the replay's steps are refined, fourfold each time, while they falsify the result."""


def fit_machine(problem: MachineProblem, known: Fitted | None = None) -> tuple[Fitted, int]:
    """Return the fit to all records, and from how many starts it was tried.

    The response of each record is first that of the plant, whose numbers are estimated with those of friction. At last
    each record has a response of its own, unless friction acts at several contacts. `known` is a joint fit to other
    records of the same machine, from which it starts without a search; else some of the records lead near.
    """
    few = replace(problem, signals=spread_records(problem.signals))
    joint, starts = joint_fit(few) if known is None else (known, 1)
    every = replace(joint.fit, records=RecordFit.around(problem, joint.fit.start.plant).records)
    every = every.with_needed_drifts(State(joint.state.shared, tuple(np.zeros(r.count) for r in every.records)))
    whole = _whole(problem, every, joint)
    for _ in range(MAX_REFINEMENTS):
        if whole.is_exact or whole.mean_ratio > HOPELESS_RATIO:
            break
        every = replace(every, start=whole.fit.start).with_more_steps(STEPS_FACTOR)
        whole = _whole(problem, every, whole)
    return whole, starts


def joint_fit(problem: MachineProblem, starts: Sequence[MotionFit] = ()) -> tuple[Fitted, int]:
    """Return the fit in which the response of every record is that of the plant, and from how many starts it was tried.

    `starts` are fits along the motion, if they are known. A start that is far from explaining the records is given up
    after a few steps, unless it is the only one.
    """
    starts = starts or fits_along_motion(problem)

    def fit_from(start: MotionFit) -> Fitted:
        fit = RecordFit.around(problem, start.plant)
        return _converged(problem, fit, start.shared, gives_up=len(starts) > 1)

    found, left_out = fit_each(starts, fit_from, is_last=lambda each: each.explains)
    return min(found, key=lambda each: each.mean_ratio), len(found) + len(left_out)


def predicted_ratios(problem: MachineProblem, found: Fitted, signals: Signals) -> tuple[NDArray[np.float64], float]:
    """Return what a joint fit leaves of other records, over what noise and rounding explain, shape (records,), and the
    degrees of freedom of all of them.
    """
    records = RecordFit.around(replace(problem, signals=signals), found.fit.start.plant).records
    fit = replace(found.fit, records=records)
    return fit.predicted_ratios(found.state.shared), float(fit.freedom.sum())


def least_told(found: Fitted) -> str:
    """Return which parameter the records tell least, of friction's or of several contacts'; empty if they tell all."""
    free = found.fit.free
    names = free.friction if found.models.has_one_contact else free.names
    if not found.explains or not names:
        return ""
    std = np.sqrt(np.diag(found.covariances[0])[: len(names)])
    place = int(np.argmax(std))
    is_told = NORMAL_QUANTILE * std[place] < 1  # else its 95 % interval reaches 0, to first order
    return "" if is_told else names[place]


def _whole(problem: MachineProblem, fit: RecordFit, before: Fitted) -> Fitted:
    """Return the fit of all records with a response for each, from a joint one."""
    joint = along_directions(_without_untold_parts(problem, _converged(problem, fit, before.state.shared)))
    if problem.frictions:
        return replace(joint, error=replay_error(joint))
    whole = with_own_responses(joint)
    if whole.explains:
        return whole
    logs = before.state.shared[: len(problem.free.names)]
    models = before.fit.free.applied_to(before.fit.start, before.state.shared)
    effective = MotionRecords.of(problem).effective(models)
    try:
        alone = without_plant(replace(fit, free=problem.free), logs, effective)
    except RecordError:  # it diverges, and the joint fit did not
        return whole
    if alone.mean_ratio > whole.mean_ratio:
        return whole
    return replace(alone, error=replay_error(alone))


def _without_untold_parts(problem: MachineProblem, joint: Fitted) -> Fitted:
    """Return the joint fit without modes, and springs or dampers to ground, that the records do not tell.

    Noise looks like a mode to the observer where friction hides the plant, and presliding friction like a spring. They
    then take part of the rigid body's motion, so that friction's scales and the plant are known several times worse.
    """
    plant = joint.models.plant
    if not isinstance(plant, Modal) or problem.modes is not None or not joint.fit.free.plant or not joint.explains:
        return joint
    std = np.sqrt(np.diag(joint.covariances[0])[len(problem.free.names) : joint.state.shared.size])
    chance = np.log(sum(record.residual.size for record in joint.linear.records)) * std**2  # by Wald's test
    ground = [name for name, each in zip(joint.fit.free.plant, chance, strict=True) if name in GROUND and each > 1]
    count = len(plant.frequencies)
    if ground:
        plant = plant.model_copy(update=dict.fromkeys(ground, 0.0))
    elif count and 3 * chance.max() > 1:  # a mode has three numbers
        plant, _ = MotionRecords.of(problem).plant(joint.models, count - 1, 10 * PLANT_MODEL_ERROR)
    else:
        return joint
    logs = joint.state.shared[: len(problem.free.names)]
    simpler = _converged(problem, replace(joint.fit, start=joint.fit.start.with_plant(plant)), logs)
    is_better = simpler.criterion(simpler.state.shared.size) < joint.criterion(joint.state.shared.size)
    return _without_untold_parts(problem, simpler) if is_better else joint


def _converged(problem: MachineProblem, fit: RecordFit, shared: NDArray[np.float64], gives_up: bool = True) -> Fitted:
    """Return the fit in which every response is that of the plant."""
    free = problem.free_of(fit.start.plant)
    joint = replace(fit, free=free, has_own_forces=False)
    missing = np.zeros(len(free.names) - shared.size)
    state = State(np.append(shared, missing), tuple(np.zeros(record.count) for record in fit.records))
    return Fitted(joint, *joint.converge(state, gives_up=gives_up))


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
        has_dither = fit.noise > 0 and fit.noise >= fit.resolution / 2  # rounding errors are white from here on
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
    numbers = list(numbers_of(friction))
    known = [each for each in numbers if each.is_scaled]
    known += [each for each in numbers if each.name in free and not each.is_scaled]
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
    found = turn @ covariance @ turn.transpose(0, 2, 1)
    return np.asarray(found + found.transpose(0, 2, 1)) / 2  # without the asymmetry of the last bits
