"""The fit of a modelled machine to records: Gauss-Newton steps whose trial lengths run side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import (
    COARSE_DIFFERENCE,
    CONVERGED,
    MAX_ITERATIONS,
    ROUNDING,
    ParameterError,
    Plant,
    RecordError,
    frequency_text,
)
from fraexp_plugins.identification._likelihood import FitStep, LinearRecord, fit_linear, greatest_ratio, interval_loss
from fraexp_plugins.identification._machine_problem import REPLAY_ERROR, FreeParameters, MachineProblem, Models
from fraexp_plugins.identification._replayed_record import ReplayedRecord, Trial, positions_of, prepared_records

# What half of a constant changes was measured on four fits: elements from a wrong start, with one period, with four
# periods of noise, and with four parameters free, and a LuGre law. Where nothing is said it is below 2 % of a band.
MOTION_DIFFERENCE = 0.3
"""Half width of derivatives by a force: the motion that it causes, in resolutions, as a sample tells no less."""
FIRST_RADIUS = 0.2
"""Largest first step of a shared logarithm, of a force over the control input, and of a drift over the motion."""
MAX_SMALL_GAINS = 3
"""Maximum number of steps in a row that gain little, as elements take that share a force in ways that hardly differ."""
LAST_GAIN = 0.5
"""Gain of the log-likelihood with which the last steps end: that of a standard deviation of one parameter. Half of it
moves a parameter of the LuGre law by a fifth of its interval, in half as much time again."""
HOPELESS_RATIO, FIRST_STEPS = 10.0, 4
"""Residual over what noise and rounding explain, from which a start is given up after its first steps. It saves time
alone."""
MIN_STD_RATIO = 0.03
"""Standard deviation of a position over the encoder's step that the likelihood assumes at least, as the box of a
rounded sample has walls that no step crosses. Half of it makes bands 12 % narrower and fits up to three times slower.
"""
NO_RADIUS = 1 / ROUNDING
"""Factor on the radius that holds nothing but a parameter without any effect, whose information would be singular."""
EXPECTED_SHARE, SMALL_STEP = 0.5, 0.02
"""Share of the promised gain from which a step is good, and the shared logarithm, or the share of the input that a
force is, up to which derivatives hold, as friction is nearly linear."""
START_ERROR_SHARE = 0.25
"""Error of the motion that a record's own start causes, over that motion: it counts as linear with a few states, while
friction remembers more. Measured at the true parameters of two drives: 0.24 with rolling elements, 0.02 with LuGre.
Half of it moves a parameter of the LuGre law by a tenth of its interval."""


@dataclass(frozen=True)
class State:
    """Values of all parameters."""

    shared: NDArray[np.float64]
    """Logarithms of the shared factors, shape (p,)."""
    own: tuple[NDArray[np.float64], ...]
    """Own parameters of each record, shape (m,) each."""


@dataclass(frozen=True)
class LinearisedFit:
    """The records around a state."""

    records: tuple[LinearRecord, ...]
    inverse: tuple[NDArray[np.complex128], ...]
    """1/P̂ of each record [N/m], shape (lines,) each."""
    inverse_slopes: tuple[NDArray[np.complex128], ...]
    """Its derivatives by shared and own parameters, shape (lines, p + m) each."""
    positions: tuple[NDArray[np.float64], ...]
    """Periodic position of each replay [m], shape (n,) each."""


@dataclass
class RecordFit:
    """Records, the machine that is to explain them, and the parameters that they share."""

    records: Sequence[ReplayedRecord]
    start: Models
    free: FreeParameters
    resolution: float
    noise: float
    has_own_forces: bool = True
    """Whether the response of each record is its own; otherwise it is the plant's."""
    shared_covariance: NDArray[np.float64] | None = None
    """Covariance of the shared parameters from a joint fit to the same records, where they stay, shape (p, p); None if
    this fit estimates them."""
    prior_stds: NDArray[np.float64] | float = 1.0
    """Standard deviation [m] that the likelihood of that fit assumed of each record, shape (records,)."""
    expected_noise: float | None = None
    """Noise [m] that the records show, if the likelihood assumes another one."""
    directions: NDArray[np.float64] | None = None
    """Changes of the shared parameters by which derivatives are taken, in columns, shape (p, p); each by itself if none
    are given."""

    @classmethod
    def around(cls, problem: MachineProblem, plant: Plant) -> "RecordFit":
        """Return the fit of all records to a machine with this plant and the friction at the start."""
        observer = problem.observer
        records = [ReplayedRecord.of(segment, observer) for segment in problem.signals.segments]
        return cls(records, problem.models_around(plant), problem.free, observer.resolution, observer.noise)

    def converge(
        self, state: State, known: LinearisedFit | None = None, gives_up: bool = True
    ) -> tuple[State, LinearisedFit]:
        """Return the state of greatest likelihood that steps from this one lead to, and the records around it.

        It ends before a step that promises less than `LAST_GAIN` of the log-likelihood, unless the records are still
        far from explained, where a shorter step may lead on a few times; and after the first steps if it `gives_up`
        what is hopeless. `known` has the derivatives by the shared parameters, where the machine is nearly the same.
        RecordError if the model diverges along a record at this state: it has no derivatives there.
        """
        radius, small, is_exact = 1.0, 0, known is None
        state, positions = self._with_drifts(state) if known is None else (state, known.positions)
        diverges = [
            record for record, position in zip(self.records, positions, strict=True) if not np.isfinite(position).all()
        ]
        if diverges:
            at = frequency_text(np.unique(np.concatenate([record.frequency for record in diverges])))
            raise RecordError(f"the modelled machine diverges at the start, along {len(diverges)} records ({at})")
        linear = self.linearise(state, positions, known)
        for count in range(MAX_ITERATIONS):
            if gives_up and count == FIRST_STEPS and self.mean_ratio(linear) > HOPELESS_RATIO:
                break
            move, is_explained = self._move(state, linear, radius), self._is_explained(linear)
            small = small + 1 if move.gain < LAST_GAIN else 0
            if move.radius < CONVERGED or small > MAX_SMALL_GAINS or (is_explained and not move.is_worth_it):
                break
            radius = move.radius
            if move.gain > 0:
                state, positions = move.state, move.positions
            if move.gain > 0 and move.is_as_promised:
                linear, is_exact = self._records_after(linear, move), False
            elif move.gain > 0 or not is_exact:
                linear, is_exact = self.linearise(state, positions), True
        return state, linear

    def _is_explained(self, linear: LinearisedFit) -> bool:
        return bool(np.median(self.residual_ratios(linear) / self.greatest_ratios) < 1)

    def with_needed_drifts(self, state: State) -> "RecordFit":
        """Return the fit in which the records have a start of their own, a drift where they show one, and the
        pull that they need.
        """
        model = self.free.applied_to(self.start, state.shared).replay
        return replace(self, records=prepared_records(self.records, model, state.own))

    def with_more_steps(self, factor: int) -> "RecordFit":
        """Return the fit whose replay takes more steps by a factor."""
        model = self.start.replay
        return replace(self, start=replace(self.start, replay=replace(model, refinement=factor * model.refinement)))

    def _with_drifts(self, state: State) -> tuple[State, list[NDArray[np.float64]]]:
        """Return the state with the drifts that least squares give, and the positions of its replays."""
        (positions,) = self._positions([state])
        own = []
        for record, values, position in zip(self.records, state.own, positions, strict=True):
            drift = record.drift_in(np.nan_to_num(record.residual(values, position)))
            own.append(values + np.concatenate([np.zeros(record.forces), drift]))
        return State(state.shared, tuple(own)), positions

    def _move(self, state: State, linear: LinearisedFit, radius: float) -> "_Move":
        """Return the move along the step to the greatest likelihood of the linearised records, within the radius."""
        shared, own = self._radii(radius)
        step = fit_linear(linear.records, shared, own, self._held(np.zeros(shared.size)))
        if step.gain < LAST_GAIN and self._is_explained(linear):
            return _Move(state, [], 0.0, radius)
        pairs = zip((step.shared, *step.own), (shared, *own), strict=True)
        size = max(float(np.abs(change / allowed).max(initial=0.0)) for change, allowed in pairs)
        after = self._state_along(state, step, 1 / max(size, 1.0))
        (positions,) = self._positions([after])
        replays = zip(self.records, after.own, positions, strict=True)
        residuals = [record.residual(own, position) for record, own, position in replays]
        gain = self._loss([record.residual for record in linear.records], linear) - self._loss(residuals, linear)
        is_good = gain > EXPECTED_SHARE * step.gain
        is_small = float(np.abs(step.shared).max(initial=0.0)) < SMALL_STEP and size <= 1
        factor = 2.0 if gain > 0 else min(size, 1.0) / 4  # of what helped, or of the part of the step that did not
        return _Move(after, positions, gain, factor * radius, gain >= LAST_GAIN or gain <= 0, is_good and is_small)

    def _records_after(self, linear: LinearisedFit, move: "_Move") -> LinearisedFit:
        """Return the records around a state near by, with the derivatives as they were."""
        models = self.free.applied_to(self.start, move.state.shared)
        records, inverse = [], []
        for record, each, own, y in zip(self.records, linear.records, move.state.own, move.positions, strict=True):
            residual = record.residual(own, y)
            records.append(each._replace(residual=residual, std=self._std(record, own, residual)))
            inverse.append(record.inverse_response(models, own, y))
        return replace(linear, records=tuple(records), inverse=tuple(inverse), positions=tuple(move.positions))

    def _state_along(self, state: State, step: FitStep, length: float) -> State:
        columns = [self._columns(record) for record in self.records]
        own = tuple(a + length * c.T @ b for a, c, b in zip(state.own, columns, step.own, strict=True))
        return State(self.free.limit(state.shared + length * step.shared), own)

    def _loss(self, residuals: Sequence[NDArray[np.float64]], linear: LinearisedFit) -> float:
        total = 0.0
        for residual, record in zip(residuals, linear.records, strict=True):
            total += float(interval_loss(residual, record.resolution, record.std).value.sum())
        return total if np.isfinite(total) else np.inf

    def _held(self, change: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return a change of the shared parameters if they are not estimated here."""
        return None if self.shared_covariance is None else change

    def _radii(self, radius: float) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
        own = []
        for record in self.records:
            force = np.full(record.forces, np.abs(record.control).max())
            drift = np.full(len(record.drifts), np.ptp(record.position))
            own.append(FIRST_RADIUS * radius * (self._columns(record) @ np.concatenate([force, drift])))
        return np.full(len(self.free.names), FIRST_RADIUS * radius), own

    def _columns(self, record: ReplayedRecord) -> NDArray[np.float64]:
        """Return the rows of the unit matrix that belong to a record's free parameters, shape (free, m)."""
        every = np.eye(record.count)
        return every if self.has_own_forces else every[record.forces :]

    def _positions(self, states: Sequence[State]) -> list[list[NDArray[np.float64]]]:
        """Return the periodic position [m] of each record, for each state; NaN where no model has its parameters."""
        models = [self.model_at(state.shared) for state in states]
        trials = [
            Trial(record, model.replay, own)
            for state, model in zip(states, models, strict=True)
            if model is not None
            for record, own in zip(self.records, state.own, strict=True)
        ]
        positions, missing = iter(positions_of(trials)), [np.full(r.position.size, np.nan) for r in self.records]
        return [missing if model is None else [next(positions) for _ in self.records] for model in models]

    def model_at(self, shared: NDArray[np.float64]) -> Models | None:
        """Return the machine with these parameters; None where its models do not allow them."""
        try:
            return self.free.applied_to(self.start, shared)
        except ParameterError:
            return None

    def linearised_at(self, state: State) -> LinearisedFit:
        """Return all records around a state, with the drifts that least squares give."""
        return self.linearise(*self._with_drifts(state))

    def linearise(
        self, state: State, positions: Sequence[NDArray[np.float64]], known: LinearisedFit | None = None
    ) -> LinearisedFit:
        """Return all records around a state with its positions, linearised by differences side by side.

        Shared parameters may act nearly alike, so that theirs are central. The steps of a replay falsify both ends of a
        difference alike, so that it takes coarse ones. `known` has the derivatives by the shared parameters, if they
        are not to be computed again.
        """
        count = state.shared.size
        across = COARSE_DIFFERENCE * np.eye(count) if self.directions is None else self.directions
        centre = self.free.applied_to(self.start, state.shared)
        steps = across.T if known is None else ()
        models = [self.model_at(state.shared + sign * step) or centre for step in steps for sign in (1, -1)]
        coarse = centre.replay.with_coarse_steps() if self.directions is None else centre.replay
        alike = [each.with_steps_of(coarse) for each in (centre, *models)]
        trials = [self._trials(record, alike, own) for record, own in zip(self.records, state.own, strict=True)]
        moved = iter(
            positions_of([Trial(r, m.replay, o) for r, t in zip(self.records, trials, strict=True) for m, o in t])
        )
        records, inverse, slopes = [], [], []
        for place, (record, each, own) in enumerate(zip(self.records, trials, state.own, strict=True)):
            columns, rows = self._differences(record, each, [next(moved) for _ in each])
            if known is None:
                turn = np.linalg.inv(across) / 2
                of_shared = (columns[:, 0 : 2 * count : 2] - columns[:, 1 : 2 * count : 2]) @ turn
                of_lines = (rows[:, 0 : 2 * count : 2] - rows[:, 1 : 2 * count : 2]) @ turn
            else:
                of_shared = known.records[place].jacobian[:, :count]
                of_lines = known.inverse_slopes[place][:, :count]
            width = self._force_difference(record)
            of_own = columns[:, len(models) :] / width, rows[:, len(models) :] / width
            columns = np.hstack([of_shared, of_own[0]])
            records.append(self._linear_record(record, own, record.residual(own, positions[place]), columns))
            inverse.append(record.inverse_response(centre, own, positions[place]))
            slopes.append(np.hstack([of_lines, of_own[1], np.zeros((len(rows), len(record.drifts)))]))
        return LinearisedFit(tuple(records), tuple(inverse), tuple(slopes), tuple(positions))

    def _trials(
        self, record: ReplayedRecord, models: Sequence[Models], own: NDArray[np.float64]
    ) -> list[tuple[Models, NDArray[np.float64]]]:
        """Return the machine at a state, then those with one other parameter, with a record's own parameters."""
        forces = self._force_difference(record) * np.eye(record.count)[: record.forces if self.has_own_forces else 0]
        return [*((model, own) for model in models), *((models[0], own + force) for force in forces)]

    def _differences(
        self,
        record: ReplayedRecord,
        trials: Sequence[tuple[Models, NDArray[np.float64]]],
        positions: Sequence[NDArray[np.float64]],
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return the changes of position and 1/P̂ from the first trial to each other one, (n, k) and (lines, k)."""
        # a model that diverges there tells nothing, as one that does not allow the parameters
        pairs = [
            pair if np.isfinite(pair[1]).all() else (trials[0], positions[0])
            for pair in zip(trials, positions, strict=True)
        ]
        inverse = np.array([record.inverse_response(model, own, position) for (model, own), position in pairs])
        moved = np.array([position for _, position in pairs])[:, record.settled_samples]
        return (moved[1:] - moved[0]).T, (inverse[1:] - inverse[0]).T

    def _linear_record(
        self,
        record: ReplayedRecord,
        parameters: NDArray[np.float64],
        residual: NDArray[np.float64],
        columns: NDArray[np.float64],
    ) -> LinearRecord:
        """Return a record with its residual, and its derivatives by all parameters but the drift, shape (n, p + f)."""
        jacobian = np.hstack([columns, record.drifts.T[record.settled_samples]])
        return LinearRecord(residual, jacobian, self.resolution, self._std(record, parameters, residual))

    def _force_difference(self, record: ReplayedRecord) -> float:
        amplitude, control = float(np.abs(record.measured).max()), float(np.abs(record.control).max())
        motion = MOTION_DIFFERENCE * max(self.resolution, self.noise, 1e-4 * amplitude)
        return min(motion / amplitude, SMALL_STEP) * control

    def _std(self, record: ReplayedRecord, parameters: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
        """Return the standard deviation that the likelihood of a record assumes [m]."""
        least = max(MIN_STD_RATIO * self.resolution, REPLAY_ERROR * float(np.abs(record.measured).max()))
        explained = self.resolution**2 / 12 + self.noise**2
        excess = max(float(np.mean(residual**2)) - explained, 0.0)
        start = START_ERROR_SHARE * record.start_size(parameters)
        return float(np.sqrt(least**2 + self.noise**2 + start**2 + excess))

    @property
    def freedom(self) -> NDArray[np.float64]:
        """Degrees of freedom that each record leaves, shape (records,)."""
        return np.array(
            [max(r.position[r.settled_samples].size - len(self._columns(r)), 1) for r in self.records], dtype=float
        )

    @property
    def greatest_ratios(self) -> NDArray[np.float64]:
        """Residual of each record over what explains it that chance hardly exceeds, shape (records,)."""
        independent = np.array([record.independent_samples for record in self.records], dtype=float)
        return greatest_ratio(np.minimum(self.freedom, independent))

    def residual_ratios(self, linear: LinearisedFit) -> NDArray[np.float64]:
        """Return the residual of each record over what noise, rounding and its own change explain, shape (records,)."""
        return self._ratios([each.residual for each in linear.records])

    def mean_ratio(self, linear: LinearisedFit) -> float:
        """Return the geometric mean of the ratios: a few records with a leap do not decide."""
        return float(np.exp(np.mean(np.log(self.residual_ratios(linear)))))

    def predicted_ratios(self, shared: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the same of records that shared parameters predict: all but their drift, shape (records,)."""
        state, positions = self._with_drifts(State(shared, tuple(np.zeros(record.count) for record in self.records)))
        pairs = zip(self.records, state.own, positions, strict=True)
        return self._ratios([record.residual(own, y) for record, own, y in pairs])

    def _ratios(self, residuals: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        squares = np.array([float(np.sum(each**2)) for each in residuals])
        least = np.array([REPLAY_ERROR * float(np.abs(each.measured).max()) for each in self.records])
        changes = np.array([each.change for each in self.records])
        noise = self.noise if self.expected_noise is None else self.expected_noise
        explained = np.maximum(self.resolution**2 / 12 + noise**2, changes**2 / 2) + least**2
        return np.asarray(np.sqrt(squares / (self.freedom * explained)))

    def newton_step(
        self, records: Sequence[LinearRecord], shared: NDArray[np.float64], radius: float = SMALL_STEP
    ) -> FitStep:
        """Return the step to the greatest likelihood of linearised records; `shared` is that of held parameters.

        What the records hardly tell moves little: a linearisation does not hold far away, where a step would end.
        """
        _, own = self._radii(NO_RADIUS)
        return fit_linear(records, np.full(shared.size, radius), own, self._held(shared))

    def covariances(self, linear: LinearisedFit) -> tuple[NDArray[np.float64], ...]:
        """Return the covariance of shared parameters, then those of one record, for each, shape (p + m, p + m).

        It is that of the likelihood, or, where shared parameters are held, that of what is known of them.
        """
        step = self.newton_step(linear.records, np.zeros(len(self.free.names)), NO_RADIUS)
        if self.shared_covariance is None:
            return step.covariances
        stds = np.array([record.std for record in linear.records])
        weights = np.minimum(stds / self.prior_stds, 1.0) ** 2
        forces = [record.forces for record in self.records]
        return step.covariances_beside(self.shared_covariance, weights, forces)


class _Move(NamedTuple):
    """A move from one state to another."""

    state: State
    positions: list[NDArray[np.float64]]
    """Positions of the replays there [m], shape (n,) each."""
    gain: float
    """Log-likelihood that it gains; it is not made if that is not more than 0."""
    radius: float
    """Radius of the next one."""
    is_worth_it: bool = False
    """Whether records that are explained need it, or one that is shorter."""
    is_as_promised: bool = False
    """Whether it is small, and gains what the linearised records promise: their derivatives still hold."""
