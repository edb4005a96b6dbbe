"""Measure the errors of friction identification, and the coverage of the stated 95 % intervals.

python benchmarks/friction_identification.py             500 records per row of the coverage
python benchmarks/friction_identification.py --reduced   100, for a quick check

The measured record is taken where `../shared/data/tribometer` exists beside the checkout. The exit code is 1 if an
accuracy is missed.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from fraexp_plugins.friction.elastoplastic import Elastoplastic
from fraexp_plugins.friction.gms import GeneralizedMaxwellSlip
from fraexp_plugins.friction.rolling import Rolling
from fraexp_plugins.identification.friction.elastoplastic_identification import ElastoplasticIdentification
from fraexp_plugins.identification.friction.gms_identification import GmsIdentification
from fraexp_plugins.identification.friction.gradient_fit import GradientFit
from fraexp_plugins.identification.friction.masing_inversion import MasingInversion
from fraexp_plugins.identification.friction.rolling_identification import RollingIdentification
from fraexp_plugins.identification.friction.viscous_identification import ViscousIdentification

from fraexp.analysis.confidence import CONFIDENCE_LEVEL
from fraexp.components.kinds import Estimator, FrictionModel
from fraexp.components.registry import discover
from fraexp.data.results import Result
from fraexp.data.signals import Segment, Settling, Signals
from fraexp.records import RecordSettings, load, resolve

TRIBOMETER = Path(__file__).parents[2] / "shared" / "data" / "tribometer" / "test_data_2.txt"
GUIDE = Rolling(
    curve={"coulomb_force": 17.9, "characteristic_displacement": 45.36e-6, "min_knot": 0.5e-6, "max_knot": 100e-6},
    viscous_coefficient=4.69,
)
THREE = Rolling(stiffness=(3e5, 1e5, 5e4), limit_force=(2.0, 4.0, 6.0), viscous_coefficient=4.69)
RATED = {"coulomb_force": 10.0, "static_force": 14.0, "stribeck_velocity": 1e-3}
GMS = GeneralizedMaxwellSlip(
    stiffness=(2e5, 1e5, 6e4, 3e4),
    force_fractions=(0.2, 0.3, 0.3, 0.2),
    attraction_rate=500.0,
    viscous_coefficient=50.0,
    **RATED,
)
BRISTLE = Elastoplastic(bristle_stiffness=3e5, viscous_coefficient=50.0, elastic_limit_ratio=0.6, **RATED)
NOISE = 0.01
"""Of the force, relative to its greatest value."""
CYCLES = 12
COVERED = 0.02
"""Permitted difference of the coverage from 95 %."""

missed: list[str] = []
"""What was said to be missed."""


def record(model: FrictionModel, noise: float, seed: int = 0, samples: int = 2000, cycles: int = CYCLES) -> Signals:
    """Return a measured record: to and fro over 0.4 mm with reversals inside."""
    time_step = 1 / samples
    phase = 2 * np.pi * np.arange(samples) / samples
    y = np.tile(400e-6 * (np.sin(phase) + 0.3 * np.sin(7 * phase)), cycles)
    return _signals(model, y, time_step, noise, seed, cycles)


def varied(model: FrictionModel, noise: float) -> Signals:
    """Return a record from rest at speeds from far below to above 1 mm/s."""
    t = 5e-4 * np.arange(24_000)
    y = 300e-6 * np.sin(2 * np.pi * t) * (1 + 0.9 * np.sin(0.4 * np.pi * t)) + 40e-6 * np.sin(10.6 * np.pi * t)
    return _signals(model, y, 5e-4, noise, 0, 1)


def _signals(model: FrictionModel, y: np.ndarray, time_step: float, noise: float, seed: int, cycles: int) -> Signals:
    force = model.force(y, time_step) + model.viscous * np.gradient(y, time_step)
    force = force + noise * np.abs(force).max() * np.random.default_rng(seed).normal(size=y.size)
    channels = {"displacement": y.reshape(cycles, -1), "friction": force.reshape(cycles, -1)}
    settling = Settling(True, 0.0, 0.0) if cycles == 1 else None
    segment = Segment(time_step, channels, np.array([1]), settling)
    return Signals((segment,), {"displacement": "m", "friction": "N"})


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


def values(result: Result) -> dict[str, float]:
    return {metric.name: metric.value for metric in result.metrics}


def say(what: str, value: float, limit: float, unit: str = "") -> None:
    """Print a value that must not be above its limit."""
    good = abs(value) <= limit
    missed.extend([] if good else [what])
    print(f"{what:<74}{value:>12.4g} {unit:<6} <= {limit:<8.3g}{'' if good else ' MISSED'}")


def exactness() -> None:
    widths = tuple(GUIDE.limit_deflection.tolist())
    found = RollingIdentification(thresholds=widths).estimate(record(GUIDE, 0.0)).fits[0]
    error = np.array(found.component["stiffness"]) / GUIDE.element_stiffness - 1
    say("noise-free, thresholds known, 20 elements: K_i", float(np.abs(error).max()), 1e-8)
    starts = {"least squares": None, "a start of one's own": Rolling(stiffness=(1e5,) * 3, limit_force=(1.0, 5.0, 9.0))}
    for name, start in starts.items():
        found = GradientFit(start=start, elements=3).estimate(record(THREE, 0.0)).fits[0]
        truth = np.array([*THREE.stiffness, *THREE.limit_force, THREE.viscous])
        say(f"noise-free, thresholds free, from {name}", float(np.abs(found.values / truth - 1).max()), 1e-8)
    masing = MasingInversion(thresholds=widths, viscous_coefficient=4.69).estimate(record(GUIDE, 0.0)).fits[0]
    error = np.array(masing.component["stiffness"]) / GUIDE.element_stiffness - 1
    say("noise-free, thresholds known, Masing's rule: K_i", float(np.abs(error).max()), 1e-6)


def noisy() -> None:
    for estimator in (RollingIdentification(), GradientFit()):
        signals = record(GUIDE, NOISE, seed=1)
        found = values(estimator.estimate(signals))
        force = GUIDE.force(signals.segments[0].channels["displacement"].ravel(), 5e-4)
        velocity = np.gradient(signals.segments[0].channels["displacement"].ravel(), 5e-4)
        floor = NOISE * float(np.abs(force + GUIDE.viscous * velocity).max())
        say(f"1 % noise, {estimator.name}: ΣF_m", found["Coulomb force"] / 17.9 - 1, 0.005)
        say(
            f"1 % noise, {estimator.name}: held-out error over noise", found["rms error, held-out cycles"] / floor, 1.03
        )


def laws() -> None:
    for model, estimator in ((GMS, GmsIdentification()), (BRISTLE, ElastoplasticIdentification())):
        found = values(estimator.estimate(varied(model, NOISE)))
        for name, truth, limit in (
            ("Coulomb force", 10.0, 0.005),
            ("static force", 14.0, 0.01),
            ("stribeck velocity", 1e-3, 0.02),
        ):
            say(f"1 % noise, {estimator.name}: {name}", found[name] / truth - 1, limit)
        floor = NOISE * float(np.abs(varied(model, 0.0).segments[0].channels["friction"]).max())
        say(
            f"1 % noise, {estimator.name}: held-out error over noise", found["rms error, held-out cycles"] / floor, 1.05
        )


def tribometer() -> None:
    if not TRIBOMETER.exists():
        print("the measured record is not here: left out")
        return
    for estimator in (RollingIdentification(), GradientFit(), GradientFit(elements=1)):
        found = values(estimator.estimate(measured()))
        name = f"tribometer, {estimator.name}, {found['elements']:.0f} elements"
        say(f"{name}: F_m - 2.33 N", found["Coulomb force"] - 2.33, 0.05, "N")
        say(f"{name}: Y - 58 µm", found["presliding deflection"] - 58e-6, 3e-6, "m")
        energy = found["energy per cycle, model"] / found["energy per cycle"] - 1
        say(f"{name}: energy per cycle ({found['energy per cycle']:.3e} J)", energy, 0.05)
        say(f"{name}: held-out error over F_m", found["rms error, held-out cycles, over the Coulomb force"], 0.05)


def measured() -> Signals:
    """Return the tribometer's reciprocations, without its approach and its end."""
    settings = RecordSettings.parse(
        {
            "file": str(TRIBOMETER),
            "sample_rate": 199.164,
            "steps": [{"start": 9.94, "stop": 210.0, "frequency": 0.248955}],
            "channels": {
                "displacement": "Position",
                "friction": {"column": "Friction", "unit": "uN", "scale": -1},
            },
        },
        "record",
    )
    registry = discover()
    experiment, files = resolve(settings, TRIBOMETER.parent, registry)
    return load(experiment, files, registry)


