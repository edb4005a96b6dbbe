"""The simulated source of signals: the control loop of the machine, or a friction model driven by a displacement."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from fraexp.components.kinds import Excitation, FrictionModel, Period, Schedule
from fraexp.data.results import EFFORT, Metric, Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.errors import ParameterError
from fraexp.simulation.discretisation import discretise, split
from fraexp.simulation.experiments import Experiment, Setup, run
from fraexp.simulation.machine import ControlLoop, Machine

UNITS = {
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
MOST_ROUNDS = 12
"""Times that an experiment is run at most, for an excitation that revises it."""
LONGEST_STEP = 1.0
"""Longest step, in radians of the stuck table's resonance."""
GOOD_STEP, GOOD = 0.08, 1e-3
"""A step, in radians of the stuck table's resonance, and the relative error of a response that comes with it."""
MOST_STEPS = 10
"""Steps per sample that accuracy asks for at most: of a machine that is merely held, such as by Coulomb friction, the
resonance is not to be resolved."""
SOFT = 0.05
"""Greatest stiffness times compliance of a step at which the predicted displacement is as good as the root."""


def simulate_loop(machine: Machine, excitation: Excitation, progress: Callable[[float], None]) -> Signals:
    """Run each period of the excitation from rest until it repeats itself, and return what was then recorded.

    `progress` is told the fraction done. A loop that leaves the stroke ends the experiment as diverged.
    """
    setup = prepared(machine)
    periods = list(excitation.periods(machine.loop.sample_time))
    found = _recorded(setup, excitation, periods, progress)
    inside = itertools.takewhile(lambda segment: segment is not None, found)
    segments = tuple(segment for segment in inside if segment)
    outcome, message = _outcome(machine.loop, excitation.schedule, periods, segments)
    message = message or excitation.remark(segments)
    units = {name: unit for name, unit in UNITS.items() if all(name in segment.channels for segment in segments)}
    return Signals(segments, units, outcome, message, setup.numerics, _taken(segments))


def _recorded(
    setup: Setup, excitation: Excitation, periods: list[Period], progress: Callable[[float], None]
) -> list[Segment | None]:
    """Run the periods, and those that the excitation revises again; `periods` are then those that were run last."""
    found: list[Segment | None] = [None] * len(periods)
    waiting = list(range(len(periods)))
    for turn in range(MOST_ROUNDS):

        def tell(done: float, before: int = turn) -> None:
            progress((before + done) / max(excitation.rounds, before + 1))

        again = []
        experiments = [Experiment(setup, periods[number], excitation.schedule, number) for number in waiting]
        for number, segment in zip(waiting, run(experiments, tell), strict=True):
            found[number] = segment
            revised = excitation.revise(periods[number], segment) if segment else None
            if revised:
                periods[number] = revised
                again.append(number)
        if not again:
            break
        waiting = again
    progress(1.0)
    return found


def _outcome(
    loop: ControlLoop, schedule: Schedule, periods: Sequence[Period], segments: Sequence[Segment]
) -> tuple[Outcome, str]:
    if len(segments) < len(periods):
        return Outcome.DIVERGED, _why_diverged(loop, schedule, periods[len(segments)])
    waiting = sum(not segment.settling.settled for segment in segments if segment.settling)
    if waiting:
        message = f"{waiting} of {len(segments)} responses were not yet periodic after {schedule.settle_limit:g} s"
        return Outcome.NOT_SETTLED, message
    return Outcome.OK, ""


def _why_diverged(loop: ControlLoop, schedule: Schedule, period: Period) -> str:
    """Return where the displacement left the stroke: at a frequency, or on a move, which has none."""
    if schedule.settle_limit > 0 or period.reference is None:
        frequency = period.lines[0] / (period.waveform.size * loop.sample_time)
        return f"at {frequency:.4g} Hz the displacement left ±{loop.stroke:g} m"
    farthest = float(np.abs(loop.reference + period.reference).max())
    if farthest > loop.stroke:
        return (
            f"the move leads to {farthest:g} m, beyond loop.stroke, which is ±{loop.stroke:g} m: move less far, or "
            "raise loop.stroke"
        )
    return (
        f"on a move of {float(np.ptp(period.reference)):g} m the displacement left ±{loop.stroke:g} m: mend the "
        "design model, or take more time for the move"
    )


