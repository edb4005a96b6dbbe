"""Programs and folders as machines, the template, and what they say when something is wrong."""

import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.machines.command import CommandMachine
from fraexp_plugins.machines.folder import FolderMachine

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.machine_session import MachineSession, PlayRequest
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.errors import BusyError, ConnectionLostError, MachineError, ParameterError
from fraexp.measurement.watched_machine import WatchedMachine, connect_watched
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.testing.conformance_check import ViolationError
from fraexp.testing.result_checks import require_si
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S, wait_until

SAMPLE_TIME = 1e-3
REQUEST = PlayRequest(0, 5 * np.sin(2 * np.pi * np.arange(50) / 50), 6, 0.01, 20)
PROGRAM = """
import sys
lines = open(sys.argv[1]) if len(sys.argv) > 1 else sys.stdin
position = velocity = 0.0
for line in lines:
    force = float(line)
    velocity += force * {step} / 2.0
    position += velocity * {step}
    print(f"{{position!r}},{{force!r}}", flush=True)
"""


def program(folder: Path, text: str = PROGRAM.format(step=SAMPLE_TIME)) -> None:
    (folder / "axis.py").write_text(text, encoding="utf-8")


def command(*words: str) -> CommandMachine:
    return CommandMachine(program=("python3", "axis.py", *words), sample_time=SAMPLE_TIME)


def connected(machine: CommandMachine, folder: Path) -> WatchedMachine:
    limits = MotionLimits(stroke=1.0, velocity=1.0, force=100.0)
    return connect_watched(MeasurementSettings(machine=machine), folder, False, limits, is_trusted=True)


def expected_position() -> np.ndarray:
    force = REQUEST.excitation(0, REQUEST.samples)
    return np.cumsum(np.cumsum(force) * SAMPLE_TIME / 2.0) * SAMPLE_TIME


def played(session: MachineSession) -> dict[str, Any]:
    chunks = list(session.play(REQUEST))
    assert [chunk.start for chunk in chunks] == [0, *np.cumsum([chunk.size for chunk in chunks])[:-1]]
    return {name: np.concatenate([chunk.channels[name] for chunk in chunks]) for name in ("y", "u")}


@pytest.mark.parametrize("words", [(), ("{file}",)])
def test_a_program_is_a_machine(tmp_path: Path, words: tuple[str, ...]) -> None:
    program(tmp_path)
    with command(*words).connect(tmp_path) as session:
        found = played(session)
    np.testing.assert_allclose(found["y"], expected_position(), atol=1e-12)
    np.testing.assert_array_equal(found["u"], REQUEST.excitation(0, REQUEST.samples))


def test_a_program_is_stopped_between_two_chunks_and_started_again(tmp_path: Path) -> None:
    program(tmp_path)
    with command().connect(tmp_path) as session:
        sizes = []
        for chunk in session.play(REQUEST):
            sizes.append(chunk.size)
            session.stop()
        assert sum(sizes) < REQUEST.samples
        np.testing.assert_allclose(played(session)["y"], expected_position(), atol=1e-12)


def test_a_study_is_measured_on_a_program(workspace: WorkspaceService) -> None:
    program(workspace.folder, PROGRAM.format(step=0.0005).replace("2.0", "7.6"))
    machine = 'measurement.machine={name="command", program=["python3", "axis.py", "{file}"]}'
    service = MeasurementService(workspace, "axis", [machine, "excitation.frequencies=[100.0]"], is_trusted=True)
    measured = [event.measured.point for event in service.measure_points() if isinstance(event, PointEstimated)]
    assert [point.frequency for point in measured] == ["100 Hz"]


def commanded(units: str, text: str) -> str:
    """Return an override: a free mass of 7.6 kg whose program counts as stated."""
    Path("axis.py").write_text(text, encoding="utf-8")
    return f'measurement.machine={{name="command", program=["python3", "axis.py", "{{file}}"], units={units}}}'


def measured_in(workspace: WorkspaceService, units: str, text: str, *overrides: str) -> list[Any]:
    """Return the points of a measurement, measured anew."""
    machine = commanded(units, text)
    settings = [machine, "excitation.frequencies=[100.0]", *overrides]
    service = MeasurementService(workspace, "axis", settings, is_trusted=True)
    return [each.measured.point for each in service.measure_points(True) if isinstance(each, PointEstimated)]


