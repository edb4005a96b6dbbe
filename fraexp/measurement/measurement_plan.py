"""The plan of a measurement: which points are played, in which order, how long, and what that asks of the machine."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fraexp.components.kinds import Excitation
from fraexp.components.machine_session import PlayRequest
from fraexp.components.measurement_settings import MeasurementSettings, ramp_out_samples
from fraexp.components.periods import Period, Schedule
from fraexp.components.registry import Registry, create
from fraexp.data.frequency_text import frequency_text
from fraexp.data.signals import Segment
from fraexp.errors import MachineError, StudyError
from fraexp.measurement.tasks import REQUIRED_LIMITS, MeasurementTask
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup
from fraexp.simulation.loop_setup import accurate_steps, prepare_setup, setup_with_steps
from fraexp.simulation.machine import Machine, build_machine
from fraexp.simulation.motion_limits import DEMAND_UNITS, Demand, MotionLimits, predict_demand

SETTLING_RESERVE = 1.5
"""Factor on the settling time that the simulation predicts, where it must be known before."""
MOTION_TOLERANCE = 1e-3
"""Relative error that steps may cause: what drifts by friction over a whole play is off by far more than that."""
PHASES, EARLY_STOPS = 5, 9
"""Phases of its last period at which a play is stopped in the simulation, and moments before it has settled."""
SAMPLES_AT_ONCE = 1_000_000
"""Samples of all plays that are simulated side by side: they are kept until they have been looked at."""
DEFAULT_MARGIN, DEFAULT_RAMP_OUT_S = (MeasurementSettings.model_fields[name].default for name in ("margin", "ramp_out"))
"""Those of a study without a section [measurement]."""


@dataclass(frozen=True)
class PlannedPoint:
    """A period of the excitation as it is to be played."""

    number: int
    """Its place in the excitation, from 0."""
    counts: ExperimentPlan
    """Ramp, windows and record, counted in samples."""
    settling: int
    """Samples after which the periods can be recorded, as the simulation predicts."""
    ramp_out: int
    """Samples in which the excitation falls to 0."""
    demand: Demand
    """What it asks of the machine, as predicted."""
    amplitude: float = 1.0
    """Factor on the amplitude that the study gives."""
    may_drift: bool = False
    """Whether the mean position may still move slowly in the record: its estimator takes that off."""

    @property
    def period(self) -> Period:
        """The period that is played."""
        return self.counts.experiment.period

    @property
    def sample_time(self) -> float:
        """Sample time [s]."""
        return self.counts.experiment.setup.sample_time

    @property
    def frequency(self) -> str:
        """Its frequency, or range of frequencies."""
        return frequency_text(self.period.lines / (self.period.waveform.size * self.sample_time))

    def request(self, record: int) -> PlayRequest:
        """Return what to play so that, however slowly it settles, `record` samples can follow."""
        counts = self.counts
        settling = counts.ramp + max(counts.settling_limit, 2 * counts.window) + counts.window if counts.window else 0
        return self._request(settling + record)

    def expected_request(self, record: int, reserve: float = SETTLING_RESERVE) -> PlayRequest:
        """Return what to play if it settles as predicted, with a reserve: a factor on the settling time."""
        return self._request(int(np.ceil(reserve * self.settling)) + record)

    def _request(self, samples: int) -> PlayRequest:
        wave = self.amplitude * self.period.waveform
        repetitions = int(np.ceil(samples / wave.size))
        return PlayRequest(self.number, wave, repetitions, self.counts.amplitude_rise, self.ramp_out)

    def with_amplitude(self, factor: float) -> "PlannedPoint":
        """Return the point with another factor on its amplitude; what it asks for grows with it, or falls."""
        change = factor / self.amplitude
        return replace(self, amplitude=factor, demand=Demand(*(change * each for each in self.demand)))


@dataclass(frozen=True)
class MeasurementPlan:
    """The points of an experiment in the order in which they are played: the smallest predicted motion first."""

    task: MeasurementTask
    points: tuple[PlannedPoint, ...]
    limits: MotionLimits
    """Limits of study and machine together."""
    limit_share: float = 1.0
    """Part of each limit that may be reached while it is played: less than 1 where no motion was predicted."""

    @property
    def demand(self) -> Demand:
        """What all points together ask of the machine."""
        return Demand(*(max(point.demand[k] for point in self.points) for k in range(len(Demand._fields))))

    @property
    def seconds(self) -> float:
        """Machine time that the points are expected to take [s]."""
        return sum((point.settling + point.counts.record + point.ramp_out) * point.sample_time for point in self.points)


def joint_limits(stated: MotionLimits, machine: Mapping[str, float] | None = None) -> MotionLimits:
    """Return the narrower of the limits of a study and of a machine; StudyError if one is missing without which
    nothing is played.
    """
    both = {**(machine or {})}
    for name, value in stated.plain().items():
        if value is not None:
            both[name] = min(value, both.get(name, value))
    limits = MotionLimits.parse(both, "limits of the machine")
    missing = [name for name in REQUIRED_LIMITS if getattr(limits, name) is None]
    if missing:
        raise StudyError(
            f"[limits] does not state {' and '.join(missing)}; nothing is played on a machine unless "
            f"{', '.join(REQUIRED_LIMITS)} are limited"
        )
    return limits


def plan_measurement(
    task: MeasurementTask, registry: Registry, machine_limits: Mapping[str, float] | None = None
) -> MeasurementPlan:
    """Return the plan of a task, checked against the limits; MachineError names the first that would be exceeded."""
    limits = joint_limits(task.limits, machine_limits)
    machine, excitation = build_machine(task.experiment, registry), _excitation(task, registry)
    setup, schedule = planning_setup(machine), excitation.schedule
    experiments = [
        Experiment(setup, period, schedule, number)
        for number, period in enumerate(excitation.periods(setup.sample_time))
    ]
    ramp_out_s = task.settings.ramp_out if task.settings else DEFAULT_RAMP_OUT_S
    points = plan_points(machine, experiments, ramp_out_samples(ramp_out_s, setup.sample_time))
    margin = task.settings.margin if task.settings else DEFAULT_MARGIN
    for point in points:
        check_demand(point, limits, margin)
    return MeasurementPlan(task, tuple(sorted(points, key=lambda point: point.demand.stroke)), limits)


def _excitation(task: MeasurementTask, registry: Registry) -> Excitation:
    """Return the excitation of a task; StudyError if it is not a force that is known before."""
    excitation = create(registry, Excitation, task.experiment["excitation"])
    sample_time = task.experiment["loop"]["sample_time"]
    if any(period.reference is not None for period in excitation.periods(sample_time)):
        raise StudyError(f"{excitation.name} moves the position reference; only forces can be played")
    if type(excitation).revise is not Excitation.revise:
        raise StudyError(f"{excitation.name} changes its amplitude while it runs; play one with a stated amplitude")
    return excitation


def planning_setup(machine: Machine) -> Setup:
    """Return a machine made ready for a plan: its motion is predicted well even if the study asks for coarse steps."""
    setup, loop = prepare_setup(machine), machine.loop
    steps = accurate_steps(machine.ports, machine.frictions, loop.sample_time, MOTION_TOLERANCE)
    return setup_with_steps(machine, setup, max(setup.steps, steps))


def plan_points(machine: Machine, experiments: Sequence[Experiment], ramp_out: int) -> list[PlannedPoint]:
    """Return what experiments on one machine are to play, and ask for; MachineError if one diverges.

    A point asks for the motion that is simulated from rest to rest, or for that of the linear loop if it is greater.
    """
    points = []
    for experiment, settling in zip(experiments, _settling_times(experiments), strict=True):
        counts = ExperimentPlan.from_experiment(experiment)
        linear = predict_demand(machine, experiment.period)
        points.append(PlannedPoint(experiment.number, counts, settling, ramp_out, linear))
    simulated = simulated_demands(points)
    return [
        replace(point, demand=point.demand.maximum_with(more)) for point, more in zip(points, simulated, strict=True)
    ]


def _settling_times(experiments: Sequence[Experiment]) -> list[int]:
    """Return after how many samples each experiment is recorded on the study's machine."""
    found = []
    for experiment, segment in zip(experiments, run_experiments(experiments, lambda _: None), strict=True):
        if segment is None or segment.settling is None:
            period = experiment.period
            frequency = frequency_text(period.lines / (period.waveform.size * experiment.setup.sample_time))
            raise MachineError(
                f"at {frequency} the study's machine diverges in the simulation; expected one that comes to rest: "
                "lower the controller's gain or the amplitude, or correct plant and dead times"
            )
        found.append(round(segment.settling.time / segment.sample_time))
    return found


