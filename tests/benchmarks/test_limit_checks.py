"""Limits hold in a simulation that shares no code with the check, and are exceeded there if it takes them too high."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

pytestmark = pytest.mark.thorough


@pytest.fixture
def limits(checkout, monkeypatch):
    """Return the benchmark, with fewer excitations a machine."""
    monkeypatch.syspath_prepend(str(checkout / "benchmarks"))
    import limit_checks

    monkeypatch.setattr(limit_checks, "PER_MACHINE", 100)
    monkeypatch.setattr(limit_checks, "PER_BATCH", 100)
    return limit_checks


def examined(limits, margin):
    """Return what six machines show, one with each law."""
    return next(itertools.islice(limits.examine(5, margin, 0.0), 5, None))


def test_no_excitation_that_is_played_exceeds_a_limit_by_more_than_its_margin(limits):
    tally = examined(limits, None)
    assert (tally.drawn, tally.failed) == (600, 0)
    assert 100 < tally.refused < 300
    assert tally.above_margin == 0
    assert -0.5 < tally.greatest <= 1  # in margins: the check is not needlessly strict


def test_limits_that_are_taken_two_percent_too_high_are_exceeded(limits):
    assert examined(limits, -0.02).above_limit > 0


@pytest.mark.parametrize("law", ["none", "rolling", "lugre", "dahl", "coulomb"])
def test_the_fast_simulation_has_the_motion_of_the_exact_one(limits, law):
    import limit_truth
    from reference_loop import ReferenceRun

    drawn = limits.with_whole_steps(limits.drawn_machine(3, 5, law, (1e-3,))).reference
    machine = replace(drawn, lags=((), ()))
    run = ReferenceRun(machine, 20.0, 30.0, 40)
    wave, rise = run.arguments[-2:]
    control, late_position = run.advance(1000)
    play, encoder = limit_truth.FinePlay(wave, rise, 1000, 1000), limit_truth.FineEncoder(0.0, np.zeros(1))
    (found,) = limit_truth.simulate_plays(machine, [play], encoder)
    assert found[0] == pytest.approx(np.ptp(late_position), rel=0.01)
    assert found[3] == pytest.approx(np.abs(control).max(), rel=0.005)
