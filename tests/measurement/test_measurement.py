"""A study measured on its machine behind a socket: the bits of a run, limits that hold, and what is kept."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.machine_session import PlayRequest
from fraexp.data.results import Result
from fraexp.data.sample_file import read_header
from fraexp.errors import FraexpError, MachineError, ParameterError, PlanError, StudyError
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice
from fraexp.measurement.measurement_plan import plan_measurement
from fraexp.simulation.experiment_run import LiveLoop
from fraexp.simulation.motion_limits import Demand
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S, wait_until

DISTURBED = 'measurement.machine={name="simulated", loss=0.05, delay=0.02, cut_after=2.0}'


def measure(workspace: WorkspaceService, *overrides: str, fresh: bool = False) -> list[Any]:
    return list(MeasurementService(workspace, "axis", overrides, is_trusted=True).measure(fresh))


def measure_points(workspace: WorkspaceService, *overrides: str, fresh: bool = False) -> list[Any]:
    """Measure without computing and drawing what the study of the record asks."""
    return list(MeasurementService(workspace, "axis", overrides, is_trusted=True).measure_points(fresh))


def results(workspace: WorkspaceService, study: str) -> dict[str, Result]:
    """Return the results of a study's newest run by estimator."""
    with workspace.open_store() as store:
        run = next(run for run in store.runs() if run.study == study)
        return {of.estimator["name"]: store.results([of.key])[of.key] for of in store.sweeps(run.number)}


def assert_equal_bits(workspace: WorkspaceService) -> None:
    simulated, measured = results(workspace, "axis"), results(workspace, "axis-measured")
    assert simulated.keys() == measured.keys() == {"conventional", "effective_input"}
    for name, result in simulated.items():
        expected, found = result.response, measured[name].response
        assert expected is not None and found is not None
        for part in ("frequency", "response", "covariance", "settled", "settling_time", "harmonics"):
            np.testing.assert_array_equal(getattr(found, part), getattr(expected, part), err_msg=f"{name}.{part}")


@pytest.mark.thorough
def test_so_it_has_with_lost_packets_delays_and_a_cut_connection(workspace: WorkspaceService) -> None:
    events = measure(workspace, DISTURBED)
    list(workspace.run(["axis"], executor="serial"))
    assert_equal_bits(workspace)
    notes = [event.what for event in events if isinstance(event, MeasurementNotice)]
    assert any("the connection was cut at sample" in note for note in notes)
    points = [event.measured.point for event in events if isinstance(event, PointEstimated)]
    assert [point.frequency for point in points] == ["100 Hz", "38.79 Hz", "10 Hz"]  # the smallest motion first
    assert any("resumed there" in note for point in points for note in point.repeats)


@pytest.mark.parametrize(
    ("limit", "names"),
    [
        ("force=50", ["10 Hz", "limits.force", "50 N"]),
        ("stroke=0.003", ["10 Hz", "limits.stroke", "0.003 m"]),
        ("acceleration=18", ["limits.acceleration", "18 m/s^2"]),
        ("force_rate=20000", ["100 Hz", "limits.force_rate", "20000 N/s"]),
    ],
)
def test_what_is_predicted_to_exceed_a_limit_is_refused(
    workspace: WorkspaceService, tmp_path: Path, limit: str, names: list[str]
) -> None:
    log = f'measurement.machine.log="{tmp_path / "machine.log"}"'
    with refused(ParameterError, *names):
        measure(workspace, f"limits.{limit}", log)
    assert not (tmp_path / "machine.log").exists()


def test_a_machine_that_diverges_in_its_plan_is_refused_with_the_frequency(workspace: WorkspaceService) -> None:
    diverging = ["controller.proportional=1e8", "limits.force=1e9", "limits.velocity=1e9"]
    with refused(PlanError, "10 Hz"):
        MeasurementService(workspace, "axis", diverging).plans()


@pytest.mark.parametrize("frequency", [10.0, 500.0])
def test_a_plan_knows_what_follows_a_stop_at_any_moment(workspace: WorkspaceService, frequency: float) -> None:
    overrides = (f"excitation.frequencies=[{frequency}]", "measurement.ramp_out=0.01", "excitation.ramp=0")
    task = MeasurementService(workspace, "axis", overrides).tasks[0]
    (point,) = plan_measurement(task, workspace.registry).points
    request, setup = point.expected_request(point.counts.record), point.counts.experiment.setup
    for stop in np.random.default_rng(3).integers(1, request.full_samples, 20):
        excitation = request.excitation(0, int(stop) + request.ramp_out + point.settling, int(stop))
        moved = LiveLoop(setup).play(excitation)
        asked = Demand.of_samples(moved["displacement"], moved["u"], setup.sample_time)
        assert np.array(asked) == pytest.approx(np.minimum(asked, np.array(point.demand)), rel=0.05)


