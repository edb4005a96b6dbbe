"""The search for the worst plays: its limits are the least that the check lets pass, and it draws what it says."""

import numpy as np
import pytest

pytestmark = pytest.mark.thorough
MARGIN, FAR = 0.1, 1e12


@pytest.fixture
def search(checkout, monkeypatch):
    monkeypatch.syspath_prepend(str(checkout / "benchmarks"))
    import limit_probability

    return limit_probability


def test_its_limits_are_the_least_that_are_not_refused(search, monkeypatch):
    from limit_checks import is_played

    allowed, known = [], search.checked_demands
    monkeypatch.setattr(
        search, "checked_demands", lambda point: allowed.append((point, known(point))) or allowed[-1][1]
    )
    monkeypatch.setattr(search, "simulate_plays", lambda *_: np.zeros((search.LANES, len(search.DEMANDS))))
    random = np.random.default_rng(11)
    while len(allowed) < 6:
        search.play_ratio("rolling", random.standard_normal(search.MOVES.shape[1]))
    for point, demands in allowed:
        for kind, demand in enumerate(demands):
            limits = np.full(len(demands), FAR)
            for factor in (1 - 1e-6, 1 + 1e-6):
                limits[kind] = factor * demand / (1 - MARGIN)
                assert is_played(point, limits, MARGIN) == (factor > 1)


def test_the_same_coordinates_draw_the_same_play(search):
    random = np.random.default_rng(12)
    ratios = [search.score("none", random.standard_normal(search.MOVES.shape[1])) for _ in range(3)]
    random = np.random.default_rng(12)
    assert ratios == pytest.approx(
        [search.score("none", random.standard_normal(search.MOVES.shape[1])) for _ in range(3)], nan_ok=True, abs=0
    )


def test_coordinates_draw_as_a_generator_does(search):
    random = search.CoordinateRandom(np.random.default_rng(13).standard_normal(60_000))
    assert random.uniform(2, 4, 20_000).mean() == pytest.approx(3, abs=0.02)
    assert np.bincount([random.integers(1, 4) for _ in range(20_000)])[1:] == pytest.approx(20_000 / 3, rel=0.05)
    assert {random.choice([0.0, 0.5]) for _ in range(20)} == {0.0, 0.5}
