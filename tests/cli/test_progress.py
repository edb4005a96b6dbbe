"""What the progress display tells: sweeps that have ended, the speed measured, the time left."""

from datetime import UTC, datetime

import pytest

from fraexp.cli import measure, progress
from fraexp.cli.measure import MeasurementMeter
from fraexp.cli.progress import Meter
from fraexp.execution.events import TimeLeft
from fraexp.store import RunProgress, RunSummary
from fraexp.store.liveness import Process
from fraexp.views.run_progress import progress_text, time_text


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (progress, measure):
        monkeypatch.setattr(module, "time", clock)
    return clock


def test_a_line_tells_what_has_ended_and_how_long_it_lasts(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    meter = Meter()
    meter.move(0, 1000, 0)
    clock.now += 10
    for _ in range(195):
        meter.finish()
    meter.move(200, 1000, 8, left=TimeLeft(41.2, 15, 0))
    told = "195 of 1000 sweeps, 8 in progress, 10 s, about 41 s left, from 15 like sweeps\n"
    assert capsys.readouterr().err == told


def test_what_is_under_way_is_told_and_no_share_that_contradicts_the_count(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    meter = Meter()
    meter.move(0, 4, 0)
    clock.now += 10
    meter.move(2, 4, 4)
    assert capsys.readouterr().err == "0 of 4 sweeps, 4 in progress at 50 %, 10 s\n"
    clock.now += 10
    meter.move(2, 4)
    assert capsys.readouterr().err.startswith("0 of 4 sweeps, others in progress, 20 s")
    clock.now += 10
    meter.move(0.5, 1)
    assert capsys.readouterr().err.startswith("0 of 1 sweep, 1 in progress at 50 %, 30 s")


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (TimeLeft(None, 0, 300), "time left unknown"),
        (TimeLeft(4.0, 2, 0), "about 4 s left, from 2 like sweeps"),
        (TimeLeft(75.0, 1, 100), "at least 1 min 15 s left, from 1 like sweep"),
    ],
)
def test_the_time_left_says_what_it_follows_from(time: TimeLeft, text: str) -> None:
    assert time_text(time, "left") == text


def test_a_run_that_is_watched_tells_what_is_under_way() -> None:
    now = datetime(2026, 1, 1, tzinfo=UTC)
    told = RunProgress(2.0, 4, 4, dict.fromkeys("abcd", 0.5))
    process = Process("here", 1, "", "")
    run = RunSummary(1, "s", "s.toml", "run s", now, None, "running", {}, 4, 0, 0, 0, process, now, told)
    assert progress_text(run, 4) == "██░░  50 %  0 of 4 sweeps, time left unknown, 4 in progress, 4 workers"


@pytest.mark.parametrize("room", [80, 118, 158])
def test_the_bar_leaves_room_for_the_time_left(room: int) -> None:
    now = datetime(2026, 1, 1, tzinfo=UTC)
    told = RunProgress(12.0, 96, 2, dict.fromkeys("ab", 0.0), "compiling friction law 'rolling'", 420.0, 12)
    process = Process("here", 1, "", "")
    run = RunSummary(1, "s", "s.toml", "run s", now, None, "running", {}, 96, 12, 0, 0, process, now, told)
    line = progress_text(run, 40, room)
    assert "12 of 96 sweeps, about 7 min 00 s left" in line and len(line) <= room
    assert line.endswith("2 workers") == (room > 118)


def test_a_plan_that_takes_long_tells_the_time_left(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    meter = MeasurementMeter()
    for share, after in ((0.0, 0.0), (0.1, 0.5), (0.25, 5.5), (0.5, 1.0), (1.0, 13.0)):
        clock.now += after
        meter.show_planning(share)
    assert capsys.readouterr().err == "planning near the limits: 25 %, about 18 s left\n"
