"""The simulated source of signals: the control loop of the machine, or a friction model driven by a displacement."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fraexp.components import Controller, Excitation, FrictionModel, Period, Plant, Schedule
from fraexp.discretisation import discretise
from fraexp.errors import ParameterError
from fraexp.parameters import Parameters, param
from fraexp.results import Outcome
from fraexp.signals import Segment, Settling, Signals


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

    steps_per_sample: int = param("1", "steps of the plant and its friction per sample", 5, at_least=1, at_most=1000)


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
CHUNK = 50_000
"""Samples after which a long experiment shows that it is alive, and can be stopped."""
Alive = Callable[[float], None]
"""Is told how much of an experiment is done, at most."""
LONGEST_STEP = 1.0
"""Longest step, in radians of the stuck table's resonance."""
SLOWEST = 0.98
"""Greatest ratio of successive differences that is believed: slower ones look like noise."""
LEAST_COMPARED = 0.1
"""Time [s] over which periods are compared at least: at 200 Hz a slow transient hardly changes in one period."""


def simulate_loop(machine: Machine, excitation: Excitation, progress: Callable[[float], None]) -> Signals:
    """Run each period of the excitation from rest until it repeats itself, and return what was then recorded.

    `progress` is told the fraction done. A loop that leaves the stroke ends the experiment as diverged.
    """
    loop = machine.loop
    compiled = _Compiled.of(machine)
    periods = excitation.periods(loop.sample_time)
    segments: list[Segment] = []
    for number, period in enumerate(periods):
        share = partial(_share, progress, number, len(periods))
        segment = _Experiment(compiled, loop, period, excitation.schedule, number, share).segment()
        if segment is None:
            frequency = period.lines[0] / (period.waveform.size * loop.sample_time)
            message = f"at {frequency:.4g} Hz the displacement left ±{loop.stroke:g} m"
            return Signals(tuple(segments), UNITS, Outcome.DIVERGED, message)
        segments.append(segment)
        progress((number + 1) / len(periods))
    waiting = sum(not segment.settling.settled for segment in segments if segment.settling)
    if waiting:
        limit = excitation.schedule.settle_limit
        message = f"{waiting} of {len(segments)} responses were not yet periodic after {limit:g} s"
        return Signals(tuple(segments), UNITS, Outcome.NOT_SETTLED, message)
    return Signals(tuple(segments), UNITS)


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


@dataclass(frozen=True)
class _Compiled:
    """The loop's kernel with all its constants."""

    kernel: Callable[..., tuple[bool, np.ndarray]]
    at_rest: Callable[[], Any]

    @classmethod
    def of(cls, machine: Machine) -> "_Compiled":
        """Discretise the machine and bind the kernel to it."""
        from fraexp.kernels.loop import run  # numba: imported only where a loop is run

        loop, friction = machine.loop, machine.friction
        friction.rehearse()
        _check_step(machine)
        sample, feedback, at_rest = discretise(
            machine.plant.state_space(),
            friction,
            machine.controller.transfer_function(loop.sample_time),
            sample_time=loop.sample_time,
            steps=machine.numerics.steps_per_sample,
            input_path=(loop.input_dead_time, loop.input_lags),
            output_path=(loop.output_dead_time, loop.output_lags),
            resolution=loop.resolution,
            stroke=loop.stroke,
        )
        return cls(partial(run, friction.law, friction.law_arguments(), sample, feedback), at_rest)


def _check_step(machine: Machine) -> None:
    """Refuse a step that is too long to follow the stuck table on its presliding stiffness."""
    model, steps = machine.plant.state_space(), machine.numerics.steps_per_sample
    stuck = np.sqrt(machine.friction.greatest_stiffness * max(float(model.c @ model.a @ model.b), 0.0))  # rad/s
    needed = int(np.ceil(machine.loop.sample_time * stuck / LONGEST_STEP))
    if steps < needed:
        raise ParameterError(
            f"numerics.steps_per_sample is {steps}; stuck on {machine.friction.name} friction the machine resonates at "
            f"{stuck / (2 * np.pi):.4g} Hz: expected {needed} at least"
        )


