"""What other programs on the machine mean for a run."""

from pathlib import Path

import pytest

from fraexp.execution.estimates.machine_load import MAX_SLOWDOWN, slowdown


@pytest.mark.parametrize(
    ("text", "processes", "expected"),
    [
        ("0.05 0.10 0.20 1/500 1234", 1, 1.0),
        ("0.05 0.10 0.20 1/500 1234", 2, 1.0),
        ("2.00 0.10 0.20 1/500 1234", 2, 1.0),  # a run has just ended
        ("0.10 0.10 0.20 9/500 1234", 1, 1.0),  # many run for a moment
        ("6.00 6.00 6.00 8/500 1234", 2, 2.0),
        ("7.00 7.00 7.00 9/500 1234", 1, 2.0),
        ("500.0 6.00 6.00 700/900 1234", 2, MAX_SLOWDOWN),
        ("nonsense", 2, 1.0),
    ],
)
def test_programs_that_were_there_and_still_are_slow_a_run_down(
    text: str, processes: int, expected: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "loadavg"
    file.write_text(text)
    monkeypatch.setattr("fraexp.execution.estimates.machine_load.LOAD_FILE", file)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    assert slowdown(processes) == expected


def test_a_system_that_does_not_tell_counts_as_idle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.estimates.machine_load.LOAD_FILE", tmp_path / "missing")
    assert slowdown(2) == 1.0
