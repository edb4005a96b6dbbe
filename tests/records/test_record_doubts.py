"""Wrong samples, axes that turn and units that no machine has are told; what machines do is not."""

import numpy as np
import pytest
from fraexp_plugins.estimators.best_linear_approximation import BestLinearApproximation
from fraexp_plugins.estimators.conventional import Conventional
from fraexp_plugins.estimators.local_polynomial import LocalPolynomial
from numpy.typing import NDArray

from fraexp.data.findings import Finding
from fraexp.data.results import Outcome
from fraexp.data.signals import Segment, Signals
from fraexp.records.record_doubts import find_wrong_samples, implausible_units
from tests.responses import judged

PERIODS, SAMPLES = 6, 1000
LINES = np.arange(1, 40, 3)
TIME = np.arange(PERIODS * SAMPLES) / SAMPLES
NOISE = np.random.default_rng(6).normal(size=TIME.size)
SINE = np.sin(2 * np.pi * TIME)
WAVE = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES)
SMOOTH = np.cos(2 * np.pi * np.outer(TIME, LINES) + LINES**2) @ (1.0 / LINES**2)
STICKING = np.cumsum(np.sign(SINE) * np.maximum(np.abs(SINE) - 0.5, 0)) / 100
"""It stands still for a third of the time, at both reversals."""
HIDDEN = slice(40, None, 497)
"""Twelve samples, two in each period."""


def flat_wave(line: int, flatter: float) -> NDArray[np.float64]:
    """Return a sine with a third harmonic that flattens its tops, as friction does."""
    return np.cos(2 * np.pi * line * TIME) - flatter * np.cos(6 * np.pi * line * TIME)


HARMLESS = {
    "sine": SINE,
    "wave": WAVE,
    "still": np.zeros(TIME.size),
    "noise": NOISE,
    "noisy": WAVE + 0.3 * NOISE,
    "settling": WAVE + 4 * np.exp(-2 * TIME),
    "from rest": np.where(TIME < 0.2, 0.0, WAVE),
    "drift": SMOOTH + 1e-4 * TIME,
    "walk": WAVE + np.cumsum(NOISE) * 0.005,
    "square": np.sign(np.sin(2 * np.pi * TIME * (1 + 3e-4) + 0.3)),
    "noisy square": np.sign(np.sin(2 * np.pi * TIME + 1e-3)) + 0.02 * NOISE,
    "pulse": np.where(np.sin(2 * np.pi * TIME + 0.01 * np.cumsum(NOISE) / 10) > 0.9, 1.0, 0.0),
    "triangle": np.round(np.abs(np.mod(2 * TIME, 2) - 1), 2),
    "fast": np.sin(2 * np.pi * TIME * SAMPLES / 3),
    "fine": np.round(SINE, 2),
    "coarse": np.round(SINE, 1),
    "coarse and noisy": np.round(WAVE + 0.1 * NOISE),
    "sticking": np.round(STICKING, 3),
    "3 % flatter": np.round(50 * flat_wave(35, 0.03)) / 50,
    "6 % flatter": np.round(45 * flat_wave(38, 0.06)) / 45,
    "10 % flatter": np.round(45 * flat_wave(43, 0.1)) / 45,
}
"""What machines and their encoders do."""


def found_in(y: NDArray[np.float64], unit: str = "rad", name: str = "y", periodic: bool = True) -> list[Finding]:
    blocks = y.reshape(PERIODS if periodic else 1, -1)
    return list(find_wrong_samples([Segment(1e-3, {name: blocks}, LINES, periodic=periodic)], {name: unit}))


def kinds(*given, **more) -> list[str]:
    return [each.kind for each in found_in(*given, **more)]


def replaced(where: slice | list[int], value: float, noise: float = 1e-3) -> NDArray[np.float64]:
    y = WAVE + noise * NOISE
    y[where] = value
    return y


@pytest.mark.parametrize("y", HARMLESS.values(), ids=HARMLESS)
def test_what_machines_do_is_not_questioned(y: NDArray[np.float64]) -> None:
    assert found_in(y) == []