class _Experiment:
    """One periodic excitation of the loop, from rest to the recorded periods."""

    def __init__(
        self, compiled: _Compiled, loop: Loop, period: Period, schedule: Schedule, number: int, alive: Alive
    ) -> None:
        self.compiled, self.loop, self.period, self.schedule = compiled, loop, period, schedule
        self.alive, self.done = alive, 0.0
        self.block = period.waveform.size
        self.state = compiled.at_rest()
        self.noise = np.random.default_rng([loop.seed, number])
        self.measured: list[np.ndarray] = []

    def segment(self) -> Segment | None:
        """Settle, record, and return the recorded periods; None if the loop diverged."""
        loop, schedule = self.loop, self.schedule
        settling = self._settle()
        if settling is None:
            return None
        lead_in = {"y": np.concatenate(self.measured)} if self.measured else {}
        count = max(schedule.periods, int(np.ceil(schedule.record_time / (self.block * loop.sample_time))), 1)
        channels = self._run(np.tile(self.period.waveform, count))
        if channels is None:
            return None
        names = ("u", "y", "displacement", "friction")
        recorded = {name: row.reshape(count, self.block) for name, row in zip(names, channels, strict=True)}
        return Segment(loop.sample_time, recorded, self.period.lines, settling, lead_in)

    def _settle(self) -> Settling | None:
        """Run until successive stretches of whole periods agree; the remaining difference is extrapolated."""
        loop, schedule = self.loop, self.schedule
        if schedule.settle_limit == 0:
            return Settling(True, 0.0, np.nan)  # the transient itself is asked for
        ramp_periods = int(np.ceil((schedule.ramp + loop.delay) / (self.block * loop.sample_time)))
        if ramp_periods:
            elapsed = np.arange(ramp_periods * self.block) * loop.sample_time
            rise = np.minimum(elapsed / schedule.ramp, 1.0) if schedule.ramp else np.ones(elapsed.size)
            if self._run(np.tile(self.period.waveform, ramp_periods) * rise) is None:
                return None
        repeats = max(1, int(np.ceil(LEAST_COMPARED / (self.block * loop.sample_time))))
        stretch = np.tile(self.period.waveform, repeats)
        time = ramp_periods * self.block * loop.sample_time
        agreement = _Agreement(schedule.tolerance, self._floor(stretch.size))
        while True:
            channels = self._run(stretch)
            if channels is None:
                return None
            time += stretch.size * loop.sample_time
            settled = agreement.reached(channels[1])
            if settled or time >= schedule.settle_limit:
                return Settling(settled, time, agreement.difference)

    def _floor(self, samples: int) -> float:
        """Difference of two stretches that scale and noise alone explain [m]."""
        loop = self.loop
        scatter = np.sqrt(2 * (loop.noise**2 + loop.resolution**2 / 12))
        return float(scatter * (1 + 3 / np.sqrt(2 * samples)))

    def _run(self, excitation: np.ndarray) -> np.ndarray | None:
        sigma = self.loop.noise
        noise = sigma * self.noise.standard_normal(excitation.size) if sigma else np.zeros(excitation.size)
        reference = np.full(excitation.size, self.loop.reference)
        parts = []
        for begin in range(0, excitation.size, CHUNK):
            part = slice(begin, begin + CHUNK)
            inside, channels = self.compiled.kernel(self.state, excitation[part], reference[part], noise[part])
            if not inside:
                return None
            parts.append(channels)
            self.measured.append(channels[1].copy())
            self.done += channels.shape[1] * self.loop.sample_time
            self.alive(self.done / self.schedule.settle_limit if self.schedule.settle_limit else 0.0)
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def _share(progress: Callable[[float], None], number: int, count: int, part: float) -> None:
    """Tell that of one experiment among several at least a part is done."""
    progress((number + min(part, 0.9)) / count)


class _Agreement:
    """Whether successive stretches of a motion agree, and how far the last two are apart."""

    def __init__(self, tolerance: float, floor: float) -> None:
        self.tolerance, self.floor = tolerance, floor
        self.difference = np.nan
        self._before: np.ndarray | None = None
        self._excess = np.inf

    def reached(self, now: np.ndarray) -> bool:
        """Compare a stretch [m] with the one before.

        Relative to the motion, the difference beyond what scale and noise explain, extrapolated as a geometric
        series to all that is still to come, must be within the tolerance.
        """
        before, self._before = self._before, now
        if before is None:
            return False
        swing = float(np.std(now))
        change = float(np.sqrt(np.mean((now - before) ** 2)))
        if swing == 0:  # a machine at rest
            self.difference = np.inf if change else 0.0
            return not change
        self.difference = change / swing
        excess = max(change - self.floor, 0.0) / swing
        ratio = min(excess / self._excess, SLOWEST) if self._excess > 0 else 0.0
        self._excess = excess
        return excess * max(1.0, ratio / (1 - ratio)) <= self.tolerance
