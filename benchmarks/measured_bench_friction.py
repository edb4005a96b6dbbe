"""Bound what a measured record of a bench with two inertias says of the friction of its bearings.

python benchmarks/measured_bench_friction.py [FILE]

The record (MIT licence, Hori-Fujimoto Lab) has current and both angles, 20 periods of a multisine of 1 s from 11 to
250 Hz. The torque balance of both bodies needs no model of the shaft: K i = J1 a1 + J2 a2 + D1 v1 + D2 v2 + friction,
with the lag of the current loop and a gain that depends on angle and current. It is linear in its parameters; the
scatter over the periods is its noise.

For Coulomb torque, breakaway angle of an element and Stribeck torque, each beside all other terms, it prints the 95 %
interval of any unbiased estimator (Cramér-Rao) twice: with the noise, and with what the balance leaves in each period
alike. A friction law has to be told from the second. Torques assume 0.07 N m/A; ratios do not depend on it. The exit
code is 1 unless the Coulomb torque of the motor is identified, and neither presliding nor a Stribeck effect.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fraexp_plugins.identification._shared.stop_operator import stop_operators
from numpy.typing import NDArray

import fraexp

RECORD = Path(__file__).resolve().parents[2] / "shared" / "data" / "two_inertia_bench" / "MultisineTypeA.mat"
CHANNELS = {"torque": "iq_adx * 0.07 [N m]", "motor": "theta_mx [rad]", "load": "theta_my * -1 [rad]"}
RATE, PERIOD, LINES = 2500, 2500, np.arange(1, 251)
INERTIA = 3.34e-4
"""Inertia of each body [kg m²] with which the noise is computed: it is what differs between the periods."""
NEIGHBOURS = 10
"""Lines on each side over which what the balance leaves is averaged."""
BREAKAWAY_ANGLES = (1e-5, 1e-4, 3e-4, 1e-3, 2e-3, 4e-3)
STRIBECK_VELOCITIES = (0.1, 0.3, 1.0, 3.0)
"""Angles [rad] and velocities [rad/s] that are tried."""
LOG_STEP = 0.05
QUANTILE, LIKELY = 1.96, 3.84
"""Limits of 95 %: of a value over its standard deviation, and of a rise of χ²."""


class Motion(NamedTuple):
    """Torque [N m], angles [rad] and velocities [rad/s] of all periods but the first, shape (n,)."""

    torque: NDArray[np.float64]
    angles: tuple[NDArray[np.float64], ...]
    velocities: tuple[NDArray[np.float64], ...]


class Balance(NamedTuple):
    """Torque balance at the lines: columns, torque, and variance of its mean over the periods [(N m)²]."""

    names: tuple[str, ...]
    columns: NDArray[np.complex128]
    torque: NDArray[np.complex128]
    noise: NDArray[np.float64]


class Found(NamedTuple):
    """Values of a balance with both 95 % intervals, and χ² over what the balance without friction leaves."""

    values: Mapping[str, float]
    by_noise: Mapping[str, float]
    by_misfit: Mapping[str, float]
    squares: float


def read_motion(file: Path) -> Motion:
    """Return the measured torque, angles and velocities."""
    record = fraexp.read_record(file, CHANNELS, sample_rate=RATE, samples_per_period=PERIOD, skip_periods=1)
    segment = record.signals.segments[0]
    torque, motor, load = (segment.channels[name].ravel() for name in CHANNELS)
    angles = tuple(angle - angle.mean() for angle in (motor, load))
    return Motion(torque, angles, tuple(np.gradient(angle) * RATE for angle in angles))


def phasors(values: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the phasors of each period at the lines, shape (periods, lines)."""
    return np.fft.rfft(values.reshape(-1, PERIOD), axis=1)[:, LINES] * (2 / PERIOD)


def balance(motion: Motion, friction: Mapping[str, NDArray[np.float64]]) -> Balance:
    """Return the balance of both bodies with these friction torques of unit size."""
    s = 2j * np.pi * LINES * RATE / PERIOD
    torque, motor, load = (phasors(values) for values in (motion.torque, *motion.angles))
    columns = {
        "inertia, motor": s**2 * motor,
        "inertia, load": s**2 * load,
        "viscous, motor": s * motor,
        "viscous, load": s * load,
        "lag": s * torque,
        "second lag": s**2 * torque,
        "spring": motor,
        "gain along the stroke": phasors(motion.torque * motion.angles[0]),
        "gain over the current": phasors(motion.torque * np.abs(motion.torque)),
        **{name: phasors(values) for name, values in friction.items()},
    }
    noise = np.var(torque - INERTIA * s**2 * (motor + load), axis=0, ddof=1) / len(torque)
    means = np.array([each.mean(axis=0) for each in columns.values()]).T
    return Balance(tuple(columns), means, torque.mean(axis=0), noise)


