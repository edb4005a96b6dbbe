"""Loops that move by themselves: nothing is played on them, their drive is switched off, and the cause is named."""

import re
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from fraexp.components.machine_session import Chunk
from fraexp.errors import ConnectionLostError
from fraexp.measurement.measurement import MeasurementNotice
from fraexp.measurement.motion_guard import RestWatch, RunawayError
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.workspace.autonomous_service import AutonomousService
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService
from tests.measurement.test_autonomous import STUDY, workspace_with
from tests.measurement.test_measurement import events_of
from tests.refusals import refused
from tests.waiting import wait_until

AXES = Path(__file__).parents[3] / "shared" / "machines"
"""Axes in C, beside the repository."""
LIMITS = {"stroke": 0.1, "velocity": 1.0, "force": 180.0}
"""Limits of these axes [m, m/s, N]."""
REVERSED = 'controller={name="transfer_function", numerator=[-40000.0, 35000.0], denominator=[1.0, -0.7]}'
STIFF = 'controller={name="pid", proportional=6e4, derivative_time=0.0566, filter_time=0.00629}'


def simulated(controller: str, log: Path) -> str:
    return f'measurement.machine={{name="simulated", log="{log}", {controller}}}'


@pytest.mark.parametrize(("controller", "remedy"), [(REVERSED, "sign"), (STIFF, "gain")])
def test_a_simulated_loop_that_moves_by_itself_is_switched_off(tmp_path: Path, controller: str, remedy: str) -> None:
    log = tmp_path / "machine.log"
    service = AutonomousService(workspace_with(STUDY, tmp_path), "axis", [simulated(controller, log)])
    with refused(RunawayError, remedy, "switched off"):
        list(service.measure())
    assert [event["event"] for event in events_of(log)].count("off") == 1


def test_a_planned_measurement_is_refused_before_its_excitation(workspace: WorkspaceService) -> None:
    log = workspace.folder / "machine.log"
    service = MeasurementService(workspace, "axis", [simulated(STIFF, log)])
    with pytest.raises(RunawayError):
        list(service.measure_points())
    assert [event["event"] for event in events_of(log)] == ["play", "off", "rest"]


@pytest.fixture(scope="session")
def axis_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The server of axes, compiled."""
    compiler = shutil.which("gcc")
    if compiler is None or not AXES.is_dir():
        pytest.skip("needs gcc, and the axes in ../shared/machines")
    program = tmp_path_factory.mktemp("axis") / "axis"
    subprocess.run([compiler, "-O2", "-w", "-o", program, AXES / "axis.c", "-lm"], check=True)
    return program


DISABLE = """
def _disable(self):
    self.s.sendall(struct.pack("<3i", 3, 0, 0))

Session.disable = _disable
"""
CUT_SHORT = """
def _shorter(self, request, play=Session.play):
    for chunk in play(self, request):
        if chunk.start >= 2000:
            return
        yield chunk

Session.play = _shorter
"""
SENT_TWICE = CUT_SHORT.replace("return", "yield chunk")
Serve = Callable[[str, str], tuple[int, Path]]


@pytest.fixture
def serve(axis_program: Path, tmp_path: Path) -> Iterator[Serve]:
    """A function that serves an axis in real time, with more lines in its file; it returns port and log."""
    processes: list[subprocess.Popen[bytes]] = []

    def start(name: str, more: str = "") -> tuple[int, Path]:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = int(free.getsockname()[1])
        config, log = tmp_path / "axis.cfg", tmp_path / "truth.log"
        config.write_text((AXES / f"{name}.cfg").read_text(encoding="utf-8") + more, encoding="utf-8")
        processes.append(subprocess.Popen([axis_program, config, "serve", str(port), log, "1"]))
        wait_until(log.exists)
        return port, log

    yield start
    for process in processes:
        process.kill()
        process.wait()


def workspace_of_axis(folder: Path, port: int, more: str = DISABLE) -> WorkspaceService:
    (folder / "plugins").mkdir()
    client = (AXES / "axisnet.py").read_text(encoding="utf-8") + more
    (folder / "plugins" / "axisnet.py").write_text(client, encoding="utf-8")
    text = 'title = "x"\n[loop]\nsample_time = 5e-4\n[limits]\n' + "".join(f"{k} = {v}\n" for k, v in LIMITS.items())
    return workspace_with(f'{text}[measurement]\nmachine = {{ name = "axisnet", port = {port} }}\n', folder)


def true_motion(log: Path) -> list[dict[str, float]]:
    """Return the true stroke, velocity and force of each play."""
    names = {"stroke": "stroke", "v": "velocity", "f": "force"}
    plays = re.findall(r"stroke (\S+) v (\S+) f (\S+)", log.read_text(encoding="utf-8"))
    return [dict(zip(names.values(), map(float, play), strict=True)) for play in plays]


@pytest.mark.parametrize(
    ("name", "more", "client", "names", "excited"),
    [
        ("wrong_sign", "", DISABLE, ["encoder", "switched off"], False),
        ("wrong_sign", "cogA 0\ncogA2 0\n", DISABLE, ["encoder", "switched off"], True),
        ("unstable", "", DISABLE, ["controller", "switched off"], False),
        ("unstable", "", "", ["controller", "disable"], False),
    ],
)
def test_an_axis_that_runs_away_is_switched_off_within_its_limits(
    serve: Serve, tmp_path: Path, name: str, more: str, client: str, names: list[str], excited: bool
) -> None:
    """Without cogging friction holds the axis of the wrong sign, and the excitation is the first to move it."""
    port, log = serve(name, more)
    service = AutonomousService(workspace_of_axis(tmp_path, port, client), "axis")
    with refused(RunawayError, *names):
        list(service.measure())
    assert bool(service.files.samples.exists()) == excited
    plays = wait_until(lambda: true_motion(log)) if client else []
    assert not excited or all(play[limit] <= LIMITS[limit] for play in plays for limit in LIMITS)


def test_an_axis_that_rings_after_a_play_does_not_run_away() -> None:
    """Within a quarter of a period a decaying oscillation accelerates as a loop does that runs away."""
    position = 1e-5 * np.cos(2 * np.pi * 20 * 2e-4 * np.arange(60))
    chunk = Chunk(0, {"y": position, "u": np.zeros(60)})
    limits = MotionLimits(stroke=1e-3, velocity=1.0, force=10.0)
    found = [RestWatch(limits, 2e-4, stroke).look(chunk) for stroke in (0.0, 0.5e-5, 2e-5)]
    assert [isinstance(each, RunawayError) for each in found] == [True, True, False]


@pytest.mark.parametrize(("fault", "names"), [(CUT_SHORT, ["2000 of 48100"]), (SENT_TWICE, ["2000 to 2020", 2020])])
def test_samples_of_a_play_are_counted(serve: Serve, tmp_path: Path, fault: str, names: list[object]) -> None:
    """While the first sine is below friction the axis stands; what is missing of it says nothing of the limits."""
    port, _ = serve("a_linmot", "")
    service = AutonomousService(workspace_of_axis(tmp_path, port, fault), "axis")
    with refused(ConnectionLostError, *names):
        list(service.measure())


def test_samples_that_come_at_half_the_stated_rate_are_noticed(serve: Serve, tmp_path: Path) -> None:
    port, _ = serve("a_linmot", "Ts 1e-3\nTd 0\n")
    service = AutonomousService(workspace_of_axis(tmp_path, port), "axis")
    with closing(service.measure()) as events:
        assert any(isinstance(event, MeasurementNotice) and "loop.sample_time" in event.what for event in events)
