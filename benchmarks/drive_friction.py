"""Measure how well the viscous friction of drives is found whose force also depends on the position.

python benchmarks/drive_friction.py              30 drawn drives per row
python benchmarks/drive_friction.py --reduced    6

A drive of 95 kg with 20.4 N of Coulomb friction on three elastic elements, 203.5 N s/m and an encoder of 0.4 µm follows
its reference for 25 s. Wavelengths and phases of the force along the stroke are drawn. Moves that are all at one speed
are refused, and not counted. The exit code is 1 if an error is above a tenth of the viscous coefficient although the
interval is not, or if intervals cover less than 80 %.
"""

import argparse
import sys

import numpy as np
from fraexp_plugins.identification.friction.sliding_identification import SlidingIdentification
from numba import njit
from numpy.typing import NDArray

from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError

SAMPLE_TIME, DURATION, STEPS = 1e-3, 24.8, 40
MASS, VISCOUS, COULOMB, OFFSET = 95.11, 203.5, 20.39, -3.16
DEFLECTIONS, FRACTIONS = np.array([5e-6, 20e-6, 80e-6]), np.array([0.3, 0.4, 0.3])
ENCODER_STEP, NEWTON_PER_VOLT = 0.4e-6, 35.15
POSITION_GAIN, VELOCITY_GAIN = 160.0, 243.0
MAX_ERROR, MIN_COVERED = 0.1, 0.8
ROWS = {
    "ripple of 2.2 N": ((2.0, 1.0), (10e-3, 24e-3), (0.0, 0.0)),
    "ripple of 1.4 N, and of 10 % with the direction": ((1.0, 1.0), (30e-3, 7e-3), (0.1, 0.1)),
    "ripple of 2 N, finer than it is fitted": ((2.0,), (1.1e-3,), (0.0,)),
}
"""Amplitudes [N] and wavelengths [m] of a force along the stroke, and its amplitudes over the friction's."""


@njit
def drive(reference, amplitudes, wavelengths, fractions, phases):
    """Return control input [V] and position [m] of a drive that follows a reference [m], by semi-implicit steps."""
    limits = FRACTIONS * COULOMB
    stiffness = limits / DEFLECTIONS
    deflection = np.zeros(limits.size)
    volts, positions = np.zeros(reference.size), np.zeros(reference.size)
    x, v, before, h = reference[0], 0.0, reference[0], SAMPLE_TIME / STEPS
    for k in range(reference.size):
        seen = np.round(x / ENCODER_STEP) * ENCODER_STEP
        volts[k] = (POSITION_GAIN * (reference[k] - seen) - (seen - before) / SAMPLE_TIME) * VELOCITY_GAIN
        positions[k] = before = seen
        for _ in range(STEPS):
            deflection += h * v
            deflection = np.minimum(np.maximum(deflection, -limits / stiffness), limits / stiffness)
            waves = np.sin(2 * np.pi * x / wavelengths + phases)
            friction = np.sum(stiffness * deflection) * (1 + np.sum(fractions * waves))
            force = NEWTON_PER_VOLT * volts[k] - friction - VISCOUS * v - OFFSET - np.sum(amplitudes * waves)
            v += h * force / MASS
            x += h * v
    return volts, positions


def moves(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return moves between random places at three speeds [m]."""
    parts, place = [np.zeros(300)], 0.0
    while sum(part.size for part in parts) * SAMPLE_TIME < DURATION:
        target = rng.uniform(-0.12, 0.12)
        speed = float(rng.choice([0.03, 0.1, 0.2]))
        distance, rise = abs(target - place), 1.9 * speed / 1.5
        if distance < speed * rise:
            continue
        parts += [_move(place, target, distance / speed, rise), np.full(150, target)]
        place = target
    return np.concatenate(parts)


def same_moves(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return one move back and forth, again and again [m]."""
    distance, speed = rng.uniform(0.1, 0.25), rng.uniform(0.08, 0.2)
    there = _move(0.0, distance, max(distance / speed, 0.7), 0.7)
    one = np.concatenate([there, np.full(200, distance), distance - there, np.zeros(200)])
    return np.tile(one, int(DURATION / SAMPLE_TIME / one.size) + 1)


def _move(begin: float, end: float, duration: float, rise: float) -> NDArray[np.float64]:
    """Return a move [m] whose velocity rises and falls linearly."""
    time = np.arange(int((duration + rise) / SAMPLE_TIME)) * SAMPLE_TIME
    velocity = np.clip(time / rise, 0, 1) - np.clip((time - duration) / rise, 0, 1)
    return begin + (end - begin) * np.cumsum(velocity) / velocity.sum()


def errors(kind, row, count: int) -> NDArray[np.float64]:
    """Return error, 95 % interval and bound over the viscous coefficient, shape (count, 3)."""
    found = []
    for seed in range(count):
        rng = np.random.default_rng(seed)
        amplitudes, wavelengths, fractions = (np.array(each) for each in row)
        drawn = wavelengths * rng.uniform(0.8, 1.25, wavelengths.size)
        volts, y = drive(kind(rng), amplitudes, drawn, fractions, rng.uniform(0, 2 * np.pi, wavelengths.size))
        channels = {"u": NEWTON_PER_VOLT * volts[None], "y": y[None]}
        segment = Segment(SAMPLE_TIME, channels, np.array([1]), periodic=False)
        try:
            result = SlidingIdentification().estimate(Signals((segment,), {"u": "N", "y": "m"}))
        except RecordError:  # all sliding is at one speed
            continue
        metrics = {metric.name: metric.value for metric in result.metrics}
        names = ("viscous coefficient, 95 %", "viscous coefficient, 95 %, Cramér-Rao bound")
        found.append([metrics["viscous coefficient"] - VISCOUS, *(metrics[name] for name in names)])
    return np.array(found) / VISCOUS


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reduced", action="store_true", help="6 drives per row")
    count = 6 if parser.parse_args().reduced else 30
    is_good = True
    print(f"{'force along the stroke':<50}{'moves':<8}{'worst':>8}{'rms':>8}{'band':>8}{'bound':>8}{'covered':>9}")
    for name, row in ROWS.items():
        for kind in (moves, same_moves):
            found = errors(kind, row, count)
            size = np.abs(found[:, 0])
            covered = float(np.mean(size < found[:, 1]))
            is_good &= covered > MIN_COVERED and not np.any((size > MAX_ERROR) & (found[:, 1] < MAX_ERROR))
            figures = (size.max(), np.sqrt(np.mean(size**2)), *np.median(found[:, 1:], axis=0))
            text = "".join(f"{100 * value:>7.2f}%" for value in figures)
            print(f"{name:<50}{'drawn' if kind is moves else 'alike':<8}{text}{covered:>9.0%}", flush=True)
    return int(not is_good)


if __name__ == "__main__":
    sys.exit(main())
