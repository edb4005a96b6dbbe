"""What a run is expected to take."""

from pathlib import Path

import pytest

from fraexp.components.registry import Registry
from fraexp.data.results import Outcome
from fraexp.data.sweep import Sweep
from fraexp.execution.scheduler import plan
from fraexp.store import StoredState
from fraexp.study.study_file import ResolvedStudy


class Stored:
    """Of a database nothing but that it has some sweeps."""

    def __init__(self, sweeps: list[Sweep]) -> None:
        self.states = {sweep.key: StoredState(Outcome.OK, {}, 0.1) for sweep in sweeps}

    def stored_states(self, _: list[str]) -> dict[str, StoredState]:
        return self.states


def test_what_is_missing_takes_time_and_what_is_stored_none(registry: Registry) -> None:
    sweeps = [Sweep({"n": number}, {"name": "unknown"}) for number in range(40)]
    study = ResolvedStudy("study", Path("study.toml"), "", "", tuple(sweeps))

    def expected(stored: int) -> float | None:
        found, planned = plan(study, Stored(sweeps[:stored]), registry, None, executor="serial")  # type: ignore[arg-type]
        assert [sweep.key for sweep in found] == [sweep.key for sweep in sweeps[stored:]]
        return planned.seconds

    assert expected(40) is None
    none, half = expected(0), expected(20)
    assert none is not None
    assert half is not None
    assert none == pytest.approx(half + (none - half))
    assert none > half > 0
