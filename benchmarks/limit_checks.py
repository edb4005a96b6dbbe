"""Excitations drawn at random against limits: what is played, and how near the motion then truly comes to a limit.

    python benchmarks/limit_checks.py 10_000_000                 as many excitations
    python benchmarks/limit_checks.py 100_000 --seed 7           others
    python benchmarks/limit_checks.py 100_000 --margin 0         without the margin
    python benchmarks/limit_checks.py 100_000 --margin -0.02     with limits that are 2 % too high: some are exceeded
    python benchmarks/limit_checks.py 100_000 --mismatch 0.03    the machine differs from the study's

Machine, friction, controller, dead times, encoder and steps per sample are drawn, then thousands of excitations on it:
sines, multisines and rectangles with their ramps. What `fraexp measure` and `fraexp excite` decide by (`plan_points`,
`check_points`) refuses or plays each, against limits drawn near what it predicts. What is played is stopped at the end,
or at any moment, in a fine simulation that shares no code with fraexp (`limit_truth`).

An excess is given in margins from where the check refuses: the limit lies at 1, and is exceeded by the margin at 2.
Without a margin it is relative to the limit.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn_machines import REGISTRY, DrawnMachine, drawn_machine
from limit_truth import DEMANDS, STEPS, FineEncoder, FinePlay, simulate_plays
from numpy.typing import NDArray
from reference_loop import FINE_CLOCK, ReferenceMachine

from fraexp.components.measurement_settings import MIN_RAMP_OUT_S, ramp_out_samples
from fraexp.components.periods import Period, Schedule
from fraexp.errors import MachineError
from fraexp.measurement.measurement_plan import PlannedPoint, check_points, plan_points, planning_setup
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.machine import Machine, build_machine
from fraexp.simulation.motion_limits import MotionLimits

LAWS = ("rolling", "lugre", "coulomb", "rolling", "dahl", "none")
SAMPLE_TIMES = (1e-3, 2e-3)
PER_MACHINE, PER_BATCH = 5000, 1000
NOISE_SAMPLES = 1 << 16
MAX_PERIOD = 200
EDGE, BEYOND = (0.97, 1.1), (1.0, 3.0)
"""Limit over the least one that is not refused: of the demand that is at its limit, and of the others."""


@dataclass
class LimitTally:
    """What has been found so far."""

    drawn: int = 0
    refused: int = 0
    failed: int = 0
    """Machines on which an excitation diverges."""
    above_limit: int = 0
    above_margin: int = 0
    early: int = 0
    """Of the latter those that are stopped before they have settled."""
    greatest: float = -np.inf
    """Greatest excess [margins]."""
    greatest_ratio: float = 0.0
    """Greatest demand over its limit."""
    where: str = ""

    def add(
        self,
        truth: NDArray[np.float64],
        limits: NDArray[np.float64],
        margin: float,
        is_early: NDArray[np.bool_],
        where: list[str],
    ) -> None:
        """Count plays: their demands and limits, shape (plays, 5), and whether they are stopped early."""
        ratio = truth / limits
        excess = (ratio - (1 - margin)) / (margin if margin > 0 else 1.0)
        self.above_limit += int((ratio > 1).any(axis=1).sum())
        self.above_margin += int((ratio > 1 + margin).any(axis=1).sum())
        self.early += int(((ratio > 1 + margin).any(axis=1) & is_early).sum())
        play, kind = np.unravel_index(np.argmax(excess), excess.shape)
        self.greatest_ratio = max(self.greatest_ratio, float(ratio.max()))
        if excess[play, kind] > self.greatest:
            self.greatest = float(excess[play, kind])
            self.where = f"{DEMANDS[kind]}, {where[play]}"

    def __str__(self) -> str:
        return (
            f"{self.drawn} drawn: {self.refused} refused, {self.drawn - self.refused} played, of which "
            f"{self.above_limit} exceed a limit and {self.above_margin} by more than the margin ({self.early} stopped "
            f"before they settle); greatest excess {self.greatest:.3f} margins ({self.where}), "
            f"{self.greatest_ratio:.4f} of the limit"
        )


def draw_machine(number: int, seed: int, random: np.random.Generator) -> tuple[DrawnMachine, dict[str, object]]:
    """Return a machine, and its study's sections."""
    machine = with_whole_steps(drawn_machine(number, seed, LAWS[number % len(LAWS)], SAMPLE_TIMES))
    return machine, draw_sections(random, machine)


def draw_sections(random: np.random.Generator, machine: DrawnMachine) -> dict[str, object]:
    """Return a machine's study, with an encoder and a tolerance of the simulation."""
    sections = machine.sections()
    sections["loop"].update(
        resolution=10 ** random.uniform(-9, -6.5) * int(random.integers(2)),
        noise=10 ** random.uniform(-9, -7) * int(random.integers(2)),
        seed=int(random.integers(1000)),
    )
    sections["numerics"] = {"tolerance": 10 ** random.uniform(-4, -1)}
    return sections


