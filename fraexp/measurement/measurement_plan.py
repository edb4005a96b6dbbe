"""The plan of a measurement: which points are played, in which order, how long, and what that asks of the machine."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fraexp.analysis.fourier import fourier_sums, line_amplitude
from fraexp.components.kinds import Excitation
from fraexp.components.machine_session import PlayRequest
from fraexp.components.measurement_settings import MeasurementSettings, ramp_out_samples
from fraexp.components.periods import Period
from fraexp.components.registry import Registry, create
from fraexp.data.findings import Quantity
from fraexp.data.signals import Segment
from fraexp.data.texts import frequency_text
from fraexp.errors import PlanError, StudyError
from fraexp.measurement.play_demands import Report, SimulatedPlay, simulate_demands
from fraexp.measurement.tasks import REQUIRED_LIMITS, MeasurementTask
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, ExperimentPlan, Setup
from fraexp.simulation.loop_setup import accurate_steps, prepare_setup, setup_with_steps
from fraexp.simulation.machine import Machine, build_machine
from fraexp.simulation.motion_limits import (
    DEMAND_UNITS,
    NO_DEMAND,
    Demand,
    MotionLimits,
    demand_name,
    encoder_noise_demand,
    predict_demand,
)

SETTLING_RESERVE = 1.5
"""Factor on the settling time that the simulation predicts, where it must be known before."""
MOTION_TOLERANCE = 1e-3
"""Relative error that steps may cause: what drifts by friction over a whole play is off by far more than that."""
NEAR_RATIO = 0.25
"""Part of what a limit allows from which on a point is looked at closely: few stops show less than half at worst."""
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
    expected: Mapping[str, float] = field(default_factory=dict)
    """Amplitude of each channel at the excited lines, as predicted [N or m]; empty if nothing is."""
    noise: Demand = NO_DEMAND
    """What noise of the encoder may ask for beyond what is simulated."""
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
    def seconds(self) -> float:
        """Machine time that it is expected to take [s]."""
        return (self.settling + self.counts.record + self.ramp_out) * self.sample_time

    @property
    def frequency(self) -> str:
        """Its frequency, or range of frequencies."""
        return frequency_text(self.period.lines / (self.period.waveform.size * self.sample_time))

    @property
    def rms(self) -> float:
        """Root mean square of the excitation [N]: few samples of a sine may all miss its peak."""
        return self.amplitude * float(np.sqrt(np.mean(self.period.waveform**2)))

    @property
    def simulated_play(self) -> SimulatedPlay:
        """The play of its record, as it is expected, on the study's machine."""
        request, setup = self.expected_request(self.counts.record), self.counts.experiment.setup
        return SimulatedPlay(setup, request, self.period.lines.tolist(), self.settling, self.noise)

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

    @property
    def expected_amplitudes(self) -> dict[str, float]:
        """Amplitudes of u and y that are expected; none at another amplitude, which friction answers in its own way."""
        of = self.expected if self.amplitude == 1 else {}
        return {name: float(f"{of[name]:.4g}") for name in ("u", "y") if name in of}

    def excitation_at(self, sample: int) -> tuple[tuple[float, float], ...]:
        """Return amplitude [N] and phase [deg] of each line, as played from a sample after the rise on."""
        wave = np.roll(self.amplitude * self.period.waveform, -sample)
        sums = fourier_sums(wave[None, :], self.period.lines)[0]
        return tuple((float(f"{abs(of):.7g}"), round(float(np.angle(of, deg=True)), 5)) for of in sums)

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
        return self.seconds_without(())

    def seconds_without(self, kept: Collection[int]) -> float:
        """Return the machine time [s] that the points are expected to take, without those of these numbers."""
        waiting = [point for point in self.points if point.number not in kept]
        return sum(point.seconds for point in waiting)


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
    task: MeasurementTask,
    registry: Registry,
    machine_limits: Mapping[str, float] | None = None,
    report: Report = lambda _: None,
) -> MeasurementPlan:
    """Return the plan of a task, checked against the limits; PlanError names the worst that would be exceeded.

    `report` is told how far it is.
    """
    limits = joint_limits(task.limits, machine_limits)
    machine, excitation = build_machine(task.experiment, registry), _excitation(task, registry)
    setup, schedule = planning_setup(machine), excitation.schedule
    experiments = [
        Experiment(setup, period, schedule, number)
        for number, period in enumerate(excitation.periods(setup.sample_time))
    ]
    ramp_out_s = task.settings.ramp_out if task.settings else DEFAULT_RAMP_OUT_S
    points = plan_points(machine, experiments, ramp_out_samples(ramp_out_s, setup.sample_time))
    points = check_points(points, limits, task.settings.margin if task.settings else DEFAULT_MARGIN, report)
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
    """Return what experiments on one machine are to play, and ask for; PlanError if one diverges.

    A point asks for the motion that is simulated from rest to rest, and what other noise of the encoder may add, or for
    that of the linear loop if it is greater.
    """
    points, noise = [], encoder_noise_demand(machine)
    for experiment, segment in zip(experiments, _predicted_records(experiments), strict=True):
        counts = ExperimentPlan.from_experiment(experiment)
        linear = predict_demand(machine, experiment.period)
        settling = round(segment.settling.time / segment.sample_time) if segment.settling else 0
        expected = {name: line_amplitude(segment, name) for name in segment.channels}
        point = PlannedPoint(experiment.number, counts, settling, ramp_out, linear, expected=expected, noise=noise)
        points.append(point)
    simulated = simulate_demands([point.simulated_play for point in points])
    return [
        replace(point, demand=point.demand.maximum_with(more)) for point, more in zip(points, simulated, strict=True)
    ]