def stronger_machine(workspace: WorkspaceService) -> str:
    """Return an override: a machine that moves twice as far as the study's."""
    plant = dict(workspace.studies(["axis"])[0].sweeps[0].experiment["plant"])
    text = ", ".join(f"{key} = {json.dumps(value)}" for key, value in plant.items() if key != "version")
    text = text.replace("rigid_body_gain = 0.132", "rigid_body_gain = 0.264")
    return f'measurement.machine={{name="simulated", plant={{{text}}}}}'


def test_after_a_stop_at_a_limit_the_same_command_goes_on(
    workspace: WorkspaceService, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workspace.folder)
    overrides = (stronger_machine(workspace), "limits.velocity=0.06", "excitation.frequencies=[20.0, 200.0]")
    command = ["measure", "axis", *(word for each in overrides for word in ("--set", each))]
    assert main(command) == ExitCode.LIMIT
    assert "at 20 Hz; the machine was stopped: check the nominal machine" in capsys.readouterr().err
    assert main([*command, "--set", "measurement.adapt_amplitude=true"]) == ExitCode.OK
    assert "2 points, 1 kept" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_record_goes_on_until_its_band_is_narrow(workspace: WorkspaceService) -> None:
    noisy = ("loop.noise=300e-9", "excitation.frequencies=[10.0, 100.0]", "grid.estimator=[{name='conventional'}]")
    band = {}
    for goal in (0.02, 0.002):
        events = measure(workspace, *noisy, f"measurement.band={goal}", fresh=True)
        points = [event.measured.point for event in events if isinstance(event, PointEstimated)]
        assert all(point.band is not None and point.band <= goal for point in points)
        band[goal] = {point.frequency: point.periods for point in points}
    assert band[0.002]["100 Hz"] > 2 * band[0.02]["100 Hz"]
    response = results(workspace, "axis-measured")["conventional"].response
    assert response is not None and response.frequency.size == 2


@pytest.mark.thorough
def test_an_amplitude_at_which_friction_hides_the_plant_is_raised(workspace: WorkspaceService) -> None:
    hidden = (
        "excitation.amplitude=6", "excitation.frequencies=[20.0]", "loop.noise=1e-5", "measurement.band=0.05",
        "measurement.max_record_time=1.5", "grid.estimator=[{name='conventional'}]",
    )  # fmt: skip
    points = {}
    for adapts in ("false", "true"):
        events = measure(workspace, *hidden, f"measurement.adapt_amplitude={adapts}", fresh=True)
        (points[adapts],) = (event.measured.point for event in events if isinstance(event, PointEstimated))
    hidden_point, raised = points["false"], points["true"]
    # a third of the friction force moves the axis by less than its presliding distance: the noise is too large
    assert hidden_point.band is not None and hidden_point.band > 0.05
    assert raised.band is not None and raised.band <= 0.05
    assert raised.amplitude > 1.5
    assert any("the amplitude can be" in repeat for repeat in raised.repeats)
    assert raised.used <= 1


def test_a_measurement_anew_keeps_the_earlier_one_until_it_begins(workspace: WorkspaceService) -> None:
    measure_points(workspace, "excitation.frequencies=[100.0]")
    service = MeasurementService(workspace, "axis")
    files, study = service.files(service.tasks[0]), service.path
    before = [file.read_bytes() for file in (files.samples, files.log, study)]
    unreachable = 'measurement.machine={name="command", program=["no_such_program"]}'
    furlongs = 'measurement.machine={name="command", program=["python3"], units=["furlong", "A"]}'
    silent = 'measurement.machine={name="command", program=["python3", "-c", "raise SystemExit(3)"]}'
    for override in ("limits.acceleration=1", unreachable, furlongs, silent):
        with pytest.raises(FraexpError):
            measure_points(workspace, override, fresh=True)
        assert [file.read_bytes() for file in (files.samples, files.log, study)] == before
    assert {file.suffix for file in files.folder.iterdir()} == {".samples", ".log", ".lock"}


