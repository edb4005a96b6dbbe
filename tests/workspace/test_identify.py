"""Records of one machine at two amplitudes, simulated here by itself, and what is identified from them."""

import csv
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import fraexp
from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.records.first_look import JOINT, PLANT, choose, look_at, with_channels
from fraexp.records.study_writer import ImportRequest
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused

SAMPLE_TIME, DELAY, STEPS = 5e-4, 1, 12
MASSES, SPRING, DAMPER = (3.0, 2.0), 2.4e5, 20.0
FORCES = [15.0 / 8] * 8
STIFFNESSES = [force / (6e-6 * 1.7**number) for number, force in enumerate(FORCES)]
FREQUENCIES = np.geomspace(4, 120, 20)
VISCOUS, PERIODS = 20.0, 8


def write_record(
    path: Path, amplitude: float, frequencies: np.ndarray = FREQUENCIES, lines: Sequence[int] = ()
) -> None:
    """Write stepped sines, or a multisine, of two masses with friction at the motor, by semi-implicit Euler steps."""
    random, step = np.random.default_rng(5), SAMPLE_TIME / STEPS
    x, v, load, speed = 0.0, 0.0, 0.0, 0.0
    deflections, waiting, last, rate, rows = [0.0] * len(FORCES), [0.0] * DELAY, 0.0, 0.0, []
    turns = [2 * np.pi * np.arange(period) / period for period in np.rint(1 / (frequencies * SAMPLE_TIME)).astype(int)]
    waves = [sum(np.sin(line * turn + line**2) for line in lines) if lines else np.sin(turn) for turn in turns]
    for wave in waves:
        for number in range(PERIODS * wave.size):
            y = round((x + 2e-8 * random.standard_normal()) / 1e-7) * 1e-7
            rate += 0.3 * ((y - last) / SAMPLE_TIME - rate)
            last = y
            u = amplitude * wave[number % wave.size] - 2e4 * y - 150 * rate
            rows.append((len(rows) * SAMPLE_TIME, u, 1e6 * y, *[1 / (wave.size * SAMPLE_TIME)] * (not lines)))
            waiting.append(u)
            force = waiting.pop(0)
            for _ in range(STEPS):
                friction = VISCOUS * v
                for place, (stiffness, limit) in enumerate(zip(STIFFNESSES, FORCES, strict=True)):
                    z = min(max(deflections[place] + v * step, -limit / stiffness), limit / stiffness)
                    deflections[place] = z
                    friction += stiffness * z
                shaft = SPRING * (x - load) + DAMPER * (v - speed)
                v += step * (force - friction - shaft) / MASSES[0]
                speed += step * shaft / MASSES[1]
                x, load = x + step * v, load + step * speed
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(
            [("time [s]", "force [N]", "position [um]", "frequency [Hz]")[: len(rows[0])], *rows]
        )


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with records at 12 N and 40 N of few frequencies."""
    folder = tmp_path_factory.mktemp("records")
    for name, amplitude in (("low", 12.0), ("high", 40.0), ("again", 41.0)):
        write_record(folder / f"{name}.csv", amplitude, FREQUENCIES[10::5])
        write_record(folder / f"{name}-all.csv", amplitude, np.array([2.0]), (2, 5, 11, 23, 40))
    return folder


@pytest.mark.parametrize(
    ("names", "levels", "estimator"),
    [("low high", 2, JOINT), ("high again", 1, PLANT), ("low", 1, PLANT), ("low-all high-all", 2, JOINT)],
)
def test_amplitudes_choose_the_estimator(records: Path, names: str, levels: int, estimator: str) -> None:
    registry = WorkspaceService.open(records).registry
    for channels, unit in (({}, "N"), ({"u": "force * 0.1 [N m]", "y": "position * 1e-6 [rad]"}, "N m")):
        request = ImportRequest([records / f"{name}.csv" for name in names.split()], channels)
        look = look_at(with_channels(request, registry), registry)
        assert (look.levels, choose(look).estimator["name"], look.unit) == (levels, estimator, unit)
        assert look.resolution == pytest.approx(1e-7)


def test_levels_in_one_file_are_found_and_what_settles_is_left_out(records: Path, tmp_path: Path) -> None:
    rows = [np.loadtxt(records / f"{name}-all.csv", delimiter=",", skiprows=1)[:, 1:] for name in ("low", "high")]
    np.savetxt(tmp_path / "a.csv", np.concatenate(rows), "%.9g", ",", header="force [N],position [um]", comments="")
    registry = WorkspaceService.open(records).registry
    request = with_channels(ImportRequest([tmp_path / "a.csv"], {}, {"sample_rate": 1 / SAMPLE_TIME}), registry)
    look = look_at(request, registry)
    assert (look.levels, look.skipped, round(look.amplitudes[1] / look.amplitudes[0])) == (2, 1, 4)


def test_a_listing_that_leaves_something_open_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    np.savetxt(file, np.random.default_rng(1).normal(size=(500, 3)), delimiter=",", header="a,b,c", comments="")
    with refused(fraexp.FraexpError, "COLUMN", "HZ"):
        fraexp.Workspace(tmp_path).identify(file)


@pytest.mark.parametrize(
    ("names", "channels", "words"),
    [
        (["low", "low"], {}, ["twice"]),
        (["low"], {"u": "force"}, ["y=COLUMN"]),
        (["low"], {"excitation": "force"}, ["u=COLUMN"]),
        (["low"], {"u": "position", "y": "force"}, ["m", "N"]),
    ],
)
def test_records_that_are_none_of_one_axis_are_refused(
    records: Path, tmp_path: Path, names: list[str], channels: dict[str, str], words: list[str]
) -> None:
    with refused(fraexp.FraexpError, *words):
        fraexp.Workspace(tmp_path).identify([records / f"{name}.csv" for name in names], channels, progress=False)
    assert not (tmp_path / "studies").exists()


def test_one_amplitude_does_not_tell_friction(records: Path, tmp_path: Path) -> None:
    found = fraexp.Workspace(tmp_path).identify(records / "high.csv", progress=False)
    assert "twice the amplitude" in dict(found.answers)["friction"]
    again = fraexp.Workspace(tmp_path).identify(records / "high.csv", progress=False, skip_periods=2)
    assert (found.run.study, again.run.study) == ("high", "high-2")
    assert [of.labels["case"] for of in found.run] == ["response"] + ["modal_fit"] * (len(found.run) - 1)


def test_files_of_opposite_signs_are_named_and_identify_fails(
    records: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = np.loadtxt(records / "high-all.csv", delimiter=",", skiprows=1) * [1, 1, -1]
    np.savetxt(tmp_path / "turned.csv", values, "%.9g", ",", header="time [s],force [N],position [um]", comments="")
    for other in ("low-all", "high-all"):
        files = f"{records}/{other}.csv", f"{tmp_path}/turned.csv"
        assert main(["identify", *files, "--json", f"--workspace={tmp_path}"]) == ExitCode.INCOMPLETE
        plant = dict(json.loads(capsys.readouterr().out)["answers"])["plant"]
        assert re.search(rf"{other}.csv and turned.csv contradict each other, at .* Hz by .* dB and -?1[5-8]\d°", plant)


@pytest.mark.thorough
def test_two_files_at_two_amplitudes_tell_plant_friction_and_gains(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, amplitude in (("low", 12.0), ("high", 40.0)):
        write_record(tmp_path / f"{name}.csv", amplitude)
    files = [tmp_path / "low.csv", tmp_path / "high.csv"]
    assert main(["identify", *map(str, files), "--skip-periods=4", "--tune", "--json", f"--workspace={tmp_path}"]) == 0
    answers = dict(json.loads(capsys.readouterr().out)["answers"])
    assert answers["friction law"] == "rolling"
    assert answers["gains"].startswith("proportional")
    assert float(answers["plant"].split()[1]) == pytest.approx(sum(MASSES), rel=5e-3)
    found = fraexp.Workspace(tmp_path).identify(files, skip_periods=4, progress=False)
    plant, friction = found.models["plant"], found.models["friction"]
    assert plant["rigid_body_gain"] == pytest.approx(1 / sum(MASSES), rel=5e-3)
    resonance = math.sqrt(SPRING * (1 / MASSES[0] + 1 / MASSES[1])) / (2 * math.pi)
    assert plant["frequencies"][0] == pytest.approx(resonance, rel=3e-3)
    assert sum(friction["limit_force"]) == pytest.approx(sum(FORCES), rel=0.03)
    assert found.run[-1].metrics["input_dead_time"] == pytest.approx(DELAY * SAMPLE_TIME, abs=0.2 * SAMPLE_TIME)