def simulated_demands(points: Sequence[PlannedPoint]) -> list[Demand]:
    """Return what points on one machine ask for, from rest to rest, wherever a play is stopped."""
    demands: list[Demand] = []
    for plays in _play_groups(points):
        demands += map(_demand, run_experiments(plays, lambda _: None))
    return [Demand(*np.max(each, axis=0).tolist()) for each in np.split(np.array(demands), len(points))]


def _play_groups(points: Sequence[PlannedPoint]) -> Iterator[list[Experiment]]:
    """Yield the plays of all points in turn, as many at once as have SAMPLES_AT_ONCE."""
    group, samples = [], 0
    for play in itertools.chain.from_iterable(map(_plays, points)):
        group.append(play)
        samples += play.period.waveform.size
        if samples >= SAMPLES_AT_ONCE:
            yield group
            group, samples = [], 0
    if group:
        yield group


def _plays(point: PlannedPoint) -> list[Experiment]:
    """Return experiments that record a point as one period: played to its end, and stopped earlier."""
    request, setup = point.expected_request(point.counts.record), point.counts.experiment.setup
    stops = [request.full_samples, *_late_stops(request)]
    stops += [max(point.settling * k * k // (EARLY_STOPS - 1) ** 2, 1) for k in range(EARLY_STOPS)]
    rest = np.zeros(point.settling)
    periods = [np.append(request.excitation(0, stop + request.ramp_out, stop), rest) for stop in stops]
    return [
        Experiment(setup, Period(each, np.array([1]), recorded_periods=1), Schedule(settling_timeout=0.0), point.number)
        for each in periods
    ]


def _late_stops(request: PlayRequest) -> list[int]:
    """Return the samples at which a play is stopped in its last period.

    What follows depends on the phase, because a force ends and a momentum stays: it is stopped at the peaks of both. An
    odd number of phases, from that of the momentum on, is not the same in both halves of a sine.
    """
    wave, first = request.waveform, (request.repetitions - 1) * request.waveform.size
    momentum = np.cumsum(wave - wave.mean())
    force_peak, momentum_peak = (int(np.argmax(np.abs(each))) + 1 for each in (wave, momentum - momentum.mean()))
    phases = [momentum_peak + k * wave.size // PHASES for k in range(PHASES)]
    return [first + phase % wave.size for phase in (force_peak, *phases)]


def _demand(segment: Segment | None) -> Demand:
    """Return what a simulated play asks for, at the contact that moves most; NaN if it diverges."""
    if segment is None:
        return Demand(*[float("nan")] * len(Demand._fields))
    contacts = [name for name in segment.channels if name.partition(".")[0] == "displacement"]
    u, sample_time = segment.channels["u"][0], segment.sample_time
    demands = [Demand.of_samples(segment.channels[name][0], u, sample_time) for name in contacts]
    return Demand(*map(max, zip(*demands, strict=True)))


def check_demand(point: PlannedPoint, limits: MotionLimits, margin: float) -> None:
    """Raise MachineError if a point is predicted to come nearer to a limit than the margin."""
    for name, found, unit in zip(Demand._fields, point.demand, DEMAND_UNITS, strict=True):
        allowed = getattr(limits, name)
        if allowed is not None and not found <= (1 - margin) * allowed:
            raise MachineError(
                f"at {point.frequency} the excitation is predicted to need a {name.replace('_', ' ')} of {found:.4g} "
                f"{unit}; limits.{name} is {allowed:g} {unit}, of which measurement.margin leaves "
                f"{(1 - margin) * allowed:.4g} {unit}: lower the amplitude, lengthen "
                "measurement.ramp_out, or leave out the frequency"
            )
