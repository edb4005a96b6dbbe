"""A workspace with a real database, made once by running small studies; `tests.tui.pilots` drives the UI on it."""

import shutil
from pathlib import Path

import pytest

from fraexp.store import Store
from fraexp.tui import app, page
from fraexp.tui.services.study_survey import SurveyProcess
from fraexp.views import law_trial
from fraexp.workspace.workspace_service import WorkspaceService
from tests.waiting import HANG_TIMEOUT_S

RAISING = '''
"""An estimator that fails."""

from fraexp.api import Estimator, Result, Signals


class Raising(Estimator, name="raising", version=1):
    """Fails with a text that would like to command the terminal."""

    def estimate(self, signals: Signals) -> Result:
        """Fail."""
        raise ValueError("nothing to [bold]divide\\x1b[31m by")
'''
RAISING_STUDY = """
title = "What fails"
question = "What is told of a sweep that fails?"
machine = "linear_motor_table"
excitation = { name = "stepped_sine", amplitude = 12.0, points = 2 }
estimator = { name = "raising" }
"""


@pytest.fixture(autouse=True)
def no_theme(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever runs the tests may have chosen a theme; it shall not matter."""
    monkeypatch.delenv("FRAEXP_TUI_THEME", raising=False)


@pytest.fixture(autouse=True)
def patient_screens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys wait until what is slow is there, and a law may take its time: how long is the benchmarks' matter."""
    monkeypatch.setattr(page, "LOAD_TIMEOUT_S", HANG_TIMEOUT_S)
    monkeypatch.setattr(app, "MAX_WAIT_S", HANG_TIMEOUT_S)
    monkeypatch.setattr(law_trial, "MAX_TRIAL_TIME_S", HANG_TIMEOUT_S)


@pytest.fixture
def survey() -> None:
    """Let the list of studies work out what running them would do."""


@pytest.fixture(autouse=True)
def no_survey(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Do without the process that resolves all studies in the background, seconds for each test, unless it matters."""
    if "survey" not in request.fixturenames:
        monkeypatch.setattr(SurveyProcess, "survey", lambda *_: None)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace in which run 1 is the quick study with five points, and run 2 one sweep that failed."""
    folder = tmp_path_factory.mktemp("made")
    for name, text in (("plugins/raising.py", RAISING), ("studies/failing.toml", RAISING_STUDY)):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    workspace = WorkspaceService.open(folder)
    for _ in workspace.run(["quick"], "serial", ["excitation.points=5"]):
        pass
    for _ in workspace.run(["failing"], "serial"):
        pass
    return folder


@pytest.fixture
def workspace(made: Path, tmp_path: Path) -> Path:
    """A copy of that workspace, to be changed as a test likes."""
    folder = tmp_path / "workspace"
    shutil.copytree(made, folder)
    return folder


@pytest.fixture
def keys(workspace: Path) -> list[str]:
    """The keys of the quick study's sweeps, in the order of its grid: conventional and proposed at 12 and 75 N."""
    with Store.open(str(workspace / "results.db"), read_only=True) as store:
        return [sweep.key for sweep in store.sweeps(1)]
