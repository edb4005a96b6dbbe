"""A known periodic signal injected while a simulated drive makes its moves: the apparent mass, with friction taken off.

The drive is simulated by time stepping of its own (`tests/records/strangers.py`), with Coulomb and viscous friction, an
offset, and an encoder of 0.5 um.
"""

from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.estimators.injection_on_motion import apparent_mass_metrics

from fraexp.analysis.confidence import circle_factor, degrees_of_freedom
from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.kinds import Estimator
from fraexp.components.registry import create, discover
from fraexp.data.results import FrequencyResponse, Result
from fraexp.data.signals import Segment, Signals
from fraexp.errors import RecordError
from tests.records.strangers import Drive, point_to_point
from tests.records.strangers_files import results
from tests.refusals import refused

DRIVE, PERIOD, AMPLITUDE_N = Drive(), 200, 4.0
LINES = np.arange(4, 20, 3)
MAX_MASS_ERROR = 0.001
MAX_RMS_DEVIATIONS = 1.6
"""Of 8 masses, with 1 expected: more than that happens by chance once in 200 times."""
MIN_COVERAGE = 0.9
"""Of 72 lines per kind of move, with 95 % expected: less than that happens by chance once in 25 kinds."""
REPEATED_INCREMENTS = 0.02
"""Error in encoder increments that repeats itself: at a constant velocity the increments follow the injection."""


def injection(samples: int, seed: int = 0) -> np.ndarray:
    """Return the known multisine [N]."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, LINES.size)
    turning = np.exp(2j * np.pi * np.outer(np.arange(samples), LINES) / PERIOD + 1j * phases)
    return AMPLITUDE_N * turning.real.sum(axis=1)


@pytest.fixture(scope="module")
def moves() -> dict[str, np.ndarray]:
    """Return force [N], position [m] and injected force [N] during point-to-point moves."""
    return record(DRIVE, point_to_point(DRIVE.rate))


def record(drive: Drive, reference: np.ndarray, seed: int = 0) -> dict[str, np.ndarray]:
    """Return force [N], position [m] and injected force [N] of a drive along a reference [m]."""
    reference = reference[: reference.size // PERIOD * PERIOD]
    injected = injection(reference.size, seed)
    volts, counts = drive.follow(reference, injected)
    return {"u": drive.volt * volts, "y": drive.count * counts, "excitation": injected}


def drawn_move(kind: str, rng: np.random.Generator, rate: float = 1000.0, seconds: float = 24.0) -> np.ndarray:
    """Return moves that no polynomial describes: a triangle, with a sine, or constant accelerations [m]."""
    if kind != "trapezoid":
        t = np.arange(int(seconds * rate)) / rate
        triangle = rng.uniform(0.015, 0.03) * 2 / np.pi * np.arcsin(np.sin(2 * np.pi * rng.uniform(0.2, 0.4) * t))
        return triangle + (2e-3 * np.sin(2 * np.pi * 2.37 * t) if kind == "sine" else 0.0)
    speed = np.repeat(rng.uniform(-0.08, 0.08, int(seconds)), int(rate))
    ramp = int(0.15 * rate)
    return np.cumsum(np.convolve(speed, np.full(ramp, 1 / ramp), mode="same")) / rate


def estimate(moves: dict[str, np.ndarray], **spec: object) -> Result:
    channels = {name: values.reshape(-1, PERIOD).copy() for name, values in moves.items()}
    signals = Signals((Segment(1 / DRIVE.rate, channels, LINES),), {"u": "N", "y": "m", "excitation": "N"})
    return create(discover(), Estimator, {"input": "u", "output": "y", **spec}, place="here").estimate(signals)


def mass_error(found: Result, drive: Drive = DRIVE) -> float:
    values = {metric.name: metric.value for metric in found.metrics}
    return abs(values["apparent mass"] / drive.mass - 1)


def compensated(drive: Drive) -> dict[str, object]:
    """Return the estimator that takes the drive's friction off."""
    friction = {"name": "coulomb", "coulomb_force": drive.coulomb, "viscous_coefficient": drive.viscous}
    method = {"name": "injection_on_motion"}
    return {"name": "effective_input", "friction": friction, "resolution": drive.count, "method": method}


def test_the_apparent_mass_is_found_where_the_conventional_response_is_far_off(moves: dict[str, np.ndarray]) -> None:
    found = estimate(moves, name="injection_on_motion", refer_to_plant=True)
    assert mass_error(found) < MAX_MASS_ERROR
    plain = estimate(moves, name="conventional", refer_to_plant=True).response
    assert plain is not None
    apparent = 1 / np.abs(plain.response) / (2 * np.pi * plain.frequency) ** 2
    assert np.median(np.abs(apparent / DRIVE.mass - 1)) > 0.2
    (curve,) = found.curves
    damping = -curve.columns["imaginary part"] * 2 * np.pi * curve.columns["frequency"]
    assert np.median(damping) == pytest.approx(DRIVE.viscous, rel=0.2)  # F/a = M + D/(jw)