def misfit(plain: Balance) -> NDArray[np.float64]:
    """Return the level of what a balance leaves in each period alike [(N m)²], averaged over neighbouring lines."""
    level, window = plain.noise, np.ones(2 * NEIGHBOURS + 1)
    for _ in range(4):
        values, _ = least_squares(plain, level)
        squares = np.abs(plain.torque - plain.columns @ values) ** 2
        level = np.convolve(squares, window, "same") / np.convolve(np.ones_like(squares), window, "same")
    return np.maximum(level, plain.noise)


def least_squares(task: Balance, level: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return values and covariance of a balance if its torque has errors of that variance."""
    weights = np.sqrt(2 / level)  # real and imaginary part have half of the variance each
    weighted, aim = task.columns * weights[:, None], task.torque * weights
    rows = np.vstack([weighted.real, weighted.imag])
    scale = np.linalg.norm(rows, axis=0)
    covariance = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    return covariance @ (rows.T @ np.concatenate([aim.real, aim.imag])), covariance


def solve(task: Balance, level: NDArray[np.float64]) -> Found:
    """Return the values of a balance with both intervals."""
    values, covariance = least_squares(task, level)
    _, by_noise = least_squares(task, task.noise)
    squares = 2 * float(np.sum(np.abs(task.torque - task.columns @ values) ** 2 / level))
    halves = (QUANTILE * np.sqrt(np.diag(each)) for each in (by_noise, covariance))
    named = [dict(zip(task.names, each.tolist(), strict=True)) for each in (values, *halves)]
    return Found(*named, squares)


def elements(motion: Motion, breakaway: float) -> dict[str, NDArray[np.float64]]:
    """Return elements of unit torque at motor and load, and the derivative of the motor's over the logarithm of Y."""
    motor, load = (stop_operators(angle, np.array([breakaway]))[:, 0] / breakaway for angle in motion.angles)
    angles = breakaway * np.exp([-LOG_STEP, LOG_STEP])
    narrow, wide = (stop_operators(motion.angles[0], angles) / angles).T
    return {"motor": motor, "load": load, "breakaway": (wide - narrow) / (2 * LOG_STEP)}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", nargs="?", type=Path, default=RECORD)
    file = parser.parse_args().file
    if not file.exists():
        print(f"{file}: the record is not here; nothing was measured")
        return 0
    motion = read_motion(file)
    plain = balance(motion, {})
    level = misfit(plain)
    without = solve(plain, level).squares
    coulomb = {name: np.sign(v) for name, v in zip(("motor", "load"), motion.velocities, strict=True)}
    found = solve(balance(motion, coulomb), level)
    turns = int(np.sum(np.diff(coulomb["motor"]) != 0))
    above = np.sqrt(level / plain.noise)
    print(f"torque {motion.torque.std():.3f} N m rms, {turns} reversals in {motion.torque.size / RATE:.0f} s;")
    print(f"the balance without friction leaves {np.sqrt(np.sum(level) / 2):.4f} N m rms in each period alike,")
    print(f"{np.median(above):.1f} times the noise at the median line, {np.median(above[:10]):.0f} times below 11 Hz")
    print(f"\n{'Coulomb torque':<28s}{'N m':>9s}{'by noise':>10s}{'by misfit':>11s}")
    for name in coulomb:
        print(f"{name:<28s}{found.values[name]:>9.4f}{found.by_noise[name]:>10.4f}{found.by_misfit[name]:>11.4f}")
    print(f"chi² falls by {without - found.squares:.0f} for two terms")
    torque = found.values["motor"]
    print(f"\n{'breakaway angle [rad]':<28s}{'by noise':>9s}{'by misfit':>10s}{'rise of chi²':>14s}")
    is_narrow = True
    for angle in BREAKAWAY_ANGLES:
        one = elements(motion, angle)
        bound = solve(balance(motion, one), level)
        rise = solve(balance(motion, {name: one[name] for name in coulomb}), level).squares - found.squares
        ratios = (each["breakaway"] / torque for each in (bound.by_noise, bound.by_misfit))
        is_narrow &= (rise > LIKELY) or bound.by_misfit["breakaway"] > 0.5 * torque
        print(f"{angle:<28g}{''.join(f'{ratio:>9.0%} ' for ratio in ratios)}{rise:>13.1f}")
    print(f"\n{'Stribeck velocity [rad/s]':<28s}{'by noise':>9s}{'by misfit':>10s}   of the Coulomb torque")
    is_plain = True
    for speed in STRIBECK_VELOCITIES:
        more = {f"Stribeck, {name}": coulomb[name] * np.exp(-np.abs(v) / speed)
                for name, v in zip(coulomb, motion.velocities, strict=True)}  # fmt: skip
        bound = solve(balance(motion, coulomb | more), level)
        ratios = (each["Stribeck, motor"] / torque for each in (bound.by_noise, bound.by_misfit))
        is_plain &= bound.by_misfit["Stribeck, motor"] > torque
        print(f"{speed:<28g}{''.join(f'{ratio:>9.0%} ' for ratio in ratios)}")
    return int(not (torque > found.by_misfit["motor"] and is_narrow and is_plain))


if __name__ == "__main__":
    sys.exit(main())
