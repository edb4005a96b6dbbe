"""Excitations as files: what each format plays is the table, sample by sample."""

import re
import shutil
import subprocess
import wave
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat

from fraexp import records
from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Outcome
from fraexp.errors import StudyError
from fraexp.measurement.excitation_files import ExcitationTable, excitation_table, write_excitation
from fraexp.records.record_settings import RecordSettings
from fraexp.records.study_writer import write_study
from fraexp.simulation.experiment_run import LiveLoop, live_setup
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService
from tests.components.translation.grammar import grammar_error
from tests.measurement.conftest import STUDY
from tests.refusals import refused

C_MAIN = """
#include "excitation.h"
#include <stdio.h>
int main(void) {
    fraexp_player player = {0, 0};
    long k;
    for (k = 0; k < SAMPLES; k++) printf("%.17g\\n", fraexp_next(&player));
    return 0;
}
"""


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> ExcitationTable:
    folder = tmp_path_factory.mktemp("axis")
    (folder / "studies").mkdir()
    (folder / "studies" / "axis.toml").write_text(STUDY, encoding="utf-8")
    return excitation_table(MeasurementService(WorkspaceService.open(folder), "axis").plans()[0])


def test_every_point_begins_and_ends_at_rest(table: ExcitationTable) -> None:
    force = table.columns()["excitation"]
    assert force.size == table.samples
    for entry in table.entries:
        after = entry.first + entry.request.samples
        assert force[entry.first] == 0.0
        assert not force[after - 1 : after + table.pause].any()
        peak = np.abs(force[entry.first : after]).max()
        assert peak == pytest.approx(40, rel=1e-2)
        wave_steps = np.abs(np.diff(entry.request.waveform)).max()
        assert np.abs(np.diff(force[entry.first : after])).max() <= 1.1 * wave_steps


def test_where_no_excitation_can_be_written_no_study_is_left(
    workspace: WorkspaceService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(workspace.folder)
    assert main(["excite", "axis", "-o", "nowhere/z.csv"]) == ExitCode.USAGE
    assert [file.name for file in (workspace.folder / "studies").iterdir()] == ["axis.toml"]
    assert main(["excite", "axis", "-o", "z.csv"]) == ExitCode.OK
    assert (workspace.folder / "studies" / "z-record.toml").exists()


def test_tables_for_programs_hold_the_same_samples(table: ExcitationTable, tmp_path: Path) -> None:
    force = table.columns()["excitation"]
    for name in ("e.csv", "e.mat", "e.h5", "e.wav"):
        write_excitation(tmp_path / name, table)
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "e.csv", delimiter=",", skiprows=1)[:, 1], force)
    np.testing.assert_array_equal(loadmat(tmp_path / "e.mat")["excitation"].ravel(), force)
    with h5py.File(tmp_path / "e.h5") as file:
        np.testing.assert_array_equal(file["excitation"][:], force)
        assert file["excitation"].attrs["unit"] == "N"
    with wave.open(str(tmp_path / "e.wav")) as sound:
        assert sound.getframerate() == 2000
        numbers = np.frombuffer(sound.readframes(sound.getnframes()), "<i2")
    np.testing.assert_allclose(numbers / 32767 * np.abs(force).max(), force, atol=0.51 * 40 / 32767)


def test_another_suffix_is_refused(table: ExcitationTable, tmp_path: Path) -> None:
    with refused(StudyError, "e.xls", "'.xls'", ".csv"):
        write_excitation(tmp_path / "e.xls", table)
    assert not list(tmp_path.glob("*.xls*"))


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler")
def test_the_compiled_player_plays_the_table(table: ExcitationTable, tmp_path: Path) -> None:
    write_excitation(tmp_path / "excitation.h", table)
    (tmp_path / "main.c").write_text(C_MAIN.replace("SAMPLES", str(table.samples + 10)))
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "main.c", "-o", "player"]
    subprocess.run(command, cwd=tmp_path, check=True)
    played = subprocess.run([tmp_path / "player"], capture_output=True, check=True, text=True).stdout.split()
    expected = np.append(table.columns()["excitation"], np.zeros(10))
    np.testing.assert_allclose(np.array(played, dtype=float), expected, rtol=1e-14, atol=1e-13)


class StructuredText:
    """A function block, translated to Python line by line."""

    RULES = (
        (r"\bELSIF (.*) THEN", r"elif \1:"), (r"\bIF (.*) THEN", r"if \1:"), (r"\bELSE\b", "else:"),
        (r":=", "\0"), (r"(?<![<>\0])=", "=="), ("\0", "="), (r"\bMOD\b", "%"), (r"\bNOT\b", "not"),
        (r"\bAND\b", "and"), (r"\bOR\b", "or"), (r"\bTRUE\b", "True"), (r"\bFALSE\b", "False"),
        (r"DINT_TO_LREAL", "float"), (r";$", ""),
    )  # fmt: skip

    def __init__(self, text: str) -> None:
        head, body = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL).rsplit("END_VAR", 1)
        self.values: dict[str, Any] = {}
        for name, kind, value in re.findall(r"(\w+) : (ARRAY[^;]*?OF \w+|\w+)(?: := ([^;]+))?;", head):
            start = "[0]" if kind.startswith("ARRAY") else "False" if kind == "BOOL" else "0"
            self.values[name] = eval((value or start).replace("TRUE", "True"))
        lines = [line for line in body.splitlines() if line.strip() and not re.match(r"\s*END_", line)]
        self.code = compile("\n".join(map(self._translate, lines)), "block", "exec")

    def _translate(self, line: str) -> str:
        for pattern, replacement in self.RULES:
            line = re.sub(pattern, replacement, line)
        return line

    def call(self, enable: bool) -> float:
        self.values["Enable"] = enable
        exec(self.code, {}, self.values)
        return float(self.values["Force"])