def coverage(count: int) -> None:
    curve = Rolling(stiffness=THREE.stiffness, limit_force=THREE.limit_force)
    known = RollingIdentification(thresholds=tuple(GUIDE.limit_deflection.tolist()))
    _covered("known thresholds", known, lambda seed: record(GUIDE, NOISE, seed, 300, 8), GUIDE, count)
    _covered("grid", RollingIdentification(), lambda seed: record(GUIDE, NOISE, seed, 300, 8), GUIDE, count)
    chosen = "free thresholds, number chosen (believes in that number)"
    _covered(chosen, GradientFit(), lambda seed: record(GUIDE, NOISE, seed, 300, 8), GUIDE, count // 5, 0.06)
    free = GradientFit(start=curve)
    _covered("free thresholds", free, lambda seed: record(THREE, NOISE, seed, 300, 8), THREE, count)
    inside = 0
    for seed in range(count):
        found = values(ViscousIdentification().estimate(runs(seed)))
        inside += abs(found["viscous coefficient"] - 4.69) <= found["viscous coefficient, 95 %"]
    say(
        f"coverage over {count} records, viscous_identification: D_v, less 95 %",
        inside / count - CONFIDENCE_LEVEL,
        _band(count),
    )


def _band(count: int) -> float:
    return COVERED + 2 * np.sqrt(CONFIDENCE_LEVEL * (1 - CONFIDENCE_LEVEL) / count)


def _covered(
    name: str,
    estimator: Estimator,
    signals: Callable[[int], Signals],
    truth: Rolling,
    count: int,
    more: float = 0.0,
) -> None:
    """Count how often ΣF_m and the virgin curve lie within their intervals; the curve may be off by `more`."""
    force, curve = 0, []
    for seed in range(count):
        result = estimator.estimate(signals(seed))
        found = values(result)
        total = sum(truth.elements[1])
        force += abs(found["Coulomb force"] - total) <= found["Coulomb force, 95 %"]
        columns = result.curves[0].columns
        x = columns["displacement"]
        virgin = np.minimum(x[:, None], truth.limit_deflection) @ truth.element_stiffness
        curve.append(np.mean((columns["lower 95 %"] <= virgin) & (virgin <= columns["upper 95 %"])))
    say(f"coverage over {count} records, {name}: ΣF_m, less 95 %", force / count - CONFIDENCE_LEVEL, _band(count))
    say(
        f"coverage over {count} records, {name}: virgin curve, less 95 %",
        float(np.mean(curve)) - CONFIDENCE_LEVEL,
        _band(count) + more,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reduced", action="store_true", help="100 records per row of the coverage")
    count = 100 if parser.parse_args().reduced else 500
    for part in (exactness, noisy, laws, tribometer, lambda: coverage(count)):
        began = time.perf_counter()
        part()
        print(f"  {time.perf_counter() - began:.1f} s")
    print(f"{len(missed)} missed")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