def _predicted_records(experiments: Sequence[Experiment]) -> list[Segment]:
    """Return what the study's machine records of each experiment, with its settling."""
    found = []
    for experiment, segment in zip(experiments, run_experiments(experiments, lambda _: None), strict=True):
        if segment is None or segment.settling is None:
            period = experiment.period
            frequency = frequency_text(period.lines / (period.waveform.size * experiment.setup.sample_time))
            raise PlanError(
                f"at {frequency} the study's machine diverges in the simulation; expected one that comes to rest: "
                "lower the controller's gain or the amplitude, or correct plant and dead times"
            )
        found.append(segment)
    return found


def check_points(
    points: Sequence[PlannedPoint], limits: MotionLimits, margin: float, report: Report = lambda _: None
) -> list[PlannedPoint]:
    """Return the points with what they ask for, those that come near a limit looked at closely.

    PlanError names the worst that is predicted to come nearer to a limit than the margin. `report` is told how far the
    close look is, which takes several times as long as all before.
    """
    check_demands(points, limits, margin)
    near = [point for point in points if _comes_near(point.demand, limits, margin)]
    plays = [point.simulated_play for point in near]
    closer = dict(
        zip((point.number for point in near), simulate_demands(plays, closely=True, report=report), strict=True)
    )
    found = [
        replace(point, demand=point.demand.maximum_with(closer.get(point.number, point.demand))) for point in points
    ]
    check_demands(found, limits, margin)
    return found


def _comes_near(demand: Demand, limits: MotionLimits, margin: float) -> bool:
    allowed = [getattr(limits, name) for name in Demand._fields]
    return any(
        limit is not None and found > NEAR_RATIO * (1 - margin) * limit
        for found, limit in zip(demand, allowed, strict=True)
    )


def check_demands(points: Sequence[PlannedPoint], limits: MotionLimits, margin: float) -> None:
    """Raise PlanError if a point is predicted to come nearer to a limit than the margin; it names the worst."""
    allowed = [getattr(limits, name) for name in Demand._fields]
    allowed = [np.inf if limit is None else (1 - margin) * limit for limit in allowed]
    shares = np.array([np.array(point.demand) / allowed for point in points])
    if (shares <= 1).all():  # false for one that is not a number, too
        return
    diverging = [point.frequency for point in points if np.isnan(point.demand).any()]
    if diverging:
        raise PlanError(
            f"at {diverging[0]} the study's machine diverges in the simulation where the excitation is stopped; "
            "expected one that comes to rest: lower the controller's gain or the amplitude"
        )
    place, column = divmod(int(np.argmax(shares)), shares.shape[1])
    name, unit, share = Demand._fields[column], DEMAND_UNITS[column], shares[place, column]
    needed = (f"{demand_name(name)} of ", Quantity(points[place].demand[column], unit))
    raise PlanError(
        f"at {points[place].frequency} the excitation is predicted to need ",
        *needed,
        f"; limits.{name} is ",
        Quantity(getattr(limits, name), unit),
        ", of which measurement.margin leaves ",
        Quantity(float(allowed[column]), unit),
        f": lower the amplitude to {0.99 / share:.0%} or less, or leave out the frequency; if it is the stop "
        "that asks for so much, lengthen measurement.ramp_out",
    )
