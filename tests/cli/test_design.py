"""``fraexp design``: from a short run to a study with the sines that tell most."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.findings import remarks
from fraexp.data.results import Fit, Outcome, Result
from fraexp.errors import FraexpError, StudyError
from fraexp.store import StoredSweep
from fraexp.workspace.fit_specs import write_designed_study
from tests.refusals import refused

STUDY = """
title = "As"
machine = "linear_motor_table"

[loop]
noise = "0.3 um"

[excitation]
name = "stepped_sine"
amplitude = 12.0
min_frequency = 2.0
max_frequency = 120.0
points = 12

[estimator]
name = "maximum_likelihood"
"""
SETTINGS = ["--set", "measuring_time=30", "--set", "amplitudes=[8,12]"]
SINES = {"name": "sine_list", "version": 1, "frequencies": [2.0], "amplitudes": [12.0], "period_counts": [3]}


def sweep(experiment: dict[str, object], **estimator: object) -> StoredSweep:
    method = {"name": "maximum_likelihood", "version": 4, "friction": {"name": "none", "version": 1}, "modes": None}
    spec = {"name": "excitation_design", "version": 3, "method": method, **estimator}
    return StoredSweep("swp-" + 60 * "0", experiment, spec, {}, Outcome.OK, (), 0.0, None, "computed")


def designed(*others: Fit) -> Result:
    fit = Fit("excitation", SINES, (), (), np.empty(0), np.empty((0, 0)))
    return Result(Outcome.OK, fits=(*others, fit))


@pytest.mark.thorough
def test_a_run_becomes_a_study_that_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "short.toml").write_text(STUDY, encoding="utf-8")
    assert main(["run", "short"]) == 0
    assert main(["design", "short", "-o", "studies/planned.toml", *SETTINGS]) == 0
    told = capsys.readouterr().out
    assert "in 30 s the designed sines are predicted to make bands" in told
    assert "study studies/planned.toml" in told
    found = tomllib.loads(Path("studies/planned.toml").read_text(encoding="utf-8"))
    assert found["excitation"]["name"] == "sine_list"
    assert found["estimator"]["name"] == "maximum_likelihood"
    assert set(found["excitation"]["amplitudes"]) <= {8, 12}
    assert main(["run", "planned"]) == 0
    assert main(["design", "short", "-o", "studies/short.toml", *SETTINGS]) == ExitCode.USAGE
    assert "a different study is in this file" in capsys.readouterr().err


def test_the_study_has_the_machine_of_the_sweep(tmp_path: Path) -> None:
    machine = {"plant": {"name": "modal", "version": 1}, "loop": {"sample_time": 5e-4}, "source": "loop"}
    write_designed_study(sweep(machine), designed(), "As", tmp_path / "planned.toml")
    found = tomllib.loads((tmp_path / "planned.toml").read_text(encoding="utf-8"))
    assert found == {
        "title": "As",
        "plant": {"name": "modal"},
        "loop": {"sample_time": 5e-4},
        "excitation": {key: value for key, value in SINES.items() if key != "version"},
        "estimator": {"name": "maximum_likelihood", "friction": {"name": "none"}},
    }


def test_a_measured_machine_is_the_one_that_was_identified(tmp_path: Path) -> None:
    plant = Fit("plant", {"name": "modal", "version": 1, "rigid_body_gain": 0.2}, (), (), np.empty(0), np.empty((0, 0)))
    controller = {"name": "pid", "version": 1, "proportional": 1.0}
    measured = sweep({"source": "record"}, controller=controller, loop={"sample_time": 1e-3})
    write_designed_study(measured, designed(plant), "As", tmp_path / "planned.toml")
    found = tomllib.loads((tmp_path / "planned.toml").read_text(encoding="utf-8"))
    assert found["plant"] == {"name": "modal", "rigid_body_gain": 0.2}
    assert found["controller"] == {"name": "pid", "proportional": 1.0}
    assert found["loop"] == {"sample_time": 1e-3}


def test_nothing_is_written_without_an_excitation_or_over_another_study(tmp_path: Path) -> None:
    with refused(FraexpError, "excitation"):
        write_designed_study(sweep({}), Result(Outcome.OK, remarks("too little time")), "As", tmp_path / "planned.toml")
    path = tmp_path / "planned.toml"
    path.write_text('title = "Mine"\n', encoding="utf-8")
    with refused(StudyError, path, "--force"):
        write_designed_study(sweep({}), designed(), "As", path)
    write_designed_study(sweep({}), designed(), "As", path, force=True)
    write_designed_study(sweep({}), designed(), "As", path)
    assert tomllib.loads(path.read_text(encoding="utf-8"))["title"] == "As"
