"""The simulated source of signals: the control loop of the machine, or a friction model driven by a displacement."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import Excitation, FrictionModel
from fraexp.components.periods import Period, Schedule
from fraexp.data.findings import Finding, Quantity
from fraexp.data.results import EFFORT, Metric, Outcome
from fraexp.data.signals import Encoder, Segment, Signals
from fraexp.simulation.experiment_run import run_experiments
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.loop_setup import prepare_setup, setup_with_steps
from fraexp.simulation.machine import ControlLoop, Machine
from fraexp.simulation.verification import force_along, refined_steps, verify, verify_driven

CHANNEL_UNITS = {
    "u": "N",
    "y": "m",
    "displacement": "m",
    "friction": "N",
    "compensation": "N",
    "excitation": "N",
    "reference": "m",
}
"""Channels of a simulated loop: control input, measured position, true displacement and friction force; what friction
compensation and the excitation add to the control input; the position reference where it moves."""
MAX_ROUNDS = 12
"""Maximum number of times that an experiment is run whose excitation revises its periods."""
MIN_PERIODS_TO_PROBE, PROBED_PERIODS = 60, 5
"""Number of periods from which a few of the later ones are run before all are, to find the steps that they need: mostly
those of higher frequencies, which need more of them, and take less time."""
MAX_REFINEMENTS = 3
"""Maximum number of times that an experiment is run with shorter steps, if its check shows that it needs them."""


def simulate_loop(machine: Machine, excitation: Excitation, progress: Callable[[float], None]) -> Signals:
    """Return the recorded periodic motion of a machine, for each period of the excitation.

    Each period is repeated from rest until the motion is periodic, and then recorded. `progress` takes the fraction
    that is done. The outcome is DIVERGED if the displacement exceeds the divergence limit; segments before are kept.
    """
    setup = prepare_setup(machine)
    periods = tuple(excitation.periods(machine.loop.sample_time))
    if excitation.rounds == 1 and len(periods) >= MIN_PERIODS_TO_PROBE:  # all are then run once, with enough steps
        last = len(periods) - 1
        few = [periods[number] for number in np.linspace(last / 2, last, PROBED_PERIODS).astype(int)]
        probed = _simulate(machine, setup, excitation, few, lambda _: None)
        setup = setup_with_steps(machine, setup, refined_steps(machine, setup, probed.verification))
    signals = _simulate(machine, setup, excitation, periods, progress)
    for _ in range(MAX_REFINEMENTS):
        steps = refined_steps(machine, setup, signals.verification)
        if steps == setup.steps:
            break
        setup = setup_with_steps(machine, setup, steps)
        signals = _simulate(machine, setup, excitation, periods, progress)
    return signals


def _simulate(
    machine: Machine, setup: Setup, excitation: Excitation, given: Sequence[Period], progress: Callable[[float], None]
) -> Signals:
    periods = list(given)
    recorded = _record_periods(setup, excitation, periods, progress)
    until_divergence = itertools.takewhile(lambda segment: segment is not None, recorded)
    segments = tuple(segment for segment in until_divergence if segment)
    outcome, cause = _outcome_and_cause(machine.loop, excitation.schedule, periods, segments)
    findings = (cause,) if cause else excitation.findings(segments)
    channels = list(segments[0].channels if segments else CHANNEL_UNITS)
    names = [name for name in channels if name.partition(".")[0] in CHANNEL_UNITS]
    units = {name: CHANNEL_UNITS[name.partition(".")[0]] for name in names}
    verification = verify(machine, setup, excitation.schedule, periods, segments)
    encoder = Encoder(machine.loop.noise, machine.loop.resolution)
    return Signals(segments, units, outcome, findings, setup.numerics, _effort_metrics(segments), encoder, verification)


def _record_periods(
    setup: Setup, excitation: Excitation, periods: list[Period], progress: Callable[[float], None]
) -> list[Segment | None]:
    """Run the periods, and again those that the excitation revises; `periods` then holds those that were run last."""
    segments: list[Segment | None] = [None] * len(periods)
    waiting = list(range(len(periods)))
    for done_rounds in range(MAX_ROUNDS):

        def report(fraction: float, done_rounds: int = done_rounds) -> None:
            progress((done_rounds + fraction) / max(excitation.rounds, done_rounds + 1))

        revised_numbers = []
        experiments = [Experiment(setup, periods[number], excitation.schedule, number) for number in waiting]
        for number, segment in zip(waiting, run_experiments(experiments, report), strict=True):
            segments[number] = segment
            revised = excitation.revise(periods[number], segment) if segment else None
            if revised:
                periods[number] = revised
                revised_numbers.append(number)
        if not revised_numbers:
            break
        waiting = revised_numbers
    progress(1.0)
    return segments


def _outcome_and_cause(
    loop: ControlLoop, schedule: Schedule, periods: Sequence[Period], segments: Sequence[Segment]
) -> tuple[Outcome, Finding | None]:
    if len(segments) < len(periods):
        return Outcome.DIVERGED, _divergence(loop, schedule, periods[len(segments)])
    unsettled = sum(not segment.settling.settled for segment in segments if segment.settling)
    if unsettled:
        waited = Quantity(schedule.settling_timeout, "s", "time")
        place = f"{unsettled} of {len(segments)} responses"
        return Outcome.NOT_SETTLED, Finding("not periodic", (waited,), place=place)
    return Outcome.OK, None


def _divergence(loop: ControlLoop, schedule: Schedule, period: Period) -> Finding:
    """Return where the displacement exceeded the divergence limit: at a frequency, or on a move, which has none."""
    limit = Quantity(loop.divergence_limit, "m", "loop.divergence_limit")
    if schedule.settling_timeout > 0 or period.reference is None:
        frequency = float(period.lines[0]) / (period.waveform.size * loop.sample_time)
        return Finding("diverged", (limit,), (frequency,))
    farthest = float(np.abs(loop.reference + period.reference).max())
    if farthest > loop.divergence_limit:
        end = Quantity(farthest, "m", "end of the move")
        return Finding("diverged", (limit, end), remedy="shorten the move, or raise loop.divergence_limit")
    move = Quantity(float(np.ptp(period.reference)), "m", "length of the move")
    return Finding("diverged", (limit, move), remedy="correct the design model, or take more time for the move")


def _effort_metrics(segments: Sequence[Segment]) -> tuple[Metric, ...]:
    """Return the greatest stroke, the greatest control input and the time that an experiment takes on a machine."""
    if not segments:
        return ()
    stroke = max(float(np.ptp(samples)) for samples in _channels_of(segments, "displacement"))
    control = max(float(np.abs(samples).max()) for samples in _channels_of(segments, "u"))
    recorded = sum(segment.channels["u"].size * segment.sample_time for segment in segments)
    waited = sum(segment.settling.time for segment in segments if segment.settling)
    values = (stroke, control, recorded + waited)
    return tuple(Metric(*metric) for metric in zip(EFFORT, values, ("m", "N", "s"), strict=True))


def _channels_of(segments: Sequence[Segment], quantity: str) -> list[NDArray[np.float64]]:
    """Return all samples of each channel of a quantity, such as ``u`` and ``u.right``, shape (n,) each."""
    names = [name for name in segments[0].channels if name.partition(".")[0] == quantity]
    return [np.concatenate([segment.channels[name].ravel() for segment in segments]) for name in names]


def drive_friction(friction: FrictionModel, excitation: Excitation, sample_time: float) -> Signals:
    """Return the periodic force of a friction model along each period of an excitation's displacement."""
    segments = []
    for period in excitation.periods(sample_time):
        force = force_along(friction, period.waveform, sample_time)
        channels = {"displacement": period.waveform[None, :], "friction": force[None, :]}
        segments.append(Segment(sample_time, channels, period.lines))
    verification = verify_driven(friction, tuple(segments))
    return Signals(tuple(segments), {"displacement": "m", "friction": "N"}, verification=verification)
