"""Margins of loops whose closed forms are solved by other means, and the coverage of their intervals."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from fraexp.analysis.stability_margins import LoopFigure, LoopResponse, loop_figures
from tests.examples import some

DELAY = 2e-3
MIN_COVERAGE = 0.9
"""Of 100 loops, with 95 % expected: less happens by chance once in 35 figures."""
FREQUENCY = np.geomspace(0.5, 400, 4000)


def lead_loop(frequency: np.ndarray) -> np.ndarray:
    """PD with a lag around a mass, behind a delay: stable, crossover near 10 Hz."""
    s = 2j * np.pi * np.asarray(frequency)
    return 2e3 * (1 + s / 30) / (1 + s / 400) / s**2 * np.exp(-s * DELAY)


def integral_loop(frequency: np.ndarray) -> np.ndarray:
    """The same with strong integral action: its gain may neither rise nor fall without limit."""
    s = 2j * np.pi * np.asarray(frequency)
    return lead_loop(frequency) * (1 + 12 / s)


def figures(loop: Callable[[np.ndarray], np.ndarray], deviation: float = 0.0) -> dict[str, LoopFigure]:
    spread = np.full(FREQUENCY.size, 1.96 * deviation)
    return {of.name: of for of in loop_figures(LoopResponse(FREQUENCY, loop(FREQUENCY), spread, spread))}


def phase(loop: Callable[[np.ndarray], np.ndarray], at: float) -> float:
    """Phase less -180°, within ±180°."""
    return float(np.angle(-loop(np.array(at))))


@pytest.mark.parametrize("loop", [lead_loop, integral_loop])
def test_margins_are_those_of_the_closed_form(loop: Callable[[np.ndarray], np.ndarray]) -> None:
    found = figures(loop)
    crossover = brentq(lambda f: abs(loop(f)) - 1, 1, 100)
    assert found["crossover"].value == pytest.approx(crossover, rel=1e-4)
    assert found["phase margin"].value == pytest.approx(phase(loop, crossover), abs=1e-4)
    turn = brentq(lambda f: phase(loop, f), 20, 200)
    assert found["gain margin"].value == pytest.approx(1 / abs(loop(turn)), rel=1e-4)
    assert found["gain margin"].frequency == pytest.approx(turn, rel=1e-4)
    half = brentq(lambda f: abs(loop(f) / (1 + loop(f))) - 2**-0.5, crossover, 100)
    assert found["bandwidth"].value == pytest.approx(half, rel=1e-4)
    nearest = minimize_scalar(lambda f: abs(1 + loop(f)), bounds=(5, 60), method="bounded", options={"xatol": 1e-9})
    assert found["modulus margin"].value == pytest.approx(nearest.fun, rel=1e-4)
    if loop is integral_loop:
        fall = brentq(lambda f: phase(loop, f), 0.6, 8)
        assert found["gain reduction margin"].value == pytest.approx(1 / abs(loop(fall)), rel=1e-4)
    else:
        assert "gain reduction margin" not in found


def test_what_the_frequencies_do_not_show_is_left_out() -> None:
    chosen = FREQUENCY < 8
    unknown = np.full(chosen.sum(), np.nan)
    found = loop_figures(LoopResponse(FREQUENCY[chosen], lead_loop(FREQUENCY[chosen]), unknown, unknown))
    assert [of.name for of in found] == ["modulus margin"]
    assert np.isnan(found[0].half_width)
    assert loop_figures(LoopResponse(FREQUENCY[:1], lead_loop(FREQUENCY[:1]), unknown[:1], unknown[:1])) == []


def drawn_loop(rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return a loop of drawn lead, integral action, delay and resonance around a mass, with a drawn crossover [Hz]."""
    crossover, delay = 2 * np.pi * rng.uniform(5, 20), rng.uniform(0, 3e-3)
    lead, lag, integral = rng.uniform(0.25, 0.5), rng.uniform(3, 8), rng.uniform(0, 0.15)
    mode, damping, share = 2 * np.pi * rng.uniform(30, 90), rng.uniform(0.03, 0.2), rng.uniform(0, 0.3)

    def opened(s: np.ndarray) -> np.ndarray:
        control = (1 + s / (lead * crossover)) / (1 + s / (lag * crossover)) * (1 + integral * crossover / s)
        return control * (1 / s**2 + share / (s**2 + 2 * damping * mode * s + mode**2)) * np.exp(-s * delay)

    size = abs(opened(np.array(1j * crossover)))
    return lambda frequency: opened(2j * np.pi * np.asarray(frequency)) / size


@pytest.mark.parametrize("deviation", some((0.0, 1e-3, 1e-2), 1e-3))
def test_the_intervals_cover_the_closed_form_on_any_grid(deviation: float) -> None:
    """20 to 60 lines in 2.3 decades: the error of the interpolation is in the interval, with or without noise."""
    rng, fine = np.random.default_rng(1), np.geomspace(1, 200, 801)
    hits: dict[str, list[bool]] = {}
    for _ in range(100):
        loop, lines = drawn_loop(rng), int(rng.integers(20, 61))
        grid, spread = np.geomspace(1, 200, lines), np.full(lines, 1.96 * deviation)
        error = rng.normal(0, 1, (2, lines)) * deviation
        noisy = loop(grid) * np.exp(error[0] + 1j * error[1])
        found = {of.name: of for of in loop_figures(LoopResponse(grid, noisy, spread, spread))}
        for true in loop_figures(LoopResponse(fine, loop(fine), 0 * fine, 0 * fine)):
            one = found.get(true.name)
            hits.setdefault(true.name, []).append(one is not None and abs(one.value - true.value) <= one.half_width)
    assert len(hits) == 6
    for name, of in hits.items():
        assert np.mean(of) > MIN_COVERAGE, name


def test_the_intervals_are_no_wider_than_the_noise_asks_for() -> None:
    """On a grid that shows the loop, the half width is that of the scatter."""
    rng, grid = np.random.default_rng(1), np.geomspace(1, 200, 120)
    spread = np.full(grid.size, 1.96 * 0.003)
    error = rng.normal(0, 0.003, (100, 2, grid.size))
    noisy = [lead_loop(grid) * np.exp(one[0] + 1j * one[1]) for one in error]
    found = [{of.name: of for of in loop_figures(LoopResponse(grid, one, spread, spread))} for one in noisy]
    for name in ("crossover", "bandwidth", "phase margin"):
        scatter = 1.96 * np.std([of[name].value for of in found])
        assert np.median([of[name].half_width for of in found]) < 1.4 * scatter
