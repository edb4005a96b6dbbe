"""What a study runs: refused until its user has allowed exactly that, and remembered; what it writes stays inside."""

import os
import pty
from pathlib import Path

import pytest
from fraexp_plugins.machines.ads import AdsMachine
from fraexp_plugins.machines.command import CommandMachine
from fraexp_plugins.machines.folder import FolderMachine
from fraexp_plugins.machines.simulated import SimulatedMachine

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.errors import ConsentError, PlanError
from fraexp.measurement.consent import CONSENTS_VARIABLE, Consent, missing_consent
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused

MARKING = "open('ran', 'w')\nraise SystemExit('the drive is off')"
MACHINE = 'measurement.machine={name="command", program=["python3", "axis.py", "{file}"]}'


@pytest.fixture(autouse=True)
def consents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CONSENTS_VARIABLE, str(tmp_path / "settings" / "consents"))
    return tmp_path / "settings" / "consents"


def test_a_program_is_refused_and_shown_whole_until_it_is_allowed(
    workspace: WorkspaceService, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workspace.folder)
    Path("axis.py").write_text(MARKING, encoding="utf-8")
    assert main(["measure", "axis", "--set", MACHINE]) == ExitCode.USAGE
    assert f"python3 axis.py '{{file}}' in {workspace.folder}; allow it" in capsys.readouterr().err
    with refused(ConsentError, "--trust-program", "is_trusted=True"):
        list(MeasurementService(workspace, "axis", [MACHINE]).measure_points())
    assert not Path("ran").exists()
    assert main(["measure", "axis", "--trust-program", "--set", MACHINE]) == ExitCode.MACHINE
    assert Path("ran").exists()


def test_an_answer_on_a_terminal_is_remembered_for_this_program_alone(
    workspace: WorkspaceService, consents: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workspace.folder)
    (workspace.folder / "axis.py").write_text(MARKING, encoding="utf-8")
    for typed, code in ((b"n\n", ExitCode.USAGE), (b"y\n", ExitCode.MACHINE)):
        terminal, inside = pty.openpty()
        os.write(terminal, typed)
        with os.fdopen(inside, encoding="utf-8") as stdin:
            monkeypatch.setattr("sys.stdin", stdin)
            assert main(["measure", "axis", "--set", MACHINE]) == code
        os.close(terminal)
        assert "[y/N]" in capsys.readouterr().err
    machine = CommandMachine(program=("python3", "axis.py", "{file}"), sample_time=1e-3)
    assert missing_consent(machine, workspace.folder) is None
    assert missing_consent(machine.model_copy(update={"program": ("python3", "b.py")}), workspace.folder)
    assert missing_consent(machine, workspace.folder / "studies")  # another workspace has another axis.py
    assert "axis.py" in consents.read_text(encoding="utf-8")


def test_a_file_of_the_workspace_named_like_a_program_is_shown_as_what_it_is(tmp_path: Path) -> None:
    machine = CommandMachine(program=("python3", "axis.py"), sample_time=1e-3)
    assert str(tmp_path) not in machine.consent(tmp_path).partition(" in ")[0]
    (tmp_path / "python3").touch()
    assert machine.consent(tmp_path).startswith(f"run {tmp_path / 'python3'} axis.py")


def test_a_controller_that_a_study_names_needs_consent_too(tmp_path: Path) -> None:
    machine = AdsMachine(net_id="5.12.82.20.1.1", sample_time=1e-3)
    assert "write to the PLC 5.12.82.20.1.1, port 851" in machine.consent(tmp_path)


def test_a_damaged_file_of_consents_allows_nothing(consents: Path) -> None:
    consent = Consent("run it")
    consent.remember()
    assert consent.is_given
    consents.write_text("[]\n", encoding="utf-8")
    assert not consent.is_given


@pytest.mark.parametrize("name", ["../elsewhere", "/tmp", "link"])
def test_a_machine_writes_into_the_workspace_alone(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "workspace"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path)
    with refused(PlanError, "measurement.machine.folder", folder):
        FolderMachine(folder=name, sample_time=1e-3).connect(folder)
    simulated = SimulatedMachine.model_construct(log=f"{name}/log", loop={"sample_time": 1e-3})
    with refused(PlanError, "measurement.machine.log", folder):
        simulated.connect(folder)