@pytest.mark.thorough
def test_the_function_block_plays_the_table(table: ExcitationTable, tmp_path: Path) -> None:
    write_excitation(tmp_path / "e.st", table)
    source = (tmp_path / "e.st").read_text()
    assert grammar_error(source) is None
    block = StructuredText(source)
    assert [block.call(False) for _ in range(5)] == [0.0] * 5
    played = [block.call(True) for _ in range(table.samples)]
    np.testing.assert_allclose(played, table.columns()["excitation"], rtol=1e-14, atol=1e-13)
    assert block.call(True) == 0.0
    assert block.values["Done"]


def test_the_function_block_stops_softly_and_begins_anew(table: ExcitationTable, tmp_path: Path) -> None:
    write_excitation(tmp_path / "e.st", table)
    block, request = StructuredText((tmp_path / "e.st").read_text()), table.entries[0].request
    stop = 333
    played = [block.call(True) for _ in range(stop)] + [block.call(False) for _ in range(2 * request.ramp_out)]
    expected = request.excitation(0, stop + 2 * request.ramp_out, stop)
    np.testing.assert_allclose(played, expected, rtol=1e-14, atol=1e-13)
    again = [block.call(True) for _ in range(stop)]
    np.testing.assert_allclose(again, expected[:stop], rtol=1e-14, atol=1e-13)


def record(workspace: WorkspaceService, force: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return what the study's machine records from rest."""
    experiment = workspace.studies(["axis"])[0].sweeps[0].experiment
    names = ("plant", "friction", "controller", "loop", "numerics")
    setup = live_setup({name: experiment[name] for name in names}, workspace.folder)
    return LiveLoop(setup).play(force)


@pytest.mark.thorough
def test_a_played_excitation_comes_back_by_the_name_of_its_record(
    workspace: WorkspaceService, table: ExcitationTable
) -> None:
    service, file = MeasurementService(workspace, "axis"), workspace.folder / "axis-record.csv"
    study, content = service.record_study(file, table, force=False)
    write_study(study, content)
    played = record(workspace, table.columns()["excitation"])
    np.savetxt(file, np.array([played["u"], played["y"]]).T, delimiter=",", header="u,y", comments="", fmt="%.17g")

    assert workspace.study_of_record(file, file) == study
    assert workspace.study_of_record(file.with_name("other.csv"), file) is None
    list(workspace.run(["axis-record"], executor="serial"))
    list(workspace.run(["axis"], executor="serial"))

    with workspace.open_store() as store:
        simulated, recorded = (
            {sweep.estimator["name"]: store.results([sweep.key])[sweep.key] for sweep in store.sweeps(run.number)}
            for run in store.runs()[:2]
        )
    for name, result in simulated.items():
        found, expected = recorded[name].response, result.response
        assert found is not None and expected is not None
        np.testing.assert_allclose(found.response, expected.response, rtol=3e-3)


WRONG_RECORDS = {
    "swapped": (lambda u, y: (y, u), "exchange them in record.channels"),
    "mm": (lambda u, y: (u, 1e3 * y), r"channels\.y = \"y \[mm\]\"$"),
    "counts": (lambda u, y: (u, y / 2e-8), r"channels\.y = \"y \* \S+ \[m\]\"$"),
    "percent": (lambda u, y: (u / 1.5, y), r"channels\.u = \"u \* 1\.\d+ \[N\]"),
    "kN": (lambda u, y: (u / 1e3, y), r"channels\.u = \"u \[kN\]"),
    "right": (lambda u, y: (u, y), ""),
    "y with a sign": (lambda u, y: (u, -y), ""),
}
"""Columns of a record that came back, by what has happened to them, and the remedy."""


def test_columns_of_a_played_excitation_are_compared_with_what_was_predicted(
    workspace: WorkspaceService, table: ExcitationTable
) -> None:
    file = workspace.folder / "axis-record.csv"
    _, content = MeasurementService(workspace, "axis").record_study(file, table, force=False)
    del content["record"]["controller"]  # of which nothing else is known
    settings = RecordSettings.parse(content["record"], "record")
    played = record(workspace, table.columns()["excitation"])
    for name, (change, remedy) in WRONG_RECORDS.items():
        columns = np.array(change(played["u"], played["y"])).T
        np.savetxt(file, columns, delimiter=",", header="u,y", comments="", fmt="%.17g")
        signals = records.load(
            *records.resolve(settings, file.parent / "studies", workspace.registry), workspace.registry
        )
        wrong = [found for found in signals.findings if found.kind == "wrong column"]
        assert bool(wrong) is bool(remedy), name
        assert all(re.search(remedy, found.remedy) for found in wrong), (name, signals.message)
        assert signals.outcome is Outcome.INACCURATE, name  # the right one is not verified
