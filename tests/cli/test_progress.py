"""What the progress display tells: sweeps that have ended, the speed measured, the time left."""

import pytest

from fraexp.cli import progress
from fraexp.cli.progress import Meter
from fraexp.views.pace import Speed, rate_text


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress, "time", clock)
    return clock


def test_the_speed_is_that_of_the_last_seconds_and_not_of_the_preparation() -> None:
    speed = Speed()
    for now in range(20):
        speed.see(now, 0)
    assert speed.rate is None
    for now in range(20, 40):
        speed.see(now, 2.0 * (now - 19))
    assert speed.rate == pytest.approx(2)
    for now in range(40, 80):
        speed.see(now, 40.0 + 10 * (now - 39))
    assert speed.rate == pytest.approx(10), "what was 40 s ago is forgotten"
    speed.see(80, 0.5)
    assert speed.rate is None, "another study"


def test_a_line_tells_what_is_done_how_fast_and_how_long(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    meter = Meter()
    meter.move(0, 1000)
    clock.now += 10
    for _ in range(195):
        meter.finish()
    meter.move(200, 1000)
    assert capsys.readouterr().err == "195 of 1000 sweeps, 20 %, 10 s, 20/s, about 40 s left\n"


def test_it_is_not_all_done_while_a_sweep_is_estimated(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    meter = Meter()
    meter.finish()
    clock.now += 10
    meter.move(2, 2)
    assert capsys.readouterr().err == "1 of 2 sweeps, 99 %, 10 s, estimating\n"
    clock.now += 10
    meter.finish()
    meter.move(2, 2)
    assert capsys.readouterr().err == "2 of 2 sweeps, 100 %, 20 s\n"


def test_another_study_counts_anew(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    meter = Meter()
    meter.finish()
    clock.now += 10
    meter.begin()
    clock.now += 5
    meter.move(0.5, 2)
    assert capsys.readouterr().err == "0 of 2 sweeps, 25 %, 5 s\n"


@pytest.mark.parametrize(
    ("rate", "text"), [(123.4, "123/s"), (2.5, "2.5/s"), (0.5, "30/min"), (0.02, "1.2/min"), (0.001, "3.6/h")]
)
def test_rates_are_numbers_above_one(rate: float, text: str) -> None:
    assert rate_text(rate) == text
