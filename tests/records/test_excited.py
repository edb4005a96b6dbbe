"""Which lines count as excited, where friction and feedback put power into others as well."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Result
from fraexp.records.repeats import find_excited_lines, find_injected_lines
from tests.examples import some
from tests.records.strangers_files import DRIVE, results

PERIOD, PERIODS = 1000, 5
EXCITED = tuple(range(3, 100))
PERIODIC = ["--samples-per-period", str(PERIOD), "--skip-periods", "1"]
COMMAND = ["import", "drive.csv", *PERIODIC, "--channel", "u=u", "--channel", "y=y"]


@pytest.fixture(scope="module")
def drive() -> np.ndarray:
    """Time, thrust, position and injected multisine [SI] of a drive with Coulomb friction that stands in its loop."""
    angle = 2 * np.pi * np.outer(np.arange(PERIOD), EXCITED) / PERIOD
    wave = np.cos(angle + np.random.default_rng(7).uniform(0, 2 * np.pi, len(EXCITED))).sum(axis=1)
    injected = np.tile(30 * wave / wave.std(), PERIODS)
    volts, counts = DRIVE.follow(np.zeros(injected.size), injected)
    return np.column_stack([np.arange(volts.size) / DRIVE.rate, volts * DRIVE.volt, counts * DRIVE.count, injected])


@pytest.fixture
def folder(tmp_path: Path, drive: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    np.savetxt("drive.csv", drive, "%.9g", ",", header="time [s],u [N],y [m],inj [N]", comments="")
    return tmp_path


def write_moving(drive: np.ndarray) -> None:
    """Write the record with a slow motion as reference, which has not excited it."""
    moving = 0.01 * np.sin(2 * np.pi * np.arange(len(drive)) / PERIOD)
    table = np.column_stack([drive, moving])
    np.savetxt("drive.csv", table, "%.9g", ",", header="time [s],u [N],y [m],inj [N],r [m]", comments="")


def imported(folder: Path, *more: str) -> Result:
    assert main([*COMMAND, *more]) == ExitCode.OK
    (result,) = results(folder, Path(more[-1]).stem if "--study" in more else "drive")
    return result


def tells(result: Result) -> bool:
    """Return whether lines are said to be left out."""
    return any(found.kind == "doubtful lines" and found.quantities[0].value > 0 for found in result.findings)


def lines_of(result: Result) -> list[int]:
    assert result.response is not None
    return np.rint(result.response.frequency * PERIOD / DRIVE.rate).astype(int).tolist()


@pytest.mark.parametrize("name", some(["reference", "excitation"], "excitation"))
def test_lines_are_those_that_were_injected(folder: Path, name: str) -> None:
    found = imported(folder, "--channel", f"{name}=inj")
    assert lines_of(found) == list(EXCITED)
    assert not found.findings


@pytest.mark.thorough
def test_without_the_injected_signal_lines_beyond_its_band_are_left_out_and_told_unless_both_ends_are_stated(
    folder: Path,
) -> None:
    found = imported(folder)
    assert set(EXCITED) <= set(lines_of(found)) <= set(range(1, 100))
    assert tells(found)
    assert tells(imported(folder, "--max-frequency", "99", "--study", "upper.toml"))
    found = imported(folder, "--min-frequency", "3", "--max-frequency", "99", "--study", "both.toml")
    assert (lines_of(found), found.findings) == (list(EXCITED), ())


def test_a_stated_line_that_was_not_injected_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMMAND, "--channel", "reference=inj", "--harmonics", "10,150"]) == ExitCode.USAGE
    assert "'reference' does not excite 150 Hz (harmonic 150)" in capsys.readouterr().err


def test_a_reference_that_does_not_excite_is_refused_unless_the_input_is_looked_at(
    folder: Path, drive: np.ndarray, capsys: pytest.CaptureFixture[str]
) -> None:
    write_moving(drive)
    assert main([*COMMAND, "--channel", "reference=r"]) == ExitCode.USAGE
    assert "of its power at the 1 lines of 'reference': something else excites" in capsys.readouterr().err
    assert tells(imported(folder, "--channel", "reference=r", "--input", "u"))


@pytest.mark.thorough
def test_the_excitation_goes_before_the_reference(folder: Path, drive: np.ndarray) -> None:
    write_moving(drive)
    assert lines_of(imported(folder, "--channel", "reference=r", "--channel", "excitation=inj")) == list(EXCITED)


def test_the_proposed_command_takes_the_injected_signal(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", "drive.csv"]) == ExitCode.OK
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1].split()[-1] == "excitation"
    assert "--channel excitation=inj --time time --samples-per-period 1000" in printed.err


def wave_of(amplitudes: dict[int, float], blocks: int, noise: float) -> np.ndarray:
    rng = np.random.default_rng(11)
    time = np.arange(1000)
    one = sum(a * np.cos(2 * np.pi * k * time / 1000 + rng.uniform(0, 6.28)) for k, a in amplitudes.items())
    return np.asarray(np.tile(one, (blocks, 1)) + noise * rng.normal(size=(blocks, 1000)))


FALLING = {k: k**-2.0 for k in range(1, 101)}
RISING = {k: (k / 100) ** 3.0 for k in range(20, 101)}
TRIANGLE = {k: k**-2.0 for k in range(1, 100, 2)}


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("amplitudes", [FALLING, TRIANGLE, RISING])
def test_an_injected_signal_may_fall_steeply(amplitudes: dict[int, float], noise: float) -> None:
    written = np.round(wave_of(amplitudes, 3, noise), 7)  # as in a file
    assert list(find_injected_lines(written, (1, 499)).lines) == list(amplitudes)


def test_noise_over_two_periods_is_not_taken_for_excitation() -> None:
    blocks = wave_of(dict.fromkeys(range(10, 60), 1.0), 2, noise=0.3)
    for found in (find_injected_lines(blocks, (1, 499)), find_excited_lines(blocks)):
        assert (list(found.lines), found.left_out, found.doubtful) == (list(range(10, 60)), 0, 0)


def test_a_spectrum_that_rises_smoothly_has_no_edge() -> None:
    found = find_excited_lines(wave_of(RISING, 4, noise=1e-5))
    assert (list(found.lines), found.left_out) == (list(RISING), 0)


def test_lines_that_are_far_weaker_without_a_gap_are_doubted() -> None:
    levels = dict.fromkeys(range(1, 61), 1.0) | {k: 0.9 * 0.8 ** (k - 60) for k in range(61, 80)}
    found = find_excited_lines(wave_of(levels, 4, noise=1e-5))
    assert (list(found.lines), found.doubtful) == (list(levels), 4)


def test_lines_of_friction_that_are_most_of_all_are_doubtful() -> None:
    """Few excited lines, and friction's at all others, which fall evenly: no gap parts them."""
    generator = np.random.default_rng(3)
    excited = np.array([1, 2, 3, 5, 8, 13, 21, 36, 60])
    amplitude = 0.3 / np.arange(1, 90) ** 1.1
    amplitude[excited - 1] = generator.permutation(np.geomspace(0.1, 1.0, excited.size))
    angle = 2 * np.pi * np.outer(np.arange(500), np.arange(1, 90)) / 500 + generator.uniform(0, 6, 89)
    blocks = np.tile(np.cos(angle) @ amplitude, (6, 1)) + 1e-5 * generator.normal(size=(6, 500))
    found = find_excited_lines(blocks)
    assert len(found.lines) > 2 * excited.size
    assert found.doubtful > len(found.lines) / 2
