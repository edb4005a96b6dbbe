"""The simulated source of signals: the control loop of the machine, or a friction model driven by a displacement."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fraexp.components import Controller, Excitation, FrictionModel, Plant
from fraexp.discretisation import discretise, split
from fraexp.errors import ParameterError
from fraexp.experiments import Experiment, Setup, run
from fraexp.parameters import Parameters, param
from fraexp.results import Outcome
from fraexp.signals import Segment, Signals


class Loop(Parameters):
    """The sampled loop around the plant (paper, Figs 3, 5 and 9): clock, delays and scale."""

    sample_time: float = param("s", "sample time Ts of the controller", above=0)
    input_dead_time: float = param("s", "dead time between control input and thrust", 0.0, at_least=0, at_most=10)
    input_lags: tuple[float, ...] = param("s", "time constants of first-order lags before the thrust", ())
    output_dead_time: float = param("s", "dead time between position and its sample", 0.0, at_least=0, at_most=10)
    output_lags: tuple[float, ...] = param("s", "time constants of first-order lags before the sample", ())
    reference: float = param("m", "position reference r", 0.0)
    resolution: float = param("m", "resolution of the scale, 0 for an ideal one", 0.0, at_least=0)
    noise: float = param("m", "standard deviation of the scale's noise", 0.0, at_least=0)
    seed: int = param("1", "seed of the scale's noise", 0, at_least=0)
    stroke: float = param("m", "displacement at which the loop counts as diverged", 1.0, above=0)

    def model_post_init(self, context: object) -> None:
        """Check the lags."""
        if min(self.input_lags + self.output_lags, default=1.0) <= 0:
            raise ParameterError("loop has a lag of 0 s or less; a first-order lag must be above 0 s")

    @property
    def delay(self) -> float:
        """Time that a change of the control input needs to be seen in the measured position [s]."""
        lags = sum(self.input_lags) + sum(self.output_lags)
        return self.input_dead_time + self.output_dead_time + 5 * lags


class Numerics(Parameters):
    """How finely the loop is computed."""

    tolerance: float = param(
        "1", "relative error of a response that the steps may cause", 1e-4, at_least=1e-5, at_most=0.1
    )
    steps_per_sample: int = param(
        "1",
        "steps of the plant and its friction per sample; 0 for what the tolerance needs",
        0,
        at_least=0,
        at_most=1000,
    )


@dataclass(frozen=True)
class Machine:
    """What the loop is made of."""

    plant: Plant
    friction: FrictionModel
    controller: Controller
    loop: Loop
    numerics: Numerics


UNITS = {"u": "N", "y": "m", "displacement": "m", "friction": "N"}
"""Channels of a simulated loop: control input, measured position, true displacement, true friction force."""
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
    loop, schedule = machine.loop, excitation.schedule
    periods = excitation.periods(loop.sample_time)
    experiments = [Experiment(setup, period, schedule, number) for number, period in enumerate(periods)]
    found = run(experiments, progress)
    inside = itertools.takewhile(lambda segment: segment is not None, found)
    segments = tuple(segment for segment in inside if segment)
    if len(segments) < len(periods):
        period = periods[len(segments)]
        frequency = period.lines[0] / (period.waveform.size * loop.sample_time)
        message = f"at {frequency:.4g} Hz the displacement left ±{loop.stroke:g} m"
        return Signals(segments, UNITS, Outcome.DIVERGED, message, setup.numerics)
    waiting = sum(not segment.settling.settled for segment in segments if segment.settling)
    if waiting:
        message = f"{waiting} of {len(segments)} responses were not yet periodic after {schedule.settle_limit:g} s"
        return Signals(segments, UNITS, Outcome.NOT_SETTLED, message, setup.numerics)
    return Signals(segments, UNITS, numerics=setup.numerics)


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
    friction.rehearse()
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
        wide=friction.greatest_stiffness * discrete.gain <= SOFT and friction.vectorises,
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