def test_limits_count_in_whatever_units_a_machine_has(workspace: WorkspaceService, monkeypatch: Any) -> None:
    monkeypatch.chdir(workspace.folder)
    plain = PROGRAM.format(step=0.0005).replace("2.0", "7.6")
    scaled = plain.replace("float(line)", "1e3 * float(line)").replace(
        "{position!r},{force!r}", "{1e3*position!r},{force/1e3!r}"
    )
    (si,) = measured_in(workspace, '["m", "N"]', plain)
    (other,) = measured_in(workspace, '["mm", "kN"]', scaled)
    assert (other.used, other.periods) == (pytest.approx(si.used, rel=1e-9), si.periods)
    stronger = scaled.replace("7.6", "2.5")
    with refused(MachineError, "limits.velocity", "0.06 m/s", "20 Hz"):
        measured_in(workspace, '["mm", "kN"]', stronger, "limits.velocity=0.06", "excitation.frequencies=[20.0]")


@pytest.mark.parametrize(
    ("units", "names"),
    [
        ('["m", "A"]', ["channel u", "'A'", "'N'"]),
        ('["rad", "N m"]', ["channel y", "'rad'", "'m'"]),
        ('["parsec_s", "N"]', ["channel y", "'parsec_s'"]),
    ],
)
def test_units_that_no_limit_is_in_are_refused_before_anything_moves(
    workspace: WorkspaceService, monkeypatch: Any, units: str, names: list[str]
) -> None:
    monkeypatch.chdir(workspace.folder)
    with refused(MachineError, *names):
        measured_in(workspace, units, "open('moved', 'w')")
    assert not (workspace.folder / "moved").exists()


def test_a_check_of_a_machine_finds_units_that_no_limit_is_in() -> None:
    require_si({"y": "mm", "u": "kN"})
    require_si({"y": "deg", "u": "Nm"})
    for units in ({"y": "m", "u": "A"}, {"y": "rad", "u": "N"}, {"y": "m"}):
        with refused(ViolationError, "channel"):
            require_si(units)


def test_limits_of_a_machine_count_and_may_be_texts_with_units(workspace: WorkspaceService) -> None:
    file = workspace.folder / "studies" / "axis.toml"
    file.write_text(file.read_text().replace('stroke = "20 mm"\n', ""))
    stated = 'measurement.machine={name="simulated", limits={stroke="1 um"}}'
    with refused(MachineError, "limits.stroke", "1 µm", "10 Hz"):
        list(MeasurementService(workspace, "axis", [stated]).measure_points())
    with refused(ParameterError, "stroke", "'furlongg'"):
        list(MeasurementService(workspace, "axis", [stated.replace("1 um", "1 furlongg")]).measure_points())


@pytest.mark.parametrize(
    ("text", "error", "names"),
    [
        ("print('1,2')", ConnectionLostError, ["code 0", "1 of 320"]),
        (
            "print('1,2', flush=True)\nraise ValueError('no port')",
            MachineError,
            ["code 1", "1 of 320", "ValueError: no port"],
        ),
        ("import os\nos._exit(3)", MachineError, ["code 3", "0 of 320"]),
        ("print('1;2')", MachineError, ["line 1", "'1;2'", "y,u"]),
        (f"print('0,0')\n{PROGRAM.format(step=SAMPLE_TIME)}", MachineError, ["line 321", "320 samples"]),
    ],
)
def test_a_program_that_does_not_measure_is_named(
    tmp_path: Path, text: str, error: type[Exception], names: list[str]
) -> None:
    program(tmp_path, text)
    with command().connect(tmp_path) as session, refused(error, "python3", *names):
        played(session)


SLOW = """
import math, sys
y = [0.0]
for k, line in enumerate(open(sys.argv[1])):
    y.append(y[-1] + 1e-7 * math.exp(-k / 2e4) + 1e-7 * float(line))
    print(f"{y[-1]!r},{line.strip()}")
"""


def test_a_machine_that_settles_too_late_is_said_to(workspace: WorkspaceService, monkeypatch: Any) -> None:
    monkeypatch.chdir(workspace.folder)
    with refused(MachineError, "100 Hz", "2 plays", "measurement.attempts"):
        measured_in(workspace, '["m", "N"]', SLOW, "measurement.attempts=2")


def test_a_program_that_hangs_is_lost_after_the_timeout(tmp_path: Path) -> None:
    program(tmp_path, "import time\nfor k in range(5):\n    print('0.0,1.0', flush=True)\ntime.sleep(60)")
    machine = command().model_copy(update={"timeout": 0.5})
    with machine.connect(tmp_path) as session, refused(ConnectionLostError, "python3", "0.5 s", "timeout"):
        played(session)


def test_one_process_at_a_time_measures_on_a_machine(tmp_path: Path) -> None:
    """Another study or workspace that names the same machine is refused before anything moves."""
    program(tmp_path)
    with connected(command(), tmp_path):
        with refused(BusyError, "axis.py", f"process {os.getpid()}"):
            connected(command(), tmp_path)
        connected(command("{file}"), tmp_path).close()
    connected(command(), tmp_path).close()


