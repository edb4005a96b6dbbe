"""A workspace with a study that can be measured, and simulated machines that start at once."""

import subprocess
from pathlib import Path

import pytest

from fraexp.workspace.workspace_service import WorkspaceService
from tests.forks import ForkedPython

STUDY = """
title = "An axis"
machine = "linear_motor_table"

[excitation]
name = "stepped_sine"
frequencies = [10.0, 38.8, 100.0]
amplitude = 40
recorded_periods = 4

[loop]
noise = "30 nm"

[numerics]
steps_per_sample = 6

[limits]
stroke = "20 mm"
velocity = "0.5 m/s"
force = 150

[measurement]
machine = { name = "simulated" }

[grid]
"estimator" = [{ name = "conventional" }, { name = "effective_input" }]
"""


@pytest.fixture(autouse=True)
def forked_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork each simulated machine: to start Python and to load kernels takes longer than what it plays."""
    monkeypatch.setattr(subprocess, "Popen", ForkedPython)


@pytest.fixture
def workspace(tmp_path: Path) -> WorkspaceService:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "axis.toml").write_text(STUDY, encoding="utf-8")
    return WorkspaceService.open(tmp_path)
