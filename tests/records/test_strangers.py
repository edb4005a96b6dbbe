"""Records from machines that nobody here has seen, imported by command line alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.examples import some
from tests.records.strangers import point_to_point, write_classic
from tests.records.strangers_files import (
    DRIVE,
    PERIODS,
    REALISATIONS,
    STRUCTURE,
    check_levels,
    results,
    write_drive,
    write_level,
)

Arrays = tuple[np.ndarray, np.ndarray]
LEVELS = ["--level", "1", "--level", "2", "--level", "3"]
PERIODIC = ["--sample-rate", "512", "--samples-per-period", "1024", "--set", "estimator.excitation_channel=u"]
FOUR = [text for number in "1234" for text in ("--realisation", number)]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def vibration() -> Arrays:
    """Force and acceleration, each of shape (samples, periods, realisations, levels)."""
    return STRUCTURE.all_records(REALISATIONS, PERIODS)


def channels(u: str, y: str) -> list[str]:
    return ["--channel", f"u={u}", "--channel", f"y={y}"]


@pytest.mark.thorough
def test_what_the_model_does_not_know_is_told(folder: Path) -> None:
    write_drive(folder / "drive.mat", point_to_point(DRIVE.rate))
    command = ["import", "drive.mat", *channels("servo_volt * -31.5 [N]", "enc_cnt * 0.5 [um]")]
    more = ["--aperiodic", "--estimator", "friction_identification", "--set", 'estimator.laws=["coulomb"]']
    assert main([*command, "--sample-rate", "1000", *more]) == ExitCode.INCOMPLETE  # the thrust has the wrong sign


def arrays(folder: Path, vibration: Arrays) -> list[str]:
    force, acceleration = vibration
    write_classic(folder / "v.mat", {"force": force, "acc": acceleration / 9.80665})
    names = ("force(:,:,{realisation},{level}) [N]", "acc(:,:,{realisation},{level}) [g_0]")
    return ["v.mat", *channels(*names), *LEVELS, *FOUR, *PERIODIC]


def vectors(folder: Path, vibration: Arrays) -> list[str]:
    """One vector for each level, in which realisations follow one another."""
    named = zip("FA", vibration, strict=True)
    content = {f"{name}{k + 1}": values[..., k].ravel(order="F") for name, values in named for k in range(3)}
    write_classic(folder / "v.mat", content)
    return ["v.mat", *channels("F{level} [N]", "A{level} [m/s^2]"), *LEVELS, "--periods", "3", *PERIODIC]


def struct(folder: Path, vibration: Arrays) -> list[str]:
    force, acceleration = vibration
    levels = {name: {"u": force[..., k], "y": acceleration[..., k]} for k, name in enumerate(("low", "mid", "high"))}
    write_classic(folder / "v.mat", {"test": levels})
    named = [text for name in levels for text in ("--level", name)]
    columns = ("test.{level}.u(:,:,{realisation}) [N]", "test.{level}.y(:,:,{realisation}) [m/s^2]")
    return ["v.mat", *channels(*columns), *named, *FOUR, *PERIODIC]


def files(folder: Path, vibration: Arrays) -> list[str]:
    for level in range(3):
        write_level(folder / f"v{level + 1}.csv", vibration[0][..., level], vibration[1][..., level])
    names = [f"v{level + 1}.csv" for level in range(3)]
    return [*names, "--separate-files", *channels("Force", "Acceleration"), "--time=t", "--segment=run", *PERIODIC]


def one_table(folder: Path, vibration: Arrays) -> list[str]:
    """One file whose column tells the level, and another one the realisation."""
    columns = [values.ravel(order="F") for values in vibration]
    size = columns[0].size
    level = np.repeat(STRUCTURE.levels, size // 3)
    run = np.tile(np.repeat(np.arange(1, 5), size // 12), 3)
    rows = np.column_stack([*columns, level, run])
    np.savetxt(folder / "v.csv", rows, "%.9g", ",", header="F [N],A [m/s^2],level,run", comments="")
    named = [text for value in STRUCTURE.levels for text in ("--level", f"{value:g}")]
    return ["v.csv", *channels("F", "A"), "--select", "level={level}", "--segment", "run", *named, *PERIODIC]


LAYOUTS = (arrays, vectors, struct, files, one_table)


@pytest.mark.parametrize("layout", some(LAYOUTS, struct))
def test_every_layout_of_levels_gives_responses_and_distortions(
    folder: Path, vibration: Arrays, layout: Callable[[Path, Arrays], list[str]]
) -> None:
    assert main(["import", *layout(folder, vibration), "--study", "studies/v.toml"]) == ExitCode.OK
    found = results(folder, "v")
    assert len(found) == 3
    check_levels(found, displacement=False)


@pytest.mark.thorough
def test_realisations_in_files_of_their_own_are_one_experiment(folder: Path, vibration: Arrays) -> None:
    for number in range(REALISATIONS):
        write_level(folder / f"run{number}.csv", *(values[:, :, number : number + 1, 0] for values in vibration))
    names = [f"run{number}.csv" for number in range(REALISATIONS)]
    command = ["import", *names, *channels("Force", "Acceleration"), "--time", "t", *PERIODIC]
    assert main([*command, "--study", "studies/v.toml"]) == ExitCode.OK
    (joined,) = results(folder, "v")
    assert joined.response is not None
    assert joined.response.nonlinear_variance is not None
    assert np.all(joined.response.freedom == 2 * (REALISATIONS - 1))


def test_what_is_in_a_file_is_listed_with_a_command_that_is_nearly_right(
    folder: Path, vibration: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    write_drive(folder / "drive.mat", point_to_point(DRIVE.rate))
    vectors(folder, vibration)
    write_level(folder / "table.csv", *(values[:, :, :1, 0] for values in vibration))
    expected = {
        "drive.mat": ["u=servo_volt [UNIT]", "y=enc_cnt [UNIT]", "reference=soll_mm [mm]", "--sample-rate 1000"],
        "v.mat": ["u=F{level} [UNIT]", "y=A{level} [UNIT]", "--level 1 --level 2 --level 3"],
        "table.csv": ["u=Force ", "y=Acceleration ", "--time t ", "--samples-per-period 1024"],
    }
    for name, parts in expected.items():
        assert main(["import", name]) == ExitCode.OK
        command = capsys.readouterr().err.splitlines()[-1]
        assert [part for part in parts if part not in command] == []
    assert list(folder.glob("studies")) == []


REFUSED = {
    "realisations as one record": (["--select", "level=5"], "another signal from period 4 on"),
    "no such level": (["--select", "level=7", "--segment", "run"], "'level' is nowhere 7; it is 5, 20, 60"),
    "no condition": (["--select", "level"], "select is 'level'; expected a column and a number"),
    "level without a place": (["--level", "1"], "level is given, but {level} stands in no name"),
    "place without a level": (["--select", "level={level}"], "{level} stands in a name; give level (--level)"),
    "gram": (["--channel", "z=A [g]"], "'g' is the gram; write g_0"),
    "two gains": (["--channel", "z=A * 2 * 3 [N]"], "is ambiguous"),
    "three columns": (["--channel", "z=A - F - run [N]"], "more than two columns"),
    "different units": (["--channel", "z=A - F"], "its columns are in m/s^2 and N; expected one unit"),
    "setting of something else": (["--set", "loop.sample_time=2"], "expected estimator.PARAMETER=VALUE"),
    "integral of what is not there": (["--integrate", "q=2"], "--integrate q=2: expected a channel and 1, 2, -1 or -2"),
    "two cuts": (["--aperiodic", "--estimator", "h1_h2_hv"], "periodic = false and samples_per_period are both"),
    "not periodic, no estimator": (["--aperiodic"], "does not repeat itself needs --estimator"),
    "no harmonics": (["--harmonics", "1,x"], "'1,x' is invalid; expected harmonics"),
    "wrong number of periods": (["--segment=run", "--select", "level=5", "--periods=2"], "1.50 realisations of 2"),
}


@pytest.mark.parametrize(("extra", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_right_is_refused_in_one_line(
    folder: Path, vibration: Arrays, extra: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    one_table(folder, vibration)
    command = ["import", "v.csv", *channels("F", "A"), "--sample-rate", "512", "--samples-per-period", "1024"]
    assert main([*command, *extra]) == ExitCode.USAGE
    printed = capsys.readouterr().err
    assert sentence in printed
    assert printed.count("\n") == 1
    assert [path.name for path in folder.iterdir()] == ["v.csv"]


def test_an_integral_over_a_record_that_does_not_repeat_itself_is_refused(
    folder: Path, vibration: Arrays, capsys: pytest.CaptureFixture[str]
) -> None:
    one_table(folder, vibration)
    command = ["import", "v.csv", *channels("F", "A"), "--sample-rate", "512", "--aperiodic"]
    assert main([*command, "--estimator", "h1_h2_hv", "--integrate", "y=2"]) == ExitCode.USAGE
    assert "cannot be integrated" in capsys.readouterr().err
