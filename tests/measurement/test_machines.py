"""Programs and folders as machines, the template, and what they say when something is wrong."""

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fraexp_plugins.machines.command import CommandMachine
from fraexp_plugins.machines.folder import FolderMachine

from fraexp.components.machine_session import MachineSession, PlayRequest
from fraexp.errors import ConnectionLostError, MachineError
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService
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
    service = MeasurementService(workspace, "axis", [machine, "excitation.frequencies=[100.0]"])
    measured = [event.measured.point for event in service.measure_points() if isinstance(event, PointEstimated)]
    assert [point.frequency for point in measured] == ["100 Hz"]


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("print('1,2')", ConnectionLostError, r"python3 ended with exit code 0 after 1 of 320 samples"),
        ("print('1;2')", MachineError, r"python3, line 1: '1;2'; expected numbers for y,u"),
    ],
)
def test_a_program_that_does_not_measure_is_named(
    tmp_path: Path, text: str, error: type[Exception], message: str
) -> None:
    program(tmp_path, text)
    with command().connect(tmp_path) as session, pytest.raises(error, match=message):
        played(session)


def test_a_missing_program_is_named(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"there is no program 'no_such_program'"):
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


def test_a_folder_without_an_answer_is_told_to_stop(tmp_path: Path) -> None:
    (tmp_path / "exchange").mkdir()
    machine = FolderMachine(folder="exchange", sample_time=SAMPLE_TIME, timeout=0.01)
    with machine.connect(tmp_path) as session, pytest.raises(ConnectionLostError, match=r"no play-0001-record\.csv"):
        played(session)
    assert (tmp_path / "exchange" / "stop").exists()
    with pytest.raises(MachineError, match=r"there is no folder .*nowhere"):
        FolderMachine(folder="nowhere", sample_time=1e-3).connect(tmp_path)


def test_a_stop_lets_the_excitation_fall_within_the_ramp_out() -> None:
    stop = 137
    force = REQUEST.excitation(0, REQUEST.samples, stop)
    np.testing.assert_array_equal(force[:stop], REQUEST.excitation(0, stop))
    np.testing.assert_array_equal(force[stop + REQUEST.ramp_out - 1 :], 0)
    assert np.abs(np.diff(force)).max() < np.abs(np.diff(REQUEST.waveform)).max() + 5 / REQUEST.ramp_out
    parts = [REQUEST.excitation(k, k + 7, stop) for k in range(0, 70, 7)]
    np.testing.assert_array_equal(np.concatenate(parts), force[:70])