def test_what_a_killed_measurement_had_set_aside_is_put_back_or_discarded(workspace: WorkspaceService) -> None:
    few = ("excitation.frequencies=[50.0, 100.0]",)
    measure_points(workspace, *few)
    service = MeasurementService(workspace, "axis", few)
    files = service.files(service.tasks[0])
    before = [file.read_bytes() for file in (files.samples, files.log)]
    files.samples.rename(files.samples.with_name("axis.samples.before"))  # killed before the log was moved, too
    assert not [event for event in measure_points(workspace, *few) if isinstance(event, PointEstimated)]
    assert [file.read_bytes() for file in (files.samples, files.log)] == before
    events = service.measure_points(fresh=True)
    while not isinstance(next(events), PointEstimated):
        pass
    events.close()
    assert len(files.points()) == 1
    assert not list(files.folder.glob("*.before"))


def test_a_study_that_was_edited_is_kept(workspace: WorkspaceService) -> None:
    few = ("excitation.frequencies=[100.0]", "grid.estimator=[{name='conventional'}]")
    measure_points(workspace, *few)
    usual = MeasurementService(workspace, "axis").path
    beside = usual.with_stem("axis-measured-new")
    assert not beside.exists()
    edited = usual.read_text(encoding="utf-8").replace("An axis, measured", "My axis")
    for act in (measure_points, measure):
        usual.write_text(edited, encoding="utf-8")
        events = act(workspace, *few)
        assert usual.read_text(encoding="utf-8") == edited
        assert "An axis, measured" in beside.read_text(encoding="utf-8")
    (notice,) = (event.what for event in events if isinstance(event, MeasurementNotice))
    assert usual.name in notice and beside.name in notice
    assert not usual.with_stem("axis-measured-new-new").exists()
    with workspace.open_store() as store:
        assert store.runs()[0].study == "axis-measured-new"


def test_points_whose_samples_never_reached_the_disk_are_measured_again(workspace: WorkspaceService) -> None:
    few = ("excitation.frequencies=[50.0, 100.0]",)
    service = MeasurementService(workspace, "axis", few)
    list(service.measure_points())
    files = service.files(service.tasks[0])
    first, last = sorted(files.points(), key=lambda point: point.rest)
    header, length = read_header(files.samples)
    with files.log.open("a", encoding="utf-8") as log:
        log.write('{"point": {"num')
    os.truncate(files.samples, length + 8 * len(header.units) * (last.start + 1) + 3)
    events = list(MeasurementService(workspace, "axis", few).measure_points())
    (notice,) = (event.what for event in events if isinstance(event, MeasurementNotice))
    assert notice.startswith(f"{last.frequency}: measured again, because its samples never reached the disk")
    kept, again = sorted(files.points(), key=lambda point: point.rest)
    assert (kept, again.number) == (first, last.number)
    assert again.rest == last.start + 1


def test_noise_that_the_study_does_not_state_keeps_no_point_from_settling(workspace: WorkspaceService) -> None:
    """It looked like a machine that settles slowly; one that does differs smoothly from period to period."""
    loop = "{sample_time=0.0005, input_dead_time=0.001, resolution=1e-7, noise=3e-7}"
    events = measure_points(
        workspace, "loop.noise=0", "excitation.frequencies=[20, 100]", "excitation.settling_timeout=3",
        f'measurement.machine={{name="simulated", loop={loop}}}',
    )  # fmt: skip
    assert [event.measured.point.settled for event in events if isinstance(event, PointEstimated)] == [True, True]


STUCK = 'measurement.machine.friction={name="coulomb", coulomb_force=500}'
SHORT = ("measurement.max_record_time=3", "excitation.settling_timeout=2")
NO_ENCODER = ("loop.noise=0", "loop.resolution=0", "measurement.band=0.1")


@pytest.mark.parametrize("encoder", [(), NO_ENCODER])
def test_an_axis_that_does_not_move_ends_the_measurement_at_the_first_point(
    workspace: WorkspaceService, encoder: tuple[str, ...]
) -> None:
    service = MeasurementService(workspace, "axis", [STUCK, *SHORT, *encoder])
    with refused(MachineError, "100 Hz", "excitation.amplitude"):
        list(service.measure_points())
    assert service.files(service.tasks[0]).points() == []  # it is measured once the brake is released


def test_where_another_point_pushes_harder_the_measurement_goes_on(workspace: WorkspaceService) -> None:
    """A point of little force shows no motion: friction holds the axis there, and not at the next one."""
    held = 'measurement.machine.friction={name="coulomb", coulomb_force=30}'
    two = "excitation={name='sine_list', frequencies=[100.0, 50.0], amplitudes=[20.0, 40.0], recorded_periods=4}"
    events = MeasurementService(workspace, "axis", [two, held]).measure_points()
    assert sum(isinstance(event, PointEstimated) for event in events) == 2


