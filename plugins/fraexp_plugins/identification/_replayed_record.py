"""One record, and the positions of a modelled machine along it: what its own parameters are, and how they act."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.api import Plant, Replay, Replayed, ReplayModel, Segment, replay
from fraexp_plugins.estimators.effective_input import EffectiveInput
from fraexp_plugins.identification._likelihood import greatest_chance_gain
from fraexp_plugins.identification._machine_problem import Models

SETTLING_PART = 8
"""Part of a record that is left out, if it has as many cycles. Twice as much makes intervals 9 % wider."""
MAX_SLOW_TERMS = 8
"""Terms slower than a cycle that a drift has at most: of many cycles it wanders hardly faster."""
START_STATES = 4
"""States that a record may have its own at its start: position and velocity of the rigid body and of a mode. As many
samples before its end, in which a replay is taken there, do not count. With half of them a parameter of a LuGre law
moves by nine tenths of its interval."""


@dataclass(frozen=True)
class ReplayedRecord:
    """A segment whose periods count as one motion.

    Its own parameters are those of forces and of drift. The forces: real and negative imaginary part of a force [N]
    that is added to the control input at each excited line; by it the response at that line becomes any complex number.
    The drift [m] is added to the position: an offset, a ramp, and, of several cycles, terms slower than a cycle. A
    replay is periodic, and what the axis does besides, as it wanders with noise or slides off, is small and slow. The
    drift also has what its start causes, to which its end does not lead.
    """

    segment: Segment
    input: str
    output: str
    path: NDArray[np.complex128]
    """G_di G_do with the hold at the excited lines, shape (lines,)."""
    has_drift: bool = True
    """Whether the position may drift; otherwise it has an offset only."""
    starts: NDArray[np.float64] | None = None
    """Positions [1] that other states at its start cause, shape (terms, n); None if they are not known."""
    trend: NDArray[np.float64] | float = 0.0
    """Estimate of the drift [m], shape (n,), that a replay does not follow: a leap at its end would shake the model."""
    is_weakly_pulled: bool = False
    """Whether a replay is pulled towards the record by no more than ends an offset."""

    @classmethod
    def of(cls, segment: Segment, observer: EffectiveInput) -> "ReplayedRecord":
        """Return a segment with the delays around the plant that an observer has."""
        omega = 2 * np.pi * segment.frequency
        path = observer.input_path(omega, segment.sample_time) * observer.output_path(omega)
        return cls(segment, observer.input, observer.output, path)

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Excited lines [Hz], shape (lines,)."""
        return self.segment.frequency

    @cached_property
    def position(self) -> NDArray[np.float64]:
        """Recorded position of all periods [m], shape (n,)."""
        return self.segment.channels[self.output].ravel()

    @cached_property
    def waves(self) -> NDArray[np.float64]:
        """Cosine and sine of each excited line, shape (2 lines, n)."""
        periods, size = len(self.segment.channels[self.output]), self.position.size
        turns = np.outer(self.segment.lines * periods, np.arange(size)) / size
        return np.concatenate([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)])

    @cached_property
    def change(self) -> float:
        """Root mean square of the difference of successive periods [m]; 0 if it is unknown.

        Feedback of a rounded position, noise and slow creep keep a motion from repeating itself exactly.
        """
        periods = self.segment.channels[self.output]
        if len(periods) > 1:
            return float(np.sqrt(np.mean(np.diff(periods, axis=0) ** 2)))
        settling = self.segment.settling
        return float(np.nan_to_num(settling.residual) * self.position.std()) if settling else 0.0

    @cached_property
    def damping(self) -> float:
        """Force over velocity of a slow motion besides the recorded one [N s/m]: half of that of the recorded one, if
        it is Coulomb friction that takes the power.
        """
        velocity = 2j * np.pi * self.frequency * self.measured
        power = float(np.sum(self.control * self.path * velocity.conj()).real)
        return max(power, float(np.finfo(float).tiny)) / (2 * float(np.sum(np.abs(velocity) ** 2)))

    @property
    def settled_samples(self) -> slice:
        """Samples in which a replay has settled.

        It leaps where the record ends and begins again; of many cycles the first are left out, which show that.
        """
        cycles = int(self.segment.lines[0]) * len(self.segment.channels[self.output])
        stop = None if self.starts is None else -START_STATES
        return slice(self.position.size // SETTLING_PART if cycles >= SETTLING_PART else 0, stop)

    @cached_property
    def independent_samples(self) -> int:
        """Number of settled samples with an error of their own: that of a rounded position that stays is one."""
        return 1 + int(np.count_nonzero(np.diff(self.position[self.settled_samples])))

    @cached_property
    def drifts(self) -> NDArray[np.float64]:
        """Offset, ramp and slow terms of the drift, and those of the start, shape (d, n)."""
        size = self.position.size
        cycles = int(np.gcd.reduce(self.segment.lines)) * len(self.segment.channels[self.output])
        terms = [np.ones((1, size))]
        if self.has_drift:
            time = (np.arange(size) + 0.5) / size
            turns = 2 * np.pi * np.outer(np.arange(1, min(cycles, MAX_SLOW_TERMS + 1)), time)
            terms += [(time - 0.5)[None, :], np.cos(turns), np.sin(turns)]
        return np.concatenate(terms if self.starts is None else [*terms, self.starts])

    @property
    def forces(self) -> int:
        """Number of its own parameters that are forces; they come first."""
        return 2 * self.segment.lines.size

    @property
    def count(self) -> int:
        """Number of its own parameters."""
        return self.forces + len(self.drifts)

    def phasors(self, positions: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the phasors at the excited lines, shape (..., lines), of positions, shape (..., n)."""
        sums = positions @ self.waves.T * (2 / self.position.size)
        cosine, sine = np.split(sums, 2, axis=-1)
        return np.asarray(cosine - 1j * sine)

    @cached_property
    def measured(self) -> NDArray[np.complex128]:
        """Phasors of the recorded position [m], shape (lines,)."""
        return self.phasors(self.position)

    @cached_property
    def control(self) -> NDArray[np.complex128]:
        """Phasors of the control input [N], shape (lines,)."""
        return self.phasors(self.segment.channels[self.input].ravel())

    def parameters_for(self, effective: NDArray[np.complex128], plant: Plant) -> NDArray[np.float64]:
        """Return its parameters for an effective input û_e [N] at the lines, shape (lines,)."""
        force = (self.measured / self.response(plant) - effective) / self.path
        return np.concatenate([force.real, -force.imag, np.zeros(len(self.drifts))])

    def response(self, plant: Plant) -> NDArray[np.complex128]:
        """Return P(jω) of a plant at the lines [m/N], shape (lines,)."""
        return plant.response(2 * np.pi * self.frequency)

    def inverse_response(
        self, models: Models, parameters: NDArray[np.float64], position: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return 1/P̂ [N/m] at the lines, shape (lines,), of parameters, shape (m,), and the periodic position, (n,)."""
        cosine, sine = np.split(parameters[: self.forces], 2)
        path = self.path * np.exp(-2j * np.pi * self.frequency * models.added_dead_time)
        return 1 / models.response(2 * np.pi * self.frequency) - (cosine - 1j * sine) * path / self.phasors(position)

    def residual(self, parameters: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the record less a periodic position and the drift [m], where the replay has settled."""
        return (self.position - position - self.drift(parameters))[self.settled_samples]

    def drift(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the drift [m], shape (n,)."""
        return parameters[self.forces :] @ self.drifts

    def start_size(self, parameters: NDArray[np.float64]) -> float:
        """Return the root mean square of the motion that its own start causes [m]: of terms that have 1 each."""
        return 0.0 if self.starts is None else float(np.linalg.norm(parameters[self.count - len(self.starts) :]))

    def drift_in(self, residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters of the drift that explains most of a residual of settled samples, shape (d,).

        By the normal equations, as the terms are nearly orthogonal: a decomposition of them takes ten times as long.
        """
        terms = self.drifts[:, self.settled_samples]
        return np.asarray(np.linalg.lstsq(terms @ terms.T, terms @ residual, rcond=None)[0])

    def scatter_about(self, position: NDArray[np.float64]) -> float:
        """Return the variance of what a replayed position, shape (n,), and the drift leave [m²]; infinite for NaN."""
        settled = self.settled_samples
        residual = (self.position - position)[settled]
        if not np.isfinite(residual).all():
            return np.inf
        return float(np.var(residual - self.drift_in(residual) @ self.drifts[:, settled]))

    def with_needed_drift(self, position: NDArray[np.float64]) -> "ReplayedRecord":
        """Return the record with its trend; without a drift if a replayed position leaves chance alone: an F test."""
        plain, settled = replace(self, has_drift=False), self.settled_samples
        residual = (self.position - position)[settled]
        coefficients, slow = self.drift_in(residual), len(self.drifts) - len(plain.drifts)
        most = greatest_chance_gain(slow, residual.size) * self.scatter_about(position)
        if np.var(residual - plain.drift_in(residual) @ plain.drifts[:, settled]) <= most:
            return plain
        return replace(self, trend=coefficients[1 : slow + 1] @ self.drifts[1 : slow + 1])

    def replay(self, model: ReplayModel, parameters: NDArray[np.float64]) -> Replay:
        """Return the run of a model along the record, with the record's own parameters."""
        control = self.segment.channels[self.input].ravel() + parameters[: self.forces] @ self.waves
        damping = self.damping if self.is_weakly_pulled else None
        return Replay(model, control, self.position - self.trend, self.frequency, damping)


class Trial(NamedTuple):
    """A model along a record."""

    record: ReplayedRecord
    model: ReplayModel
    parameters: NDArray[np.float64]
    """The record's own parameters, shape (m,)."""


def replays_of(trials: Sequence[Trial]) -> list[Replayed]:
    """Return the replay of each trial, without its drift."""
    return replay([trial.record.replay(trial.model, trial.parameters) for trial in trials])


def positions_of(trials: Sequence[Trial]) -> list[NDArray[np.float64]]:
    """Return the periodic position of each trial, without its drift [m], shape (n,) each; NaN if it diverges."""
    return [each.position for each in replays_of(trials)]


PULSE_SHARE = 2e-3
"""A pulse over the greatest control input: small, as its response counts as linear."""
MIN_SAMPLES_PER_TERM = 10
"""Samples of a record for each pulse, below which it tells too little of its start, and those over which a term
spreads: what moves fewer are pulses that the dead time brings to the first samples, and several terms of the same few
samples cannot be told apart. Half of it moves a parameter of a LuGre law by a tenth of its interval."""


def start_terms(
    records: Sequence[ReplayedRecord], model: ReplayModel, own: Sequence[NDArray[np.float64]]
) -> list[NDArray[np.float64] | None]:
    """Return the positions that other starts of each record cause, shape (terms, n) each; None if it tells too little.

    `own` are the own parameters of each record, shape (m,). The terms are orthogonal where samples count. A record of
    many cycles whose first ones are left out has forgotten its start, and what is left of it would be any number.
    """
    delay = model.input_path[0] + model.output_path[0]
    pulses, coarse = START_STATES + int(np.ceil(delay / model.sample_time)), model.with_coarse_steps()
    long = [
        record.position.size >= MIN_SAMPLES_PER_TERM * pulses and not record.settled_samples.start for record in records
    ]
    runs: list[Replay] = []
    for record, each, is_long in zip(records, own, long, strict=True):
        run = record.replay(coarse, each)
        size = PULSE_SHARE * float(np.abs(run.control_input).max())
        ends = size * np.eye(pulses + 1, run.control_input.size, run.control_input.size - pulses - 1)
        ends[0] = 0.0
        runs += [run._replace(control_input=run.control_input + pulse) for pulse in (ends if is_long else ())]
    moved = iter([each.position for each in replay(runs)])
    return [_orthogonal([next(moved) for _ in range(pulses + 1)]) if is_long else None for is_long in long]


def _orthogonal(moved: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Return combinations of responses, shape (n,) each, orthogonal and of root mean square 1 before the pulses act.

    There are none if a replay diverges.
    """
    responses = np.array(moved[1:]) - moved[0]
    responses = responses - responses[:, :-START_STATES].mean(axis=1, keepdims=True)  # every record has an offset
    counted = responses[:, :-START_STATES]
    if not np.isfinite(responses).all() or not counted.any():
        return None
    turn, sizes, _ = np.linalg.svd(counted, full_matrices=False)
    is_told = sizes > counted.shape[1] * np.finfo(float).eps * sizes[0]
    terms = np.sqrt(counted.shape[1]) / sizes[is_told, None] * (turn.T[is_told] @ responses)
    squares = terms[:, :-START_STATES] ** 2
    return np.asarray(terms[squares.sum(axis=1) ** 2 >= MIN_SAMPLES_PER_TERM * (squares**2).sum(axis=1)])


MAX_WEAK_RATIO = 1.1
"""What is left of a record with a weak pull over what a strong one leaves, above which the model drifts. Both leave the
same noise, so that no test of chance applies: a drift shows in a few percent."""


def prepared_records(
    records: Sequence[ReplayedRecord], model: ReplayModel, own: Sequence[NDArray[np.float64]]
) -> list[ReplayedRecord]:
    """Return records with what they need where a model has been found, with the own parameters of each, shape (m,).

    A strong pull takes noise of the record into the model, of which the likelihood knows nothing: the bands of some
    frequencies are then too narrow by a quarter. The pull is weak where the model settles with it and does not drift.
    """
    weak = [replace(record, is_weakly_pulled=True) for record in records]
    of_strong, of_weak = (
        replays_of([Trial(record, model, values) for record, values in zip(pulled, own, strict=True)])
        for pulled in (records, weak)
    )
    pulled = [
        (b, y.position) if _is_held(a, x, y) else (a, x.position)
        for a, b, x, y in zip(records, weak, of_strong, of_weak, strict=True)
    ]
    starts = start_terms([record for record, _ in pulled], model, own)
    pairs = zip(pulled, starts, strict=True)
    return [replace(record, starts=start).with_needed_drift(position) for (record, position), start in pairs]


def _is_held(record: ReplayedRecord, strong: Replayed, weak: Replayed) -> bool:
    """Return whether a weak pull leaves no more of a record than a strong one, and the model settles as well."""
    allowed = MAX_WEAK_RATIO**2 * record.scatter_about(strong.position)
    return weak.is_settled >= strong.is_settled and record.scatter_about(weak.position) <= allowed < np.inf