@pytest.mark.parametrize("value", [5.0, -5.0, 100.0])
@pytest.mark.parametrize("where", [0, 1234, TIME.size - 8])
@pytest.mark.parametrize(("length", "periodic"), [(1, True), (8, True), (1, False)])
def test_a_spike_is_found_at_its_place(value: float, where: int, length: int, periodic: bool) -> None:
    (found,) = found_in(replaced(slice(where, where + length), value), periodic=periodic)
    period, sample = divmod(where, SAMPLES) if periodic else (0, where)
    assert (found.kind, found.place) == ("spikes", f"'y', sample {sample + 1} of period {period + 1}")
    assert [found.quantities[0].value, found.quantities[-1].value] == [value, length]


@pytest.mark.parametrize(("value", "noise"), [(-9999.0, 1e-6), (5.0, 1e-2), (0.0, 1e-3)])
@pytest.mark.parametrize(
    "where",
    [HIDDEN, slice(int(np.argmax(WAVE[:SAMPLES])), None, SAMPLES)],
    ids=["two in each", "the same sample of each"],
)
def test_spikes_of_all_periods_do_not_hide_one_another(value: float, noise: float, where: slice) -> None:
    (found,) = found_in(replaced(where, value, noise))
    assert found.kind == "spikes"
    assert found.quantities[-1].value == len(range(TIME.size)[where]) or value == 0.0


def test_several_channels_are_told_and_each_once() -> None:
    channels = {name: replaced([5], 10.0).reshape(PERIODS, -1) for name in ("y", "z")}
    found = find_wrong_samples([Segment(1e-3, channels, LINES)] * 2, {"y": "m", "z": "m"})
    assert [each.place for each in found] == ["'y', sample 6 of period 1", "'z', sample 6 of period 1"]


@pytest.mark.parametrize(("value", "do_harm"), [(2.0, False), (300.0, True)])
def test_what_hardly_changes_a_response_does_no_harm(value: float, do_harm: bool) -> None:
    y = SINE.copy()
    y[1234] = value
    segment = Segment(1e-3, {"y": y.reshape(PERIODS, -1)}, np.array([1]))
    (found,) = find_wrong_samples([segment], {"y": "m"})
    without, with_it = (np.fft.fft(of.reshape(PERIODS, -1).mean(axis=0))[1] for of in (SINE, y))
    assert bool(abs(with_it / without - 1) > 0.01) is do_harm
    assert (found.error > 0.01) is do_harm


@pytest.mark.parametrize(("start", "length"), [(2300, 120), (3500, 700), (2500, 1500), (200, 300), (5800, 150)])
def test_a_lost_signal_is_found(start: int, length: int) -> None:
    (found,) = found_in(replaced(slice(start, start + length), WAVE[start]))
    assert (found.kind, found.quantities[-1].value) == ("lost signal", length)
    assert found.place == f"'y', sample {start % SAMPLES + 1} of period {start // SAMPLES + 1}"


