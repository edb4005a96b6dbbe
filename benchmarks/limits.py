"""How rarely an excitation that is let pass exceeds a limit, in a fine simulation that shares no code with the check.

    python benchmarks/limits.py                                    each law once, levels down to 1e-7
    python benchmarks/limits.py --laws lugre --repeats 3 --seed 7
    python benchmarks/limits.py --reduced                          levels of 20 plays

Machine, friction, controller, dead times, encoder, steps per sample and excitation are functions of standard normal
coordinates: sines, multisines and rectangles with their ramps. What `fraexp measure` and `fraexp excite` decide by
(`plan_points`, `check_points`) refuses each or lets it pass. What passes is simulated by `limit_truth`, and subset
simulation climbs to the plays that ask for most. Limits and stops are not drawn but the worst: limits are the least
that are not refused, and a play is stopped at 128 moments, each as likely as any other. An exceedance is thus at least
as probable as where these are drawn. The ratio of a play is the greatest that it asks for, over what the check keeps
within limits: the margin m is exceeded above (1 + m)/(1 - m), 1.105 for 5 %.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from drawn_machines import DrawnMachine, stable_machine_or_none
from harness import Bench, run
from limit_truth import DEMANDS, LANES, STEPS, FineEncoder, FinePlay, simulate_plays
from numpy.typing import NDArray
from paper_machine import REGISTRY
from reference_loop import FINE_CLOCK
from scipy.special import ndtr
from subset_simulation import Level, climb, exceedance

from fraexp.components.measurement_settings import MIN_RAMP_OUT_S, ramp_out_samples
from fraexp.components.periods import Period, Schedule
from fraexp.errors import MachineError
from fraexp.measurement.measurement_plan import NEAR_RATIO, PlannedPoint, plan_points, planning_setup
from fraexp.measurement.play_demands import simulate_demands
from fraexp.simulation.experiments import Experiment, Setup
from fraexp.simulation.machine import Machine, build_machine

SAMPLE_TIMES = (1e-3, 2e-3)
NOISE_SAMPLES = 1 << 16
MAX_PERIOD = 200
WEIGHTS = {"rolling": 2 / 6, "lugre": 1 / 6, "coulomb": 1 / 6, "dahl": 1 / 6, "none": 1 / 6}
"""Laws, and how often each is drawn."""
ENCODER, MACHINE, PLAY = 8, 140, 72
"""Coordinates of an encoder and steps, of a machine with them, and of a play: at least as many as any of them takes."""
IS_MACHINE = np.arange(MACHINE + PLAY) < MACHINE
MOVES = np.array([np.ones(MACHINE + PLAY, dtype=bool), IS_MACHINE, ~IS_MACHINE, ~IS_MACHINE])
"""What a move changes: everything, the machine, or the play, which is the least expensive."""
MARGIN = 0.05
"""The margin that is judged."""
RARE = 1e-7
"""Probability at which no more levels are added."""


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


class CoordinateRandom:
    """A random generator that takes each number from the next of given standard normal coordinates."""

    def __init__(self, coordinates: NDArray[np.float64]) -> None:
        """Take coordinates, shape (n,); an IndexError says that more numbers are drawn than there are."""
        self._uniform = ndtr(coordinates)
        self._used = 0

    def random(self) -> float:
        """Return a number between 0 and 1."""
        self._used += 1
        return float(self._uniform[self._used - 1])

    def uniform(self, low: float, high: float, size: int | None = None) -> float | NDArray[np.float64]:
        """Return a number between two, or an array of them."""
        if size is None:
            return low + (high - low) * self.random()
        return np.array([self.uniform(low, high) for _ in range(size)])

    def integers(self, low: int, high: int | None = None) -> int:
        """Return one of the integers from low to high - 1, or below low if there is no high."""
        first, end = (0, low) if high is None else (low, high)
        return min(first + int((end - first) * self.random()), end - 1)

    def choice(self, values: Sequence[float]) -> float:
        """Return one of some values."""
        return values[self.integers(len(values))]


@dataclass(frozen=True)
class PlayRatio:
    """What a play asks for at most, over what the check keeps within limits."""

    ratios: NDArray[np.float64]
    """By demand, shape (5,)."""
    text: str

    @property
    def greatest(self) -> float:
        """The greatest of them."""
        return float(self.ratios.max())

    def __str__(self) -> str:
        return f"{self.greatest:.4f} ({DEMANDS[int(np.argmax(self.ratios))]}, {self.text})"


@lru_cache(maxsize=2048)
def _machine(law: str, coordinates: bytes) -> tuple[DrawnMachine, Machine, Setup] | None:
    """Return the machine of coordinates, ready for a plan; None if no controller stabilises it."""
    found = np.frombuffer(coordinates)
    drawn = stable_machine_or_none(0, CoordinateRandom(found[ENCODER:]), law, SAMPLE_TIMES)
    if drawn is None:
        return None
    machine = with_whole_steps(drawn)
    model = build_machine(draw_sections(CoordinateRandom(found[:ENCODER]), machine), REGISTRY)
    return machine, model, planning_setup(model)


def checked_demands(point: PlannedPoint) -> NDArray[np.float64]:
    """Return what the check keeps within limits, less the margin, shape (5,).

    It is the demand of a close look, unless limits that are just too far away for one are lower still.
    """
    coarse = np.array(point.demand)
    (closer,) = simulate_demands([point.simulated_play], closely=True)
    return np.minimum(np.maximum(coarse, closer), coarse / NEAR_RATIO)


def play_ratio(law: str, coordinates: NDArray[np.float64]) -> PlayRatio | None:
    """Return what an excitation asks for at 128 stops, over what is allowed; None if there is no such machine.

    It is 0 if a motion diverges: nothing is played then.
    """
    found = _machine(law, coordinates[:MACHINE].tobytes())
    if found is None:
        return None
    machine, model, setup = found
    random = CoordinateRandom(coordinates[MACHINE:])
    shift, noise_seed = random.random(), random.integers(1 << 32)
    experiment, ramp_out = draw_experiment(random, machine, setup, 0), draw_ramp_out(random, setup)
    try:
        (point,) = plan_points(model, [experiment], ramp_out)
    except MachineError:
        return PlayRatio(np.zeros(len(DEMANDS)), "diverges")
    allowed = checked_demands(point)
    request = point.expected_request(point.counts.record)
    stops = 1 + np.floor(request.full_samples * ((shift + np.arange(LANES) / LANES) % 1)).astype(int)
    plays = [FinePlay(request.waveform, request.amplitude_rise, stop, request.ramp_out) for stop in stops.tolist()]
    noise = setup.noise_std * np.random.default_rng(noise_seed).standard_normal(NOISE_SAMPLES)
    truth = simulate_plays(machine.reference, plays, FineEncoder(setup.resolution, noise))
    worst = truth.max(axis=0)
    text = (
        f"{setup.numerics}, resolution {setup.resolution:.2g} m, noise {setup.noise_std:.2g} m, {setup.sample_time} s, "
        f"{point.period.waveform.size} samples a period, lines {point.period.lines[:3]}, asks for {worst}, "
        f"allowed {allowed}, stopped at {stops[np.argmax(truth, axis=0)]} of {request.full_samples}"
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.where(worst > 0, worst / allowed, 0.0)
    return PlayRatio(np.where(np.isnan(ratios), 0.0, ratios), text)


def score(law: str, coordinates: NDArray[np.float64]) -> float:
    """Return the greatest ratio of a play; NaN if there is no such machine."""
    found = play_ratio(law, coordinates)
    return found.greatest if found else np.nan


def climb_law(law: str, seed: int, size: int) -> list[Level]:
    """Print and return the levels of a law, until they are rare enough."""
    random = np.random.default_rng([seed, list(WEIGHTS).index(law)])
    levels: list[Level] = []
    began = time.monotonic()
    count = round(-np.log10(RARE))
    for level in climb(lambda x: score(law, x), random, size, MOVES, count):
        levels.append(level)
        worst = play_ratio(law, level.samples[np.argmax(level.scores)])
        spent = time.monotonic() - began
        left = spent * max((1 + 0.9 * count) / (0.1 + 0.9 * len(levels)) - 1, 0) / 60
        print(
            f"{law}, seed {seed}: exceeds {level.threshold:.4f} with {level.probability:.2g}; worst {worst}; "
            f"{spent:.0f} s, {time.process_time():.0f} CPU-s, {left:.1f} min left",
            flush=True,
        )
    return levels


def search(bench: Bench) -> None:
    """Probabilities that a limit is exceeded, and that it is by more than the margin."""
    at_limit, beyond = 1 / (1 - MARGIN), (1 + MARGIN) / (1 - MARGIN)
    size, repeats, total = bench.options.size, bench.options.repeats, 0.0
    for law in bench.options.laws:
        for seed in range(bench.seed, bench.seed + repeats):
            levels = climb_law(law, seed, size)
            probability = exceedance(levels, beyond)
            total += WEIGHTS[law] * probability / repeats
            text = f"{exceedance(levels, at_limit):.2g}, by more than the margin of {MARGIN:.0%} {probability:.2g}; "
            text += f"last level above {levels[-1].threshold:.4f} with {levels[-1].probability:.2g}"
            bench.row(f"{law}, seed {seed}: a limit is exceeded with", text)
    bench.bounded("all laws as they are drawn: by more than the margin", total, RARE)


if __name__ == "__main__":
    run(
        __doc__, search, laws=list(WEIGHTS), size=(200, 20), repeats=1
    )  # fmt: skip
