"""Records that do not repeat themselves: for estimators that need no periods, and an error for those that do."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Outcome
from tests.examples import some
from tests.records.strangers_files import results

COMMAND = ["import", "noise.csv", "--channel", "u=force [N]", "--channel", "y=position [mm]", "--sample-rate", "500"]


@pytest.fixture
def noise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mass of 2 kg on a spring and damper, driven by noise."""
    monkeypatch.chdir(tmp_path)
    force = np.random.default_rng(2).standard_normal(5000)
    position, velocity, rows = 0.0, 0.0, []
    for each in force:
        rows.append(f"{each:.9g},{1e3 * position:.9g}")
        velocity += 2e-3 * (each - 2e3 * position - 40 * velocity) / 2
        position += 2e-3 * velocity
    (tmp_path / "noise.csv").write_text("\n".join(["force,position", *rows]), encoding="utf-8")
    return tmp_path


def test_an_estimator_of_whole_periods_refuses(noise: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMMAND, "--aperiodic", "--estimator", "conventional"]) == ExitCode.INCOMPLETE
    assert "does not repeat itself" in (said := capsys.readouterr().err)
    assert "take h1_h2_hv or local_polynomial" in said


@pytest.mark.parametrize("estimator", some(["h1_h2_hv", "local_polynomial"], "h1_h2_hv"))
def test_another_one_has_nothing_to_say_of_it(noise: Path, estimator: str) -> None:
    assert (
        main([*COMMAND, "--aperiodic", "--estimator", estimator, "--min-frequency", "1", "--max-frequency", "20"]) == 0
    )
    (result,) = results(noise, "noise")
    is_windowed = estimator == "h1_h2_hv"  # by one window, which shows neither noise nor leakage
    assert result.outcome is (Outcome.INACCURATE if is_windowed else Outcome.OK)
    assert ("give a shorter 'window'" in result.message) is is_windowed
    assert "periodic" not in result.message
