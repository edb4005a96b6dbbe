"""The search for the worst plays: its limits are the least that the check lets pass, and no play exceeds its margin."""

from dataclasses import replace

import limit_truth
import limits
import numpy as np
import pytest
from drawn_machines import drawn_machine
from reference_loop import ReferenceRun

from fraexp.errors import MachineError
from fraexp.measurement.measurement_plan import check_points
from fraexp.simulation.motion_limits import MotionLimits

pytestmark = pytest.mark.thorough
MARGIN, FAR = 0.1, 1e12
MAX_RATIO = (1 + limits.MARGIN) / (1 - limits.MARGIN)
"""What a play asks for over what the check keeps within limits, at most."""


def is_played(point, demands):
    """Return what fraexp decides about limits."""
    try:
        check_points([point], MotionLimits(**dict(zip(limits.DEMANDS, demands.tolist(), strict=True))), MARGIN)
    except MachineError:
        return False
    return True


def coordinates(seed):
    """Yield standard normal coordinates of plays."""
    random = np.random.default_rng(seed)
    while True:
        yield random.standard_normal(limits.MOVES.shape[1])


def test_its_limits_are_the_least_that_are_not_refused(monkeypatch):
    allowed, known = [], limits.checked_demands
    monkeypatch.setattr(
        limits, "checked_demands", lambda point: allowed.append((point, known(point))) or allowed[-1][1]
    )
    monkeypatch.setattr(limits, "simulate_plays", lambda *_: np.zeros((limits.LANES, len(limits.DEMANDS))))
    random = np.random.default_rng(11)
    while len(allowed) < 6:
        limits.play_ratio("rolling", random.standard_normal(limits.MOVES.shape[1]))
    for point, demands in allowed:
        for kind, demand in enumerate(demands):
            chosen = np.full(len(demands), FAR)
            for factor in (1 - 1e-6, 1 + 1e-6):
                chosen[kind] = factor * demand / (1 - MARGIN)
                assert is_played(point, chosen) == (factor > 1)


def test_the_same_coordinates_draw_the_same_play():
    random = np.random.default_rng(12)
    ratios = [limits.score("none", random.standard_normal(limits.MOVES.shape[1])) for _ in range(3)]
    random = np.random.default_rng(12)
    assert ratios == pytest.approx(
        [limits.score("none", random.standard_normal(limits.MOVES.shape[1])) for _ in range(3)], nan_ok=True, abs=0
    )


def test_coordinates_draw_as_a_generator_does():
    random = limits.CoordinateRandom(np.random.default_rng(13).standard_normal(60_000))
    assert random.uniform(2, 4, 20_000).mean() == pytest.approx(3, abs=0.02)
    assert np.bincount([random.integers(1, 4) for _ in range(20_000)])[1:] == pytest.approx(20_000 / 3, rel=0.05)
    assert {random.choice([0.0, 0.5]) for _ in range(20)} == {0.0, 0.5}


@pytest.mark.parametrize("law", list(limits.WEIGHTS))
def test_no_play_that_is_let_pass_exceeds_its_margin_and_the_check_is_not_needlessly_strict(law):
    found = [limits.score(law, each) for each, _ in zip(coordinates(15), range(8), strict=False)]
    assert np.nanmax(found) <= MAX_RATIO
    assert np.nanmax(found) > 0.9


@pytest.mark.parametrize("law", ["none", "rolling", "lugre", "dahl", "coulomb"])
def test_the_fast_simulation_has_the_motion_of_the_exact_one(law):
    drawn = limits.with_whole_steps(drawn_machine(3, 5, law, (1e-3,))).reference
    machine = replace(drawn, lags=((), ()))
    run = ReferenceRun(machine, 20.0, 30.0, 40)
    wave, rise = run.arguments[-2:]
    control, late_position = run.advance(1000)
    play, encoder = limit_truth.FinePlay(wave, rise, 1000, 1000), limit_truth.FineEncoder(0.0, np.zeros(1))
    (found,) = limit_truth.simulate_plays(machine, [play], encoder)
    assert found[0] == pytest.approx(np.ptp(late_position), rel=0.01)
    assert found[3] == pytest.approx(np.abs(control).max(), rel=0.005)
