"""The move of Fig 8 on what three methods identify, by the command that the pages name."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.kinds import Plant
from fraexp.components.registry import create
from fraexp.workspace.workspace_service import WorkspaceService
from tests.identification.plant_responses import MACHINE
from tests.machines import decibel


@pytest.mark.thorough
def test_a_move_on_the_identified_plant_and_friction_settles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], registry: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["run", "paper/fig08_identified", "--json", "--executor", "serial"]) == ExitCode.OK
    sweeps: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["runs"][0]["sweeps"]
    found = {
        sweep["labels"]["case"]: {metric["name"]: metric["value"] for metric in sweep["metrics"]}
        for sweep in sweeps
        if sweep["metrics"]
    }
    with WorkspaceService.open(tmp_path).open_store() as store:
        keys = {sweep["labels"]["case"]: sweep["key"] for sweep in sweeps}
        response = store.result(keys["autonomous, 12 and 24 N"]).response
    assert response.frequency[0] == 1.0
    truth = create(registry, Plant, MACHINE["plant"]).response(2 * np.pi * response.frequency)
    assert np.abs(decibel(response.response / truth)).max() < 0.2
    identified = found["autonomous, 12 and 24 N"]
    assert identified["k0"] == pytest.approx(0.132, rel=1e-3)
    assert identified["f1"] == pytest.approx(38.8, abs=0.01)
    for case in ("P_d of the proposed method", "P_d and friction, autonomous"):
        assert found[case]["overshoot"] <= 1.5e-6
        assert found[case]["settling time"] == pytest.approx(0.0385, abs=1e-3)
    assert found["P_d of the conventional method"]["overshoot"] > 100e-6
