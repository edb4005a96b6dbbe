"""What a run is expected to take."""

from pathlib import Path

import pytest

from fraexp.plugins import discover
from fraexp.results import Outcome
from fraexp.scheduler import GUESS, plan
from fraexp.store import StoredState
from fraexp.study import Study
from fraexp.sweep import Sweep

ELAPSED = {"quick": (0.1, 0.3, 0.2), "slow": (10.0,), "new": ()}


class Times:
    """Of a database nothing but how long sweeps took."""

    def __init__(self, took: list[tuple[Sweep, float]]) -> None:
        self.states = {sweep.key: StoredState(Outcome.OK, {}, time) for sweep, time in took}

    def known(self, _: list[str]) -> dict[str, StoredState]:
        return self.states


def test_each_estimator_is_expected_to_take_what_it_took() -> None:
    registry = discover()
    took = [
        (Sweep({"n": n}, {"name": name}, {}), time) for name, times in ELAPSED.items() for n, time in enumerate(times)
    ]
    missing = [Sweep({"n": 100 + n}, {"name": name}, {}) for n, name in enumerate(["quick", "slow", "slow", "new"])]
    study = Study("study", Path("study.toml"), "", "", (*(sweep for sweep, _ in took), *missing))
    found, planned = plan(study, Times(took), registry, None)  # type: ignore[arg-type]
    assert [sweep.key for sweep in found] == [sweep.key for sweep in missing]
    assert planned.seconds == pytest.approx(0.2 + 10 + 10 + 0.25)  # the new one as the median of all
    assert plan(study, Times([]), registry, None)[1].seconds == pytest.approx(8 * GUESS)  # type: ignore[arg-type]
