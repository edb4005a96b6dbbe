"""Margins of loops whose closed forms are solved by other means, and the coverage of their intervals."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from fraexp.analysis.stability_margins import LoopFigure, LoopResponse, loop_figures

DELAY = 2e-3
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


def test_the_intervals_cover_noisy_responses() -> None:
    rng = np.random.default_rng(1)
    hits: dict[str, list[bool]] = {}
    for lines in (30, 45, 60):
        grid = np.geomspace(1, 200, lines)
        spread = np.full(lines, 1.96 * 0.003)
        clean = LoopResponse(grid, lead_loop(grid), spread, spread)
        truth = {of.name: of.value for of in loop_figures(clean)}
        for _ in range(400):
            error = rng.normal(0, 0.003, (2, lines))
            for of in loop_figures(clean._replace(response=clean.response * np.exp(error[0] + 1j * error[1]))):
                hits.setdefault(of.name, []).append(abs(of.value - truth[of.name]) < of.half_width)
    assert {name: len(of) for name, of in hits.items()} == dict.fromkeys(truth, 1200)
    for name, of in hits.items():
        assert np.mean(of) == pytest.approx(0.95, abs=0.025), name
