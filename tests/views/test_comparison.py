"""What differs between sweeps, and between groups of them."""

import numpy as np

from fraexp.components.registry import discover
from fraexp.data.results import Metric, Outcome, Result
from fraexp.store import StoredSweep
from fraexp.views.comparison import difference_rows


def drawn(amplitude: float, draw: int, stiffness: float) -> StoredSweep:
    """A sweep of a random draw."""
    friction = {"name": "dahl", "stiffness": stiffness, "coulomb_force": 5.0}
    experiment = {"source": "loop", "excitation": {"amplitude": amplitude}, "friction": friction}
    labels = {"excitation.amplitude": amplitude, "draw": draw, "friction.stiffness": stiffness}
    key = f"fx2-{amplitude:g}-{draw}"
    return StoredSweep(key, experiment, {"name": "h1"}, labels, Outcome.OK, (), 0.0, None, "computed")


def test_a_group_shows_the_median_of_what_differs_within_it() -> None:
    stiffness = np.random.default_rng(1).uniform(1e6, 2e6, (2, 15))
    groups = [[drawn(a, n, float(of[n])) for n in range(15)] for a, of in zip((6.0, 12.0), stiffness, strict=True)]
    results = {of.key: Result(Outcome.OK, metrics=(Metric("time", 2.0 * n, "s"),))
               for group in groups for n, of in enumerate(group)}  # fmt: skip
    results[groups[1][7].key] = Result(Outcome.OK, metrics=(Metric("time", 100.0, "s"),))
    rows = {name: texts for name, *texts in difference_rows(groups, results, discover())}
    shown = [float(text) for text in rows["friction.stiffness [N/m]"]]
    np.testing.assert_allclose(shown, np.median(stiffness, axis=1), rtol=1e-9)
    assert rows["excitation.amplitude"] == ["6", "12"]
    assert rows["time [s]"] == ["14", "16"]
    assert "friction.coulomb_force" not in rows


def test_sweeps_alone_are_groups_of_one() -> None:
    sweeps = [drawn(6.0, n, 1e6 * (n + 1)) for n in range(2)]
    assert difference_rows([[sweep] for sweep in sweeps], {}, discover()) == [
        ["friction.stiffness [N/m]", "1000000", "2000000"]
    ]