def _taken(segments: Sequence[Segment]) -> tuple[Metric, ...]:
    """Return the stroke, the greatest control input and the time that an experiment takes on a machine."""
    if not segments:
        return ()
    places, inputs = (
        np.concatenate([segment.channels[name].ravel() for segment in segments]) for name in ("displacement", "u")
    )
    recorded = sum(segment.channels["u"].size * segment.sample_time for segment in segments)
    waited = sum(segment.settling.time for segment in segments if segment.settling)
    values = (float(np.ptp(places)), float(np.abs(inputs).max()), recorded + waited)
    return tuple(Metric(*metric) for metric in zip(EFFORT, values, ("m", "N", "s"), strict=True))


def drive_friction(friction: FrictionModel, excitation: Excitation, sample_time: float) -> Signals:
    """Drive a friction model by each period of a displacement, and return its periodic force."""
    segments = []
    for period in excitation.periods(sample_time):
        force = friction.force(period.waveform, sample_time, periodic=True)
        omega = 2 * np.pi * np.fft.rfftfreq(period.waveform.size, sample_time)
        velocity = np.fft.irfft(1j * omega * np.fft.rfft(period.waveform), period.waveform.size)
        force = force + friction.viscous * velocity
        channels = {"displacement": period.waveform[None, :], "friction": force[None, :]}
        segments.append(Segment(sample_time, channels, period.lines))
    return Signals(tuple(segments), {"displacement": "m", "friction": "N"})


def prepared(machine: Machine) -> Setup:
    """Return a machine's loop in numbers, with the steps and the way of computing that its stiffness asks for."""
    loop, friction = machine.loop, machine.friction
    models = [friction, machine.compensation.friction] if machine.compensation else [friction]
    for model in models:
        model.rehearse()
    steps = chosen_steps(machine)
    discrete = discretise(
        machine.plant.state_space(),
        friction,
        machine.controller.transfer_function(loop.sample_time),
        sample_time=loop.sample_time,
        steps=steps,
        input_path=(loop.input_dead_time, loop.input_lags),
        output_path=(loop.output_dead_time, loop.output_lags),
    )
    return Setup(
        friction=friction,
        discrete=discrete,
        sample_time=loop.sample_time,
        dead_samples=(
            split(loop.input_dead_time, loop.sample_time)[0],
            split(loop.output_dead_time, loop.sample_time)[0],
        ),
        delay=loop.delay,
        reference=loop.reference,
        resolution=loop.resolution,
        noise=loop.noise,
        seed=loop.seed,
        stroke=loop.stroke,
        wide=friction.greatest_stiffness * discrete.gain <= SOFT and all(model.vectorises for model in models),
        compensation=machine.compensation,
    )


def chosen_steps(machine: Machine) -> int:
    """Return the steps per sample: those asked for, or what the tolerance needs.

    ParameterError for a step that is too long to follow the stuck table on its presliding stiffness.
    """
    model, numerics, friction = machine.plant.state_space(), machine.numerics, machine.friction
    stuck = np.sqrt(friction.greatest_stiffness * max(float(model.c @ model.a @ model.b), 0.0))  # rad/s
    radians = machine.loop.sample_time * stuck
    least = max(int(np.ceil(radians / LONGEST_STEP)), 1)
    if numerics.steps_per_sample == 0:
        accurate = int(np.ceil(radians / (GOOD_STEP * np.sqrt(numerics.tolerance / GOOD))))
        return max(min(accurate, MOST_STEPS), least)
    if numerics.steps_per_sample < least:
        raise ParameterError(
            f"numerics.steps_per_sample is {numerics.steps_per_sample}; stuck on {friction.name} friction the machine "
            f"resonates at {stuck / (2 * np.pi):.4g} Hz: expected {least} at least, or 0 to let fraexp choose"
        )
    return numerics.steps_per_sample
