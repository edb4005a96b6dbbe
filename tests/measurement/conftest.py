"""A workspace with a study that can be measured, and simulated machines that start at once."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from fraexp_plugins.machines._shared import axis_server

from fraexp.workspace.workspace_service import WorkspaceService

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


class ForkedServer(subprocess.Popen[str]):
    """The process of a simulated machine as a fork of this one, which has imported and loaded all that it needs."""

    def _execute_child(self, command: list[str], *options: Any) -> None:
        if command[1:] != ["-m", axis_server.__name__]:
            super()._execute_child(command, *options)  # type: ignore[misc]
            return
        child_input, _, _, child_output = options[9:13]
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.setsid()
                os.dup2(child_input, 0)
                os.dup2(child_output, 1)
                os.closerange(3, 1024)  # locks and connections of this process
                sys.stdin, sys.stdout = open(0), open(1, "w")  # noqa: SIM115
                axis_server.main()
            finally:
                os._exit(0)
        os.close(child_input)
        os.close(child_output)
        self._child_created = True


@pytest.fixture(autouse=True)
def forked_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork each simulated machine: to start Python and to load kernels takes longer than what it plays."""
    monkeypatch.setattr(subprocess, "Popen", ForkedServer)


@pytest.fixture
def workspace(tmp_path: Path) -> WorkspaceService:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "axis.toml").write_text(STUDY, encoding="utf-8")
    return WorkspaceService.open(tmp_path)