EXITS = {
    "limits.force=30": ExitCode.USAGE,
    'measurement.machine={name="command", program=["python3", "-c", "print(1)"]}': ExitCode.MACHINE,
}
"""Override of the study, and how its measurement ends: at a limit it does in `test_measurement`."""


@pytest.mark.parametrize("override", EXITS)
def test_the_exit_code_says_whose_fault_it_is(workspace: WorkspaceService, monkeypatch: Any, override: str) -> None:
    monkeypatch.chdir(workspace.folder)
    program(workspace.folder, PROGRAM.format(step=0.0005))
    assert main(["measure", "axis", "--trust-program", "--set", override]) == EXITS[override]


def test_a_machine_that_is_in_use_has_an_exit_code_of_its_own(workspace: WorkspaceService, monkeypatch: Any) -> None:
    monkeypatch.chdir(workspace.folder)
    events = MeasurementService(workspace, "axis").measure_points()
    next(events)
    assert main(["measure", "axis"]) == ExitCode.BUSY
    events.close()


def test_a_missing_program_is_named(tmp_path: Path) -> None:
    with refused(MachineError, "'no_such_program'", tmp_path, "PATH"):
        CommandMachine(program=("no_such_program",), sample_time=1e-3).connect(tmp_path)


def answer(folder: Path, name: str) -> None:
    """Play an excitation that appears in a folder, and put its record there."""
    file = wait_until(lambda: next(iter(folder.glob(f"{name}.csv")), None))
    force = np.loadtxt(file, skiprows=1)
    position = np.cumsum(np.cumsum(force) * SAMPLE_TIME / 2.0) * SAMPLE_TIME
    draft = folder / "draft"
    np.savetxt(draft, np.array([force, position]).T, delimiter=",", header="u,y", comments="", fmt="%.17g")
    draft.rename(folder / f"{name}-record.csv")


def test_a_folder_is_a_machine(tmp_path: Path) -> None:
    (tmp_path / "exchange").mkdir()
    machine = FolderMachine(folder="exchange", sample_time=SAMPLE_TIME, timeout=HANG_TIMEOUT_S)
    for number in (1, 2):  # a later session goes on counting
        thread = threading.Thread(target=answer, args=(tmp_path / "exchange", f"play-{number:04d}"))
        thread.start()
        with machine.connect(tmp_path) as session:
            found = played(session)
        thread.join()
        np.testing.assert_array_equal(found["y"], expected_position())
    assert not (tmp_path / "exchange" / "stop").exists()


def test_a_record_of_more_samples_than_were_played_is_refused(tmp_path: Path) -> None:
    exchange = tmp_path / "exchange"
    exchange.mkdir()
    machine = FolderMachine(folder="exchange", sample_time=SAMPLE_TIME, timeout=HANG_TIMEOUT_S)
    longer = "y,u\n" + "0,1\n" * (REQUEST.samples + 5)
    with machine.connect(tmp_path) as session:
        playing = session.play(REQUEST)
        thread = threading.Thread(target=put_record, args=(exchange, longer))
        thread.start()
        with refused(MachineError, "play-0001-record.csv", "325 rows", "play-0001.csv", 320):
            next(playing)
        thread.join()


def put_record(folder: Path, text: str) -> None:
    """Answer the first play with a record."""
    wait_until(lambda: next(iter(folder.glob("play-0001.csv")), None))
    (folder / "draft").write_text(text, encoding="utf-8")
    (folder / "draft").rename(folder / "play-0001-record.csv")


def test_a_folder_without_an_answer_is_told_to_stop(tmp_path: Path) -> None:
    (tmp_path / "exchange").mkdir()
    machine = FolderMachine(folder="exchange", sample_time=SAMPLE_TIME, timeout=0.01)
    with (
        machine.connect(tmp_path) as session,
        refused(MachineError, "play-0001-record.csv", "0.01 s", "measurement.machine.timeout"),
    ):
        played(session)
    assert [file.name for file in (tmp_path / "exchange").iterdir()] == ["stop"]  # the play is taken back
    with refused(MachineError, tmp_path / "nowhere", "measurement.machine.folder"):
        FolderMachine(folder="nowhere", sample_time=1e-3).connect(tmp_path)


def test_a_stop_lets_the_excitation_fall_within_the_ramp_out() -> None:
    stop = 137
    force = REQUEST.excitation(0, REQUEST.samples, stop)
    np.testing.assert_array_equal(force[:stop], REQUEST.excitation(0, stop))
    np.testing.assert_array_equal(force[stop + REQUEST.ramp_out - 1 :], 0)
    assert np.abs(np.diff(force)).max() < np.abs(np.diff(REQUEST.waveform)).max() + 5 / REQUEST.ramp_out
    parts = [REQUEST.excitation(k, k + 7, stop) for k in range(0, 70, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), force[:70])