LOCKING = """
import sys, time
from pathlib import Path
from fraexp.measurement.measured_points import MeasurementFiles
with MeasurementFiles(Path(sys.argv[1]), "axis").locked():
    print("locked", flush=True)
    time.sleep(600)
"""


def test_two_processes_do_not_measure_into_one_file(workspace: WorkspaceService) -> None:
    folder = workspace.folder / "measurements"
    other = subprocess.Popen([sys.executable, "-c", LOCKING, str(folder)], stdout=subprocess.PIPE)
    assert other.stdout is not None and other.stdout.readline() == b"locked\n"
    log = f'measurement.machine.log="{workspace.folder / "machine.log"}"'
    with refused(MachineError, "axis.samples", f"process {other.pid}"):
        measure(workspace, log, fresh=True)
    assert not (workspace.folder / "machine.log").exists()
    other.kill()  # the system releases the lock of a process that dies
    other.communicate()
    events = MeasurementService(workspace, "axis").measure_points()
    assert isinstance(next(events), MeasurementBegun)
    with refused(MachineError, f"process {os.getpid()}"):
        measure(workspace)
    events.close()


@pytest.mark.thorough
def test_another_machine_or_setting_does_not_continue_a_measurement(workspace: WorkspaceService) -> None:
    fewer = "excitation.frequencies=[100.0]"
    measure(workspace, fewer)
    kept = measure(workspace, fewer)
    assert not [event for event in kept if isinstance(event, PointEstimated)]
    with refused(StudyError, "--fresh"):
        measure(workspace, fewer, "excitation.amplitude=41")


def events_of(log: Path) -> list[dict[str, Any]]:
    text = log.read_text() if log.exists() else ""
    return [json.loads(line) for line in text.splitlines() if line.endswith("}")]


def test_wherever_who_measures_is_interrupted_the_machine_comes_to_rest(
    workspace: WorkspaceService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()  # here the machine starts as it does for users
    log = workspace.folder / "machine.log"
    service = MeasurementService(workspace, "axis", [f'measurement.machine={{name="simulated", log="{log}"}}'])
    with service.plans()[0].task.settings.machine.connect(workspace.folder) as session:
        for sent in (2, 3, 4):  # the order to play is the first
            with pytest.raises(KeyboardInterrupt):
                interrupted_after(sent, lambda: [*session.play(PlayRequest(0, np.ones(1000), 1000))])
            wait_until(lambda: [event["event"] for event in events_of(log)[-1:]] == ["rest"])
    assert [event["event"] for event in events_of(log)] == ["play", "rest"] * 3


def interrupted_after(writes: int, call: Callable[[], object]) -> None:
    """Call, and interrupt the call as soon as it has written to a file or socket so many times."""
    written = count(1)

    def interrupt(frame: FrameType, event: str, function: object) -> None:
        if (event, function) == ("c_return", os.write) and next(written) == writes:
            sys.setprofile(None)
            raise KeyboardInterrupt

    sys.setprofile(interrupt)
    try:
        call()
    finally:
        sys.setprofile(None)


@pytest.mark.thorough
def test_after_kill_9_the_machine_stops_and_the_measurement_goes_on(
    workspace: WorkspaceService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()  # here machine and measurement are processes of their own, one of which is killed
    log = workspace.folder / "machine.log"
    machine = f'measurement.machine={{name="simulated", speed=1.0, watchdog=2.0, log="{log}"}}'
    command = [sys.executable, "-m", "fraexp", "measure", "axis", "--set", machine]
    process = subprocess.Popen(command, cwd=workspace.folder, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    points = workspace.folder / "measurements" / "axis.log"
    wait_until(lambda: points.exists() and '"point"' in points.read_text() and events_of(log)[-1]["event"] == "play")
    os.kill(process.pid, signal.SIGKILL)
    process.wait(HANG_TIMEOUT_S)
    wait_until(lambda: events_of(log)[-1]["event"] == "rest")

    stopped = [event for event in events_of(log) if event["event"] in ("watchdog", "rest")][-2:]
    assert [event["event"] for event in stopped] == ["watchdog", "rest"]
    assert stopped[1]["reason"] == "watchdog"
    done = subprocess.run(
        command, cwd=workspace.folder, capture_output=True, text=True, check=False, timeout=HANG_TIMEOUT_S
    )
    assert done.returncode == 0, done.stderr
    assert "3 points, 1 kept" in done.stderr
    list(workspace.run(["axis"], executor="serial"))
    assert_equal_bits(workspace)
