"""Measure the errors of friction identification, and the coverage of the stated 95 % intervals.

    python benchmarks/friction_identification.py             500 records per row of the coverage, 30 drives per row
    python benchmarks/friction_identification.py --reduced   100 and 6, for a quick check

noisy       ΣF_m and held-out error of records with 1 % noise
coverage    95 % intervals of ΣF_m, the virgin curve and the viscous coefficient
drives      The viscous coefficient of drives whose force also depends on the position: 95 kg with 20.4 N of Coulomb
            friction on three elastic elements, 203.5 N s/m and an encoder of 0.4 µm follow a reference for 25 s.
            Wavelengths and phases of the force along the stroke are drawn. Moves that are all at one speed are refused,
            and not counted. No error may be above a tenth while its interval is not; intervals cover 80 % or more
"""

import sys
from collections.abc import Callable

import numpy as np
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.friction_identification import FrictionIdentification
from harness import ROOT, Bench, run
from numba import njit
from numpy.typing import NDArray
from paper_machine import FRICTION, metrics_of

sys.path.insert(0, str(ROOT))
from fraexp.components.kinds import Estimator
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.identification.friction_records import THREE, driven, motion, record, sliding

GUIDE: Rolling = FRICTION  # type: ignore[assignment]
NOISE = 0.01
"""Of the force, relative to its greatest value."""
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


def noisy(bench: Bench) -> None:
    """ΣF_m and the error of held-out cycles, with 1 % noise."""
    floor = NOISE * float(np.abs(driven(GUIDE, motion(2000, 12), 1 / 2000)).max())
    for label, free in (("grid", False), ("back-propagation", True)):
        estimator = FrictionIdentification(back_propagation=free)
        found = metrics_of(estimator.estimate(record(GUIDE, samples=2000, cycles=12, noise=NOISE, seed=bench.seed)))
        bench.bounded(f"{label}: ΣF_m, relative", abs(found["Coulomb force"] / 17.9 - 1), 0.005)
        bench.bounded(f"{label}: held-out error over noise", found["rms error, held-out cycles"] / floor, 1.03)


def runs(seed: int) -> Signals:
    """Return noisy runs at constant velocities against 17.9 N and 4.69 N s/m."""
    rng = np.random.default_rng(seed)
    segments = []
    for velocity in (5e-3, 10e-3, 20e-3, 40e-3):
        quarter = np.arange(400) / 400
        triangle = np.concatenate([quarter, 1 - quarter]) * 10e-3
        y = np.tile(triangle, 3)
        step = 10e-3 / velocity / 400
        v = np.tile(np.repeat([velocity, -velocity], 400), 3)
        force = 0.3 + 17.9 * np.sign(v) + 4.69 * v + rng.normal(size=y.size)
        channels = {"y": y.reshape(3, -1), "u": force.reshape(3, -1)}
        segments.append(Segment(step, channels, np.array([1])))
    return Signals(tuple(segments), {"y": "m", "u": "N"})


def coverage(bench: Bench) -> None:
    """Share of records whose 95 % intervals hold ΣF_m and the virgin curve."""
    count, start = bench.options.records, Rolling(stiffness=THREE.stiffness, limit_force=THREE.limit_force)
    known = FrictionIdentification(thresholds=tuple(GUIDE.limit_deflection.tolist()))
    _count(bench, "known thresholds", known, GUIDE, count)
    _count(bench, "grid", FrictionIdentification(), GUIDE, count)
    chosen = "free thresholds, number chosen (believes in that number)"
    _count(bench, chosen, FrictionIdentification(back_propagation=True), GUIDE, count // 5, more=0.06)
    _count(bench, "free thresholds", FrictionIdentification(starts=(start,)), THREE, count)
    inside = 0
    for seed in range(bench.seed, bench.seed + count):
        found = metrics_of(sliding(constant_velocity=True).estimate(runs(seed)))
        inside += abs(found["viscous coefficient"] - 4.69) <= found["viscous coefficient, 95 %"]
    bench.share("runs at constant velocity: D_v", inside / count, count)


def _count(bench: Bench, name: str, estimator: Estimator, truth: Rolling, count: int, more: float = 0.0) -> None:
    """Count how often ΣF_m and the virgin curve lie within their intervals; the curve may be off by `more`."""
    force, curve, total = 0, [], sum(truth.elements[1])
    for seed in range(bench.seed, bench.seed + count):
        result = estimator.estimate(record(truth, samples=300, noise=NOISE, seed=seed))
        found, columns = metrics_of(result), result.curves[0].columns
        force += abs(found["Coulomb force"] - total) <= found["Coulomb force, 95 %"]
        virgin = np.minimum(columns["displacement"][:, None], truth.limit_deflection) @ truth.element_stiffness
        curve.append(np.mean((columns["lower 95 %"] <= virgin) & (virgin <= columns["upper 95 %"])))
    bench.share(f"{name}: ΣF_m", force / count, count)
    bench.share(f"{name}: virgin curve", float(np.mean(curve)), count, tolerance=0.02 + more)


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


def _errors(bench: Bench, kind: Callable[..., NDArray[np.float64]], row: tuple[tuple[float, ...], ...]) -> np.ndarray:
    """Return error, 95 % interval and bound over the viscous coefficient, shape (drives, 3)."""
    found = []
    for number in range(bench.options.drives):
        rng = bench.generator(number)
        amplitudes, wavelengths, fractions = (np.array(each) for each in row)
        drawn = wavelengths * rng.uniform(0.8, 1.25, wavelengths.size)
        volts, y = drive(kind(rng), amplitudes, drawn, fractions, rng.uniform(0, 2 * np.pi, wavelengths.size))
        channels = {"u": NEWTON_PER_VOLT * volts[None], "y": y[None]}
        segment = Segment(SAMPLE_TIME, channels, np.array([1]), periodic=False)
        try:
            result = sliding().estimate(Signals((segment,), {"u": "N", "y": "m"}))
        except RecordError:  # all sliding is at one speed
            continue
        metrics = metrics_of(result)
        names = ("viscous coefficient, 95 %", "viscous coefficient, 95 %, Cramér-Rao bound")
        found.append([metrics["viscous coefficient"] - VISCOUS, *(metrics[name] for name in names)])
    return np.array(found) / VISCOUS


def drives(bench: Bench) -> None:
    """Viscous coefficient [%]: worst and rms error, medians of interval and bound, and coverage."""
    for name, row in ROWS.items():
        for kind in (moves, same_moves):
            found = _errors(bench, kind, row)
            size = np.abs(found[:, 0])
            covered = float(np.mean(size < found[:, 1]))
            is_met = covered > MIN_COVERED and not np.any((size > MAX_ERROR) & (found[:, 1] < MAX_ERROR))
            figures = (size.max(), np.sqrt(np.mean(size**2)), *np.median(found[:, 1:], axis=0))
            text = "".join(f"{100 * value:>7.2f}%" for value in figures) + f"{covered:>9.0%}"
            bench.row(f"{name}, moves {'drawn' if kind is moves else 'alike'}", text, bool(is_met))


if __name__ == "__main__":
    run(__doc__, noisy, coverage, drives, records=(500, 100), drives=(30, 6))