@pytest.mark.parametrize("level", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("step", [1e-9, 1e-3, 0.005])
def test_a_clipped_motion_is_found(level: float, step: float) -> None:
    top = level * np.abs(WAVE).max()
    y = np.clip(np.round(WAVE / step) * step + 1e-9 * NOISE, -top, top)
    (found,) = found_in(y)
    assert found.kind == "clipped"
    assert {abs(each.value) for each in found.quantities} == {top}
    assert kinds(y, unit="N") == kinds(y, name="u") == [], "commands are limited on purpose"


@pytest.mark.parametrize("level", [0.5, 0.97, 0.99])
def test_a_wave_that_is_clipped_near_its_top_is_found(level: float) -> None:
    """It slows down before, but is as fast as many changes from step to step when it stops."""
    flat = flat_wave(1, 0.08)
    assert kinds(np.clip(np.round(flat, 5), -np.inf, level * flat.max())) == ["clipped"]


@pytest.mark.parametrize("modulus", [2 * np.pi, 1.0, 65536 / 10430.378])
@pytest.mark.parametrize("speed", [0.0, 0.6, -3.0])
@pytest.mark.parametrize("periodic", [True, False])
def test_an_angle_that_wraps_is_found(modulus: float, speed: float, periodic: bool) -> None:
    angle = np.mod(0.2 * SMOOTH + modulus * speed * TIME + 1e-5 * NOISE, modulus)
    assert kinds(angle, periodic=periodic) == ["wraps"]
    assert "wraps" not in kinds(np.unwrap(angle, period=modulus), periodic=periodic)
    assert "wraps" not in kinds(angle, unit="N", periodic=periodic), "a sawtooth of a force"


def test_one_wrap_of_a_whole_turn_is_enough() -> None:
    angle = 0.2 * SMOOTH + TIME + 1
    (found,) = found_in(np.mod(angle, 2 * np.pi))
    assert (found.kind, found.quantities[-1].value) == ("wraps", 1)
    assert "wraps" not in kinds(np.mod(angle, 4.0))


@pytest.mark.parametrize("speed", [1e-5, 0.1, -6.0])
def test_a_steady_motion_is_in_the_band_of_estimators_that_do_not_take_it_off(speed: float) -> None:
    moving = 0.01 * SMOOTH + speed * TIME + 1e-9 * NOISE
    channels = {"u": SMOOTH.reshape(PERIODS, -1), "y": moving.reshape(PERIODS, -1)}
    signals = Signals((Segment(1e-3, channels, LINES),), {"u": "N m", "y": "rad"})
    for estimator in (Conventional(), BestLinearApproximation(), LocalPolynomial()):
        found = judged(estimator, signals)
        is_right = isinstance(estimator, LocalPolynomial) or abs(speed) < 1e-3
        assert found.response is not None
        assert found.outcome is (Outcome.OK if is_right else Outcome.INACCURATE), found.message
        off = np.abs(found.response.response - 0.01)
        assert bool(off.max() < 1e-3) is is_right
        assert (off < 3 * found.response.standard_deviation + 1e-12).all()
        told = [each for each in found.findings if each.kind == "steady motion"]
        assert len(told) == (not is_right)
        for moved in told:
            assert (moved.place, len(moved.frequencies)) == ("'y'", LINES.size)
            assert moved.quantities[1].value == pytest.approx(speed, 1e-3)


TWO_LINES = np.array([3, 7])


def doubts_of_mass(mass: float, force: float, units: tuple[str, str] = ("N", "m")) -> list[Finding]:
    """Return the findings on a free mass [kg or kg m²] that a force [N or N m] moves at 3 and 7 Hz."""
    time = np.arange(1000) / 1000
    waves = np.sin(2 * np.pi * np.outer(time, TWO_LINES))
    position = -force / mass * waves @ (1 / (2 * np.pi * TWO_LINES) ** 2)
    channels = {"u": force * waves.sum(axis=1)[None], "y": position[None]}
    return list(implausible_units([Segment(1e-3, channels, TWO_LINES)], dict(zip(("u", "y"), units, strict=True))))


@pytest.mark.parametrize(("mass", "force"), [(1e-3, 1e-2), (7.6, 12.0), (5e3, 2e4)])
def test_machines_are_not_questioned(mass: float, force: float) -> None:
    assert doubts_of_mass(mass, force) == doubts_of_mass(mass, force, ("N m", "rad")) == []


def test_a_mass_of_94_t_is_questioned() -> None:
    (mass,), (inertia,) = doubts_of_mass(94e3, 12.0), doubts_of_mass(1e7, 12.0, ("N m", "rad"))
    assert (mass.place, mass.quantities[0].value) == ("'u' over 'y'", pytest.approx(94e3))
    assert (inertia.quantities[0].name, inertia.quantities[0].value) == ("apparent inertia", pytest.approx(1e7))


def test_a_stroke_of_40_m_is_questioned() -> None:
    (found,) = doubts_of_mass(1e-3, 10.0)
    assert (found.place, found.quantities[0].value) == ("'y'", pytest.approx(66.6, rel=1e-3))
    assert doubts_of_mass(1e-3, 10.0, ("A", "rad")) == []  # a motor may turn on


def test_channels_that_stand_still_are_not() -> None:
    still = Segment(1e-3, {"u": np.zeros((1, 1000)), "y": np.zeros((1, 1000))}, TWO_LINES)
    assert list(implausible_units([still], {"u": "N", "y": "m"})) == []
