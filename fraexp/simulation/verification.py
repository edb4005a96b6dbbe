"""The check of a simulation: a few of its periods again, with other steps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.analysis.fourier import phasors
from fraexp.components.kinds import FrictionModel
from fraexp.components.periods import Period, Schedule
from fraexp.data.signals import Segment, Verification
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup, set_valued_contacts
from fraexp.simulation.loop_setup import fewest_steps, setup_with_steps
from fraexp.simulation.machine import Machine

MAX_VERIFIED = 4
"""Maximum number of periods that are computed again."""
MAX_CANDIDATES = 12
"""Maximum number of periods whose distortion is computed to find the greatest one."""
PAIR_SETTLING_TOLERANCE = 1e-4
"""Settling tolerance, at least, of two runs that are compared with each other."""
MIN_REALISATIONS_FOR_TWO = 8
"""Number of broadband periods from which two are computed again, so that methods work which need several."""
SAFETY_FACTOR = 2.0
"""Factor on the error of a method of second order: where friction turns and slips the order is lower."""
REFINEMENT_MARGIN = 1.2
"""Factor on the steps that the error asks for."""
MAX_STEPS = 200
"""Maximum number of steps per sample that fraexp chooses by itself."""


class StepPair(NamedTuple):
    """A machine made ready with two numbers of steps per sample."""

    coarse: Setup
    fine: Setup

    def error_ratio(self, steps: int) -> float:
        """Return the error with `steps` over the difference of both: it falls with the square of the step."""
        return SAFETY_FACTOR / steps**2 / (1 / self.coarse.steps**2 - 1 / self.fine.steps**2)


class _Comparison(NamedTuple):
    """What another number of steps changes."""

    fine: tuple[Segment, ...]
    """Segments that were computed again, with the greater number of steps."""
    errors: dict[str, NDArray[np.float64]]
    """Relative error of each measured position, by its channel; 1 or more where it stands."""
    standing: dict[str, float]
    """Amplitude [m] up to which a position stands, by its channel."""


@dataclass(frozen=True)
class _Repetition:
    """An experiment of which some periods are computed again."""

    pair: StepPair
    setup: Setup
    schedule: Schedule
    periods: Sequence[Period]
    segments: Sequence[Segment]

    @property
    def is_ideal(self) -> bool:
        """Whether the experiment was simulated with an ideal encoder."""
        return not (self.setup.resolution or self.setup.noise_std)

    @property
    def is_transient(self) -> bool:
        """Whether the motion is not periodic, so that it is computed again as a whole."""
        return self.schedule.settling_timeout == 0

    def compare(self) -> _Comparison | None:
        """Return what the steps change in the hardest periods; None if none is known with both numbers of steps.

        Of a position that stands in one of them, that in which it moves least is examined too, until that one moves.
        """
        triples: list[tuple[Segment, Segment, Segment]] = []
        seen: set[int] = set()
        further = set(hardest_segments(self.segments))
        can_stand = any(set_valued_contacts(self.setup.frictions)) and not self.is_transient
        can_stand = can_stand and all(segment.lines.size == 1 for segment in self.segments)
        found = None
        while further:
            seen |= further
            triples += self._triples(sorted(further))
            if not triples:
                return None
            recorded, coarse, fine = zip(*triples, strict=True)
            errors = self._errors(coarse, fine)
            standing = {
                name: self._standing_motion(recorded, fine, name, error) for name, error in errors.items() if can_stand
            }
            found = _Comparison(fine, errors, standing)
            further = _smallest_motions(self.segments, standing) - seen
        return found

    def _triples(self, numbers: Sequence[int]) -> list[tuple[Segment, Segment, Segment]]:
        """Return the periods with these numbers as recorded, and with both numbers of steps, as far as they settle."""
        recorded = [self.segments[number] for number in numbers]
        each = zip(recorded, *(self._run(stepped, numbers) for stepped in self.pair), strict=True)
        return [(own, a, b) for own, a, b in each if a and b and _is_settled(a) and _is_settled(b)]

    def _standing_motion(
        self, recorded: Sequence[Segment], fine: Sequence[Segment], position: str, error: NDArray[np.float64]
    ) -> float:
        """Return the amplitude [m] that is left of a position where it stands; 0 if it moves everywhere.

        Where steps change a motion by more than itself, friction holds it, to a displacement that falls with the step's
        square. `error` is that of each segment, relative to its motion. What an encoder shows there is its own.
        """
        left = error * _amplitudes(fine, position)
        if not self.is_ideal:
            left = np.maximum(left, _amplitudes(recorded, position))
        return float(np.max(left[error >= 1], initial=0.0))

    def _run(self, stepped: Setup, numbers: Sequence[int]) -> list[Segment | None]:
        if self.is_ideal and stepped is self.setup:
            return [self.segments[number] for number in numbers]
        ideal, schedule, periods = replace(stepped, resolution=0.0, noise_std=0.0), self.schedule, self.periods
        if not self.is_transient:
            schedule = replace(schedule, recorded_periods=1, min_record_time=0.0)
            periods = [replace(period, recorded_periods=0) for period in periods]
        if not self.is_ideal:  # both are run, and their transients are alike
            tolerance = max(schedule.settling_tolerance, PAIR_SETTLING_TOLERANCE)
            schedule = replace(schedule, settling_tolerance=tolerance)
        experiments = [Experiment(ideal, periods[number], schedule, number) for number in numbers]
        return run_experiments(experiments, lambda _: None)

    def _errors(self, coarse: Sequence[Segment], fine: Sequence[Segment]) -> dict[str, NDArray[np.float64]]:
        difference = _motion_difference if self.is_transient else _relative_difference
        ratio = self.pair.error_ratio(self.setup.steps)
        return {name: ratio * difference(coarse, fine, name) for name in _position_channels(self.setup)}


def verify(
    machine: Machine, setup: Setup, schedule: Schedule, periods: Sequence[Period], segments: Sequence[Segment]
) -> Verification | None:
    """Return how exact an experiment is, from some of its periods with other steps; None if none was recorded."""
    is_transient = schedule.settling_timeout == 0
    repetition = _Repetition(step_pair(machine, setup, is_finer=is_transient), setup, schedule, periods, segments)
    compared = repetition.compare()
    if compared is None:
        return None
    fine, errors, standing = compared
    recorded = tuple(segments) if repetition.is_ideal else fine
    errors = {name: np.where((name in standing) & (each >= 1), np.nan, each) for name, each in errors.items()}
    return Verification(
        frequency=_frequencies(fine),
        step_error=errors.pop("y"),
        segments=recorded,
        plants=_plants(machine, setup, 2 * np.pi * _frequencies(recorded)),
        machine={
            "friction": machine.friction,
            "nominal_plant": machine.plant,
            "input_dead_time": machine.loop.input_dead_time,
            "input_time_constants": machine.loop.input_time_constants,
            "output_dead_time": machine.loop.output_dead_time,
            "output_time_constants": machine.loop.output_time_constants,
        },
        remedy=_steps_remedy(machine, setup),
        further_step_errors=errors,
        standing_motion=standing,
    )


def _smallest_motions(segments: Sequence[Segment], standing: Mapping[str, float]) -> set[int]:
    """Return the segment in which each position that stands in others moves least: it may stand there too."""
    numbers = set()
    for position, least in standing.items():
        amplitudes = _amplitudes(segments, position)
        moves = (amplitudes > least) & [_is_settled(segment) for segment in segments]
        if least and moves.any():
            numbers.add(int(np.argmin(np.where(moves, amplitudes, np.inf))))
    return numbers


def _amplitudes(segments: Sequence[Segment], position: str) -> NDArray[np.float64]:
    """Return the greatest amplitude of a position over the periods [m], at the line of each segment, shape (n,)."""
    return np.array([np.abs(phasors(segment, position)[:, 0]).max() for segment in segments])


def _steps_remedy(machine: Machine, setup: Setup) -> str:
    chosen = machine.numerics.steps_per_sample
    steps = "to 0, which chooses them" if chosen else f"above {setup.steps}, which were chosen"
    return f"set numerics.steps_per_sample {steps}, or, where the machine hardly moves, raise the amplitude"


def verify_driven(friction: FrictionModel, segments: tuple[Segment, ...]) -> Verification:
    """Return how exact the force of a friction model is that displacements drive: with every second sample of them."""
    errors = []
    for segment in segments:
        twice, force = (np.tile(segment.channels[name][0], 2) for name in ("displacement", "friction"))
        coarse = force_along(friction, twice[::2], 2 * segment.sample_time)
        span = float(np.ptp(force))
        error = float(np.abs(coarse - force[::2]).max()) / span if span else np.nan
        errors.append(np.full(segment.lines.size, SAFETY_FACTOR / (2**2 - 1) * error))
    return Verification(
        _frequencies(segments), np.concatenate(errors), segments, plants={}, machine={}, remedy="lower loop.sample_time"
    )


def force_along(friction: FrictionModel, displacement: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
    """Return the force of a friction model [N] along a periodic displacement [m], with its viscous part, shape (n,)."""
    force = friction.force(displacement, sample_time, periodic=True)
    omega = 2 * np.pi * np.fft.rfftfreq(displacement.size, sample_time)
    velocity = np.fft.irfft(1j * omega * np.fft.rfft(displacement), displacement.size)
    return np.asarray(force + friction.viscous * velocity)


def _plants(machine: Machine, setup: Setup, omega: NDArray[np.float64]) -> dict[str, NDArray[np.complex128]]:
    """Return the plant's response to the thrust by the channel of each measured position."""
    fed_back, *further = _position_channels(setup)
    responses = {name: machine.ports.response(omega, name.partition(".")[2]) for name in further}
    return {fed_back: machine.response(omega), **responses}