def test_an_axis_that_only_oscillates_is_refused(moves: dict[str, np.ndarray]) -> None:
    still = {**moves, "y": 1e-6 * np.sin(2 * np.pi * 20 * np.arange(moves["y"].size) / DRIVE.rate)}
    with refused(RecordError, "0 blocks", "0.2 s", "min_speed"):
        estimate(still, name="injection_on_motion")


def test_lines_that_the_polynomial_contains_are_refused(moves: dict[str, np.ndarray]) -> None:
    with refused(RecordError, "4 periods", "order", "min_frequency"):
        estimate(moves, name="injection_on_motion", order=10)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["triangle", "sine", "trapezoid"])
def test_bands_cover_the_plant_on_drawn_drives_and_moves(kind: str) -> None:
    inside: list[np.ndarray] = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        sizes = {"mass": rng.uniform(2, 8), "coulomb": rng.uniform(3, 12), "viscous": rng.uniform(5, 40)}
        drive = Drive(**sizes)
        signals = record(drive, drawn_move(kind, rng), seed)
        s = 2j * np.pi * LINES * drive.rate / PERIOD
        for damping, spec in (
            (drive.viscous, {"name": "injection_on_motion", "refer_to_plant": True}),
            (0.0, compensated(drive)),
        ):
            found = estimate(signals, **spec)
            assert mass_error(found, drive) < MAX_MASS_ERROR
            assert found.response is not None
            radius = circle_factor(degrees_of_freedom(found.response)) * found.response.standard_deviation
            radius += REPEATED_INCREMENTS * drive.count / found.response.input_amplitude
            inside.append(np.abs(found.response.response - 1 / (drive.mass * s**2 + damping * s)) <= radius)
    assert np.mean(inside) >= MIN_COVERAGE


@pytest.mark.thorough
def test_the_masss_interval_covers_it_where_one_move_is_repeated() -> None:
    """The increments of the encoder repeat themselves with the move: the scatter alone gave 2.3 deviations."""
    deviations, covered = [], []
    for seed in range(8):
        rng = np.random.default_rng(300 + seed)
        drive = Drive(mass=rng.uniform(2, 8), coulomb=rng.uniform(3, 12), viscous=rng.uniform(5, 40))
        s = np.linspace(0, 1, 600)
        there = rng.uniform(0.02, 0.05) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        one = np.concatenate([there, np.full(PERIOD, there[-1]), there[::-1], np.zeros(PERIOD)])
        found = estimate(record(drive, np.tile(one, 15), seed), name="injection_on_motion", refer_to_plant=True)
        values = {metric.name: metric.value for metric in found.metrics}
        deviations.append((values["apparent mass"] - drive.mass) / values["apparent mass deviation"])
        covered.append(abs(values["apparent mass"] - drive.mass) < values["apparent mass, 95 %"])
    assert np.sqrt(np.mean(np.square(deviations))) < MAX_RMS_DEVIATIONS
    assert sum(covered) >= 7


def test_the_masss_interval_covers_it_with_few_blocks_per_line() -> None:
    """Lines drawn with deviations that are estimated from 6 blocks: weights by estimates make 1/sqrt(sum) too small."""
    rng = np.random.default_rng(1)
    frequency, freedom, trials = np.linspace(20, 95, 6), np.full(6, 10.0), 1500
    true = 1 / (2j * np.pi * frequency) ** 2
    unused = np.full(6, np.nan)
    relative = 1e-4 * np.linspace(1, 2, 6)
    inside, inside_by_weights = [], []
    for _ in range(trials):
        noise = relative * (rng.normal(size=6) + 1j * rng.normal(size=6)) / np.sqrt(2)
        variance = (relative * np.abs(true)) ** 2 * rng.chisquare(freedom) / freedom
        covariance = np.eye(2) * variance[:, None, None] / 2
        found = FrequencyResponse(
            frequency, true * (1 + noise), covariance, "m/N", "u", "y", unused, unused, np.full(6, True), unused,
            unused, np.zeros((6, 6), complex), freedom,
        )  # fmt: skip
        values = {metric.name: metric.value for metric in apparent_mass_metrics(found)}
        inside.append(abs(values["apparent mass"] - 1) < values["apparent mass, 95 %"])
        weights = 1 / (variance / np.abs(true) ** 2 / 2)
        inside_by_weights.append(abs(values["apparent mass"] - 1) < 1.96 / np.sqrt(weights.sum()))
    assert 0.935 < np.mean(inside) < 0.965
    assert np.mean(inside_by_weights) < 0.92


def test_a_record_of_moves_gives_the_mass_by_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moves: dict[str, np.ndarray]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = np.column_stack([moves["u"], moves["y"], moves["excitation"]])
    np.savetxt(tmp_path / "moves.csv", rows, "%.10g", ",", header="u [N],y [m],injected [N]", comments="")
    command = ["import", "moves.csv", "--channel", "u=u", "--channel", "y=y", "--channel", "excitation=injected"]
    clock = ["--sample-rate", "1000", "--samples-per-period", "200", "--input", "excitation"]
    estimator = ["--estimator", "injection_on_motion", "--set", "estimator.refer_to_plant=true"]
    assert main([*command, *clock, *estimator]) == ExitCode.OK
    (result,) = results(tmp_path, "moves")
    assert mass_error(result) < MAX_MASS_ERROR
