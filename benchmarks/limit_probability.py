"""How rarely an excitation that is played exceeds a limit by more than the margin: rarer than one can draw.

    python benchmarks/limit_probability.py                         each law once, levels down to 1e-7
    python benchmarks/limit_probability.py --laws lugre --size 200 --repeats 3 --seed 7
    python benchmarks/limit_probability.py --optimise 20           then differential evolution from the last level

What `limit_checks` draws is a function of standard normal coordinates here: machine, friction, controller, dead times,
encoder, steps per sample, excitation, ramps. Subset simulation climbs to the plays that ask for most (`limit_truth`) of
what the check lets pass. Limits and stops are not drawn but the worst: limits are the least that are not refused, and
a play is stopped at 128 moments, of which each is as likely as any other. An exceedance is thus at least as probable as
where these are drawn. The ratio of a play is the greatest that it asks for, over what the check keeps within limits:
the margin `m` is exceeded above (1 + m)/(1 - m), 1.105 for 5 %, whatever the limits.
"""

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drawn_machines import REGISTRY, DrawnMachine, stable_machine_or_none
from limit_checks import (
    NOISE_SAMPLES,
    SAMPLE_TIMES,
    draw_experiment,
    draw_ramp_out,
    draw_sections,
    with_whole_steps,
)
from limit_truth import DEMANDS, LANES, FineEncoder, FinePlay, simulate_plays
from numpy.typing import NDArray
from scipy.optimize import differential_evolution
from scipy.special import ndtr
from subset_simulation import Level, climb, exceedance

from fraexp.errors import MachineError
from fraexp.measurement.measurement_plan import NEAR_RATIO, PlannedPoint, plan_points, planning_setup
from fraexp.measurement.play_demands import simulate_demands
from fraexp.simulation.experiments import Setup
from fraexp.simulation.machine import Machine, build_machine

WEIGHTS = {"rolling": 2 / 6, "lugre": 1 / 6, "coulomb": 1 / 6, "dahl": 1 / 6, "none": 1 / 6}
"""Laws, and how often each is drawn."""
ENCODER, MACHINE, PLAY = 8, 140, 72
"""Coordinates of an encoder and steps, of a machine with them, and of a play: at least as many as any of them takes."""
IS_MACHINE = np.arange(MACHINE + PLAY) < MACHINE
MOVES = np.array([np.ones(MACHINE + PLAY, dtype=bool), IS_MACHINE, ~IS_MACHINE, ~IS_MACHINE])
"""What a move changes: everything, the machine, or the play, which is the least expensive."""
MARGIN = 0.05
"""The least of the margins that `limit_checks` draws."""
RARE = 1e-7
"""Probability at which no more levels are added."""


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


def optimise(law: str, level: Level, generations: int, seed: int) -> PlayRatio | None:
    """Return the worst play that differential evolution finds from the last level on."""
    found = differential_evolution(
        lambda x: -np.nan_to_num(score(law, x)),
        [(-6.0, 6.0)] * level.samples.shape[1],
        init=np.clip(level.samples, -6, 6),
        maxiter=generations,
        mutation=(0.2, 0.6),
        recombination=0.2,
        polish=False,
        tol=0,
        rng=seed,
    )
    return play_ratio(law, found.x)


def main() -> None:
    """Print the probabilities of each law and repeat, and of all laws together; fail if a margin is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", nargs="+", choices=list(WEIGHTS), default=list(WEIGHTS))
    parser.add_argument("--size", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--optimise", type=int, default=0, help="generations of differential evolution")
    options, _ = parser.parse_known_args()
    at_limit, beyond = 1 / (1 - MARGIN), (1 + MARGIN) / (1 - MARGIN)
    total = 0.0
    for law in options.laws:
        for seed in range(options.seed, options.seed + options.repeats):
            levels = climb_law(law, seed, options.size)
            probability = exceedance(levels, beyond)
            total += WEIGHTS[law] * probability / options.repeats
            print(
                f"{law}, seed {seed}: a limit is exceeded with {exceedance(levels, at_limit):.2g}, by more than the "
                f"margin of {MARGIN:.0%} with {probability:.2g}; last level above {levels[-1].threshold:.4f} with "
                f"{levels[-1].probability:.2g}",
                flush=True,
            )
            if options.optimise:
                print(f"{law}: optimised {optimise(law, levels[-1], options.optimise, seed)}", flush=True)
    print(f"all laws drawn: by more than the margin with {total:.2g}")
    raise SystemExit(total > RARE)


if __name__ == "__main__":
    main()