def _position_channels(setup: Setup) -> list[str]:
    """Return the channels of all measured positions, that of the one that is fed back first."""
    return ["y", *(f"y.{name}" for name in setup.positions[1:])]


def step_pair(machine: Machine, setup: Setup, is_finer: bool = False) -> StepPair:
    """Return the experiment's steps and half of them, or twice as many: if half are too few, or if it is asked for.

    Over a periodic motion errors of single events average out; in a transient an event that both step lengths miss
    alike would not show.
    """
    half = setup.steps // 2
    if half >= fewest_steps(machine) and not is_finer:
        return StepPair(setup_with_steps(machine, setup, half), setup)
    return StepPair(setup, setup_with_steps(machine, setup, 2 * setup.steps))


def refined_steps(machine: Machine, setup: Setup, verification: Verification | None) -> int:
    """Return the steps per sample that the tolerance needs, as far as fraexp may choose them.

    A further position counts as long as steps help: a body that sticks while the thrust's own moves has no response
    that could be exact.
    """
    if verification is None or machine.numerics.steps_per_sample:
        return setup.steps
    limit = max(MAX_STEPS, setup.steps)
    own, *others = (
        _needed_steps(setup.steps, float(np.nanmax(error, initial=0.0)) / machine.numerics.tolerance)
        for error in (verification.step_error, *verification.further_step_errors.values())
    )
    return max(min(own, limit), *(steps for steps in others if steps <= limit), setup.steps)


