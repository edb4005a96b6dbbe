"""What a report says in words, and how it becomes a PDF."""

from datetime import UTC, datetime

import pytest

from fraexp.data.results import Outcome
from fraexp.reports.published_comparisons import run_title
from fraexp.store import RunSummary, StoredSweep
from fraexp.store.liveness import Process
from fraexp.views.report_tables import verdict_text

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def run(state: str = "complete") -> RunSummary:
    return RunSummary(
        number=1, study="s", study_file="s.toml", command="fraexp run s", started=NOW, ended=NOW, provenance={},
        state=state, total=3, computed=3, reused=0, failed=0, process=Process("", "", 0, ""), heartbeat=NOW,
        silence=0.0, progress=None,
    )  # fmt: skip


def sweeps(*outcomes: Outcome | None) -> list[StoredSweep]:
    return [StoredSweep(f"fx1-{n}", {}, {}, {}, of, (), 1.0, NOW, "computed") for n, of in enumerate(outcomes)]


def test_the_verdict_is_in_words() -> None:
    assert verdict_text(run(), sweeps(Outcome.OK, Outcome.OK), []) == "All 2 sweeps are sound."
    mixed = sweeps(Outcome.OK, Outcome.NOT_SETTLED, None)
    assert verdict_text(run(), mixed, []) == "1 of 3 sweeps are sound, 1 not settled, 1 without a result."
    assert verdict_text(run("partial"), sweeps(Outcome.DIVERGED), []).startswith("The run is partial. The sweep is not")


@pytest.mark.parametrize(
    ("command", "title"),
    [
        ("fraexp run s", "Two amplitudes"),
        ("fraexp run s --set=excitation.amplitude=20", "s with excitation.amplitude = 20"),
        ("fraexp run s --set a=1 --set 'b=[1, 2]'", "s with a = 1, b = [1, 2]"),
        ("another 'program", "Two amplitudes"),
    ],
)
def test_a_title_says_what_the_run_has_changed(command: str, title: str) -> None:
    assert run_title("s", "Two amplitudes", command) == title
