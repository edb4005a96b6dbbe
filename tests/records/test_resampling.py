"""Records whose time stamps are uneven: what the stamps show, and responses of resampled channels within their bands.

The signals are sums of cosines evaluated at the true instants, so that the truth needs no interpolation.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.data.results import FrequencyResponse
from fraexp.errors import RecordError
from fraexp.records.resampling import plan_clock
from fraexp.records.timebase import examine_stamps, sample_rate_of, stamps_text
from tests.examples import thorough
from tests.records.strangers_files import results

RATE_HZ, PERIODS = 1000.0, 6
LINES = np.arange(2, 200, 6)
TRUE_COVERAGE = 0.93
"""Least share of lines within the 95 % band: 0.95 less three standard deviations of 15 records of 33 lines."""


def plant(frequency: np.ndarray) -> np.ndarray:
    """Return the response of a spring and a damped mass behind a dead time [m/N]."""
    ratio = frequency / 60.0
    return 1e-6 / (1 - ratio**2 + 0.1j * ratio) * np.exp(-2j * np.pi * frequency * 1.5e-3)


def signals(time: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a multisine [N] and the plant's answer [um] at the given instants [s]."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, LINES.size)
    turning = np.exp(2j * np.pi * np.outer(time, LINES) + 1j * phases)
    return turning.real.sum(axis=1), 1e6 * (turning * plant(LINES)).real.sum(axis=1)


def uneven_time(seed: int, jitter: float = 0.2, lost: float = 0.01) -> np.ndarray:
    dice = np.random.default_rng(seed)
    time = (np.arange(int(PERIODS * RATE_HZ) + 2) + dice.uniform(-jitter, jitter, int(PERIODS * RATE_HZ) + 2)) / RATE_HZ
    return time[dice.random(time.size) >= lost]


def write(path: Path, time: np.ndarray, seed: int = 1) -> None:
    rows = np.column_stack([time, *signals(time, seed)])
    np.savetxt(path, rows, "%.10g", ",", header="time [s],force [N],position [um]", comments="")


def response(folder: Path, *options: str) -> FrequencyResponse:
    command = ["import", "a.csv", "--channel", "u=force", "--channel", "y=position", "--period-time", "1", *options]
    assert main([*command, "--workspace", str(folder), "--study", str(folder / "studies/a.toml")]) == ExitCode.OK
    (result,) = results(folder, "a")
    assert result.response is not None
    return result.response


def coverage(found: FrequencyResponse) -> np.ndarray:
    from fraexp.analysis.confidence import circle_factor, degrees_of_freedom

    radius = circle_factor(degrees_of_freedom(found)) * found.standard_deviation
    return np.abs(found.response - plant(found.frequency)) <= radius


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_record_of_uneven_stamps_has_its_response_within_the_band(folder: Path) -> None:
    write(folder / "a.csv", uneven_time(1))
    found = response(folder, "--time", "time", "--resample", "cubic", "--max-frequency", "100")
    assert np.abs(found.response / plant(found.frequency) - 1).max() < 3e-3
    assert coverage(found).mean() > 0.8
    (result,) = results(folder, "a")
    assert "samples are lost (0.01) and the stamps jitter by 11.6% of a step" in result.message


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["cubic", "linear"])
def test_bands_cover_the_response_of_resampled_records(tmp_path: Path, registry: Registry, method: str) -> None:
    from fraexp_plugins.estimators.conventional import Conventional

    from fraexp.records import RecordSettings, load, resolve

    inside = []
    for seed in range(15):
        write(tmp_path / "a.csv", uneven_time(seed), seed)
        settings = RecordSettings.parse(
            {"file": "a.csv", "channels": {"u": "force", "y": "position"}, "time_column": "time", "period_time": 1.0,
             "resample": method, "harmonics": LINES.tolist()}, "record",
        )  # fmt: skip
        experiment, files = resolve(settings, tmp_path, registry)
        found = Conventional(input="u", output="y").estimate(load(experiment, files, registry)).response
        assert found is not None
        inside.append(coverage(found))
    assert np.mean(inside) > TRUE_COVERAGE


STAMPS = {
    "jitter": (uneven_time(1, lost=0), 1000, r"jitter by 11\.\d% of a step"),
    "lost samples": (uneven_time(2, jitter=0, lost=0.01), 1000, r"\d\d of 6002 samples are lost \(0\.01\d?\)"),
    "drift": (np.arange(5000) * 1e-3 * (1 + 2e-6 * np.arange(5000)), 990.1, r"the rate drifts, by \d+ samples"),
    "rounding": (np.round(np.arange(5000) / 2300, 4), 2300, r"rounded to 0\.0001 s"),
}


@pytest.mark.parametrize(("time", "rate", "says"), STAMPS.values(), ids=STAMPS)
def test_stamps_are_classified(time: np.ndarray, rate: float, says: str) -> None:
    found = examine_stamps(time)
    assert 1 / found.period == pytest.approx(rate, rel=1e-5)
    assert re.search(says, stamps_text(found))


def test_rounded_stamps_are_a_uniform_clock() -> None:
    assert sample_rate_of(np.round(np.arange(5000) / 2300, 4), "it") == pytest.approx(2300, rel=1e-6)


@pytest.mark.parametrize(("at", "option"), [(1500, "--start-time"), thorough(4500, "--end-time")])
def test_a_gap_says_which_part_to_use_and_the_part_is_used(
    folder: Path, capsys: pytest.CaptureFixture[str], at: int, option: str
) -> None:
    time = np.arange(int(PERIODS * RATE_HZ)) / RATE_HZ
    write(folder / "a.csv", np.delete(time, slice(at, at + 120)))
    command = ["import", "a.csv", "--channel", "u=force", "--channel", "y=position", "--period-time", "1"]
    assert main([*command, "--time", "time", "--resample", "cubic"]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "has a gap of 0.121 s" in said
    remedy = said[said.index(f"({option}") + 1 : said.index(")", said.index(f"({option}"))].split()
    found = response(folder, "--time", "time", *remedy)
    assert np.abs(found.response / plant(found.frequency) - 1).max() < 1e-6


@pytest.mark.thorough
def test_channels_of_two_rates_are_brought_to_one_clock(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The force is sampled five times as fast, begins earlier, and contains a sine that would alias."""
    fast, slow = np.arange(-200, 32000) / 5000, np.arange(6100) / 1000 + 0.0137
    force = signals(fast, 1)[0] + 3 * np.sin(2 * np.pi * 1100.0 * fast)
    rows = np.full((fast.size, 4), np.nan)
    rows[:, 0], rows[:, 1] = fast, force
    rows[: slow.size, 2], rows[: slow.size, 3] = slow, signals(slow, 1)[1]
    text = "\n".join(",".join("" if np.isnan(x) else f"{x:.10g}" for x in row) for row in rows)
    (folder / "a.csv").write_text(f"t1 [s],force [N],t2 [s],position [um]\n{text}\n", encoding="utf-8")
    command = ["import", "a.csv", "--channel", "u=force", "--channel", "y=position", "--period-time", "1"]
    assert main(command) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "different sample times ('force' 0.2 ms, 'position' 1 ms)" in said
    assert "--resample cubic" in said
    found = response(folder, "--resample", "cubic")
    assert found.frequency.tolist() == LINES.tolist()
    assert np.abs(found.response / plant(found.frequency) - 1).max() < 1e-3


def test_a_rate_above_that_of_a_channel_is_refused() -> None:
    with pytest.raises(RecordError, match=r"sample_rate is 2000 Hz, but 'y' was sampled at 1000 Hz"):
        plan_clock({"y": np.arange(100) / 1000}, 2000.0, None, "cubic", "a.csv")