def _needed_steps(steps: int, excess: float) -> int:
    """Return how many steps per sample are needed where the error is `excess` times the tolerance."""
    return steps if excess <= 1 else int(np.ceil(REFINEMENT_MARGIN * steps * np.sqrt(excess)))


def hardest_segments(segments: Sequence[Segment]) -> list[int]:
    """Return the numbers of the segments to verify, ascending: the most distorted one, and others."""
    settled = [number for number, segment in enumerate(segments) if _is_settled(segment)]
    if not settled:
        return []
    if any(segments[number].lines.size > 1 for number in settled):
        return settled[: 2 if len(settled) >= MIN_REALISATIONS_FOR_TWO else 1]
    candidates = settled[:: -(-len(settled) // MAX_CANDIDATES)]
    most_distorted = max(candidates, key=lambda number: _distortion(segments[number]))
    spread = np.linspace(0, len(settled) - 1, min(MAX_VERIFIED - 1, len(settled))).round().astype(int)
    return sorted({most_distorted, *(settled[at] for at in spread)})


def _is_settled(segment: Segment | None) -> bool:
    return segment is not None and segment.settling is not None and segment.settling.settled


def _frequencies(segments: Sequence[Segment]) -> NDArray[np.float64]:
    return np.concatenate([segment.frequency for segment in segments])


def _relative_difference(coarse: Sequence[Segment], fine: Sequence[Segment], position: str) -> NDArray[np.float64]:
    """Return the relative difference of two measurements of y/u, y being the channel of a position."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where nothing moves
        first, second = (
            np.concatenate([phasors(segment, position)[0] / phasors(segment, "u")[0] for segment in part])
            for part in (coarse, fine)
        )
        difference = np.abs(first / second - 1)
    return np.where(np.isfinite(difference), difference, np.nan)


def _motion_difference(coarse: Sequence[Segment], fine: Sequence[Segment], position: str) -> NDArray[np.float64]:
    """Return the greatest difference of two transients over their stroke, the same at each line."""
    errors = []
    for first, second in zip(coarse, fine, strict=True):
        y, stroke = second.channels[position], float(np.ptp(second.channels[position]))
        error = float(np.abs(first.channels[position] - y).max()) / stroke if stroke else np.nan
        errors.append(np.full(second.lines.size, error))
    return np.concatenate(errors)


def _distortion(segment: Segment) -> float:
    """Return how much more than its fundamental the measured position contains, relative to it."""
    position = segment.channels["y"][0]
    fundamental = float(np.abs(phasors(segment, "y")[0, 0])) ** 2 / 2
    power = float(position @ position) / position.size - float(position.mean()) ** 2
    return power / fundamental if fundamental else 0.0
