"""A record that states of a segment that it had not settled is not ok."""

from collections.abc import Callable
from pathlib import Path

import pytest

from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from tests.records.conftest import Bench


@pytest.mark.parametrize(("settled", "outcome"), [(True, Outcome.OK), (False, Outcome.NOT_SETTLED)])
def test_a_segment_that_had_not_settled_shows_in_the_outcome(
    settled: bool, outcome: Outcome, tmp_path: Path, bench: Bench, signals_of: Callable[..., Signals]
) -> None:
    bench.write(tmp_path / "bench.csv", bench.rows(8))
    one = {"start": 400, "samples": 200, "periods": 2, "harmonics": [*bench.lines], "rest": 0, "settled": True}
    both = [one, {**one, "start": 1000, "settled": settled}]
    signals = signals_of(segments=both, samples_per_period=None)
    assert signals.outcome is outcome
    assert [(of.kind, of.place) for of in signals.findings] == (
        [] if settled else [("not periodic", "1 of 2 segments")]
    )