def with_whole_steps(machine: DrawnMachine) -> DrawnMachine:
    """Return a machine whose dead times are whole steps of the fast simulation."""
    grain, own = FINE_CLOCK // STEPS, machine.reference
    return replace(machine, reference=replace(own, dead_times=tuple(n // grain * grain for n in own.dead_times)))


def draw_wave(random: np.random.Generator) -> Period:
    """Return a period of unit amplitude."""
    samples = int(np.exp(random.uniform(np.log(4), np.log(MAX_PERIOD))))
    phase = 2 * np.pi * np.arange(samples) / samples
    kind = random.integers(3)
    if kind == 0:
        wave = np.sin(phase)
    elif kind == 1:
        wave = np.where(np.arange(samples) < random.integers(1, samples), 1.0, -1.0)
        wave -= wave.mean()
    else:
        lines = np.arange(1, 1 + random.integers(1, max(samples // 4, 2)))
        wave = np.cos(np.outer(phase, lines) + random.uniform(0, 2 * np.pi, lines.size)).sum(axis=1)
    wave /= np.abs(wave).max()
    return Period(wave, np.flatnonzero(np.abs(np.fft.rfft(wave)) > 1e-9))


def draw_points(random: np.random.Generator, machine: DrawnMachine, model: Machine, setup: Setup) -> list[PlannedPoint]:
    """Return planned points of one machine."""
    experiments = [draw_experiment(random, machine, setup, number) for number in range(PER_BATCH)]
    return plan_points(model, experiments, draw_ramp_out(random, setup))


def draw_experiment(random: np.random.Generator, machine: DrawnMachine, setup: Setup, number: int) -> Experiment:
    """Return an excitation, from a tenth to ten times the force of friction, and how it is settled and recorded."""
    wave = draw_wave(random)
    force = machine.amplitude / machine.relative_amplitude * 10 ** random.uniform(-1, 1)
    schedule = Schedule(
        ramp=float(random.choice([0.0, 0.01, 0.05, 0.2])),
        settling_tolerance=10 ** random.uniform(-4, -2),
        settling_timeout=0.3,
        recorded_periods=int(random.integers(1, 4)),
    )
    return Experiment(setup, replace(wave, waveform=force * wave.waveform), schedule, number)


def draw_ramp_out(random: np.random.Generator, setup: Setup) -> int:
    """Return the samples in which an excitation falls to 0."""
    return ramp_out_samples(random.choice([MIN_RAMP_OUT_S, 0.02, 0.05]), setup.sample_time)


def draw_limits(random: np.random.Generator, points: list[PlannedPoint], margin: float) -> NDArray[np.float64]:
    """Return limits, shape (points, 5): one of each near the least that is not refused, the others above it."""
    demands = np.array([point.demand for point in points])
    factors = random.uniform(*BEYOND, demands.shape)
    edge = random.integers(demands.shape[1], size=len(points))
    factors[np.arange(len(points)), edge] = random.uniform(*EDGE, len(points))
    return np.maximum(demands, 1e-12) * factors / (1 - margin)


def is_played(point: PlannedPoint, limits: NDArray[np.float64], margin: float) -> bool:
    """Return what fraexp decides."""
    try:
        check_points([point], MotionLimits(**dict(zip(DEMANDS, limits.tolist(), strict=True))), margin)
    except MachineError:
        return False
    return True


def draw_play(random: np.random.Generator, point: PlannedPoint) -> FinePlay:
    """Return how a point is played: to its end, or stopped at any moment."""
    request = point.expected_request(point.counts.record)
    stop = request.full_samples if random.random() < 0.3 else int(random.integers(1, request.full_samples + 1))
    return FinePlay(request.waveform, request.amplitude_rise, stop, request.ramp_out)


def mismatched(own: ReferenceMachine, mismatch: float, random: np.random.Generator) -> ReferenceMachine:
    """Return a machine whose gain and modes differ by up to a share, and its viscous friction by ten times that."""
    around = lambda value, times=1: value * random.uniform(1 - times * mismatch, 1 + times * mismatch)  # noqa: E731
    modes = tuple((around(frequency), ratio, gain) for frequency, ratio, gain in own.modes)
    return replace(own, gain=around(own.gain), modes=modes, viscous=around(own.viscous, 10))


def examine(seed: int, margin: float | None, mismatch: float) -> Iterator[LimitTally]:
    """Go from machine to machine, and yield what was found after each batch."""
    tally = LimitTally()
    number = 0
    while True:
        random = np.random.default_rng([seed, number])
        machine, sections = draw_machine(number, seed, random)
        model = build_machine(sections, REGISTRY)
        setup = planning_setup(model)
        own = margin if margin is not None else float(random.choice([0.05, 0.1, 0.2]))
        for _ in range(PER_MACHINE // PER_BATCH):
            try:
                points = draw_points(random, machine, model, setup)
            except MachineError:
                tally.failed += 1
                break
            limits = draw_limits(random, points, own)
            chosen = [k for k, point in enumerate(points) if is_played(point, limits[k], own)]
            tally.drawn += len(points)
            tally.refused += len(points) - len(chosen)
            plays = [draw_play(random, points[k]) for k in chosen]
            encoder = FineEncoder(setup.resolution, setup.noise_std * random.standard_normal(NOISE_SAMPLES))
            truth = simulate_plays(mismatched(machine.reference, mismatch, random), plays, encoder)
            where = [
                f"machine {number} {machine.law}, {setup.numerics}, {setup.sample_time} s, play {play[1:]} of {k}"
                for k, play in zip(chosen, plays, strict=True)
            ]
            is_early = np.array([play.stop < points[k].settling for k, play in zip(chosen, plays, strict=True)])
            tally.add(truth, limits[chosen], own, is_early, where)
            yield tally
        number += 1


def main() -> None:
    """Examine as many excitations as are asked for, and print what is found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=60_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--margin", type=float)
    parser.add_argument("--mismatch", type=float, default=0.0)
    options = parser.parse_args()
    began = time.monotonic()
    said = began
    for tally in examine(options.seed, options.margin, options.mismatch):
        now, is_done = time.monotonic(), tally.drawn >= options.count
        if is_done or now > said + 20:
            said, spent = now, now - began
            left = max(spent * (options.count / tally.drawn - 1), 0) / 60
            rate = tally.drawn / spent
            print(f"{tally}; {rate:.0f}/s, {time.process_time():.0f} CPU-s, {left:.0f} min left", flush=True)
        if is_done:
            break


if __name__ == "__main__":
    main()
