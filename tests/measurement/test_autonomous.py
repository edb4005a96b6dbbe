"""Autonomous measurements: what the axis is known by, how carefully it is approached, and what is found."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fraexp.components.machine_session import Chunk, MachineDescription, MachineSession, PlayRequest
from fraexp.components.measurement_settings import MeasurementSettings
from fraexp.components.registry import Registry, discover
from fraexp.data.sample_file import SampleHeader, SampleWriter, create_sample_file
from fraexp.errors import FraexpError, MachineError
from fraexp.measurement import autonomous_points
from fraexp.measurement.autonomous_points import PointDesign
from fraexp.measurement.friction_loop import LOOP_HZ, FrictionLoop, measure_friction_loop
from fraexp.measurement.measured_points import MeasuredPoint
from fraexp.measurement.motion_guard import MotionGuard
from fraexp.measurement.unknown_axis import UnknownAxis
from fraexp.measurement.watched_machine import WatchedMachine
from fraexp.simulation.motion_limits import MotionLimits
from fraexp.study.study_file import read
from fraexp.workspace.autonomous_service import AutonomousService, EvaluationProgress
from fraexp.workspace.workspace_service import WorkspaceService
from tests.refusals import refused

STUDY = """
title = "An axis"
machine = "linear_motor_table"

[loop]
noise = "30 nm"

[limits]
stroke = "40 mm"
velocity = "1 m/s"
force = 150

[measurement]
machine = { name = "simulated" }
"""
FORCE, STIFFNESS, HELD = 20.0, 2e6, 5e3
"""Friction force [N], presliding stiffness [N/m] and stiffness of the feedback [N/m] of the axis without mass."""


class MasslessSession(MachineSession):
    """An axis without mass: a Jenkins element beside the feedback's spring, in closed form."""

    def __init__(self, force: float = FORCE, sample_time: float = 1e-3) -> None:
        self._force, self._is_stopped = force, False
        self._description = MachineDescription({"y": "m", "u": "N"}, sample_time)
        self.played: list[float] = []
        self.positions: list[float] = []

    @property
    def description(self) -> MachineDescription:
        return self._description

    def play(self, request: PlayRequest) -> Iterator[Chunk]:
        y, element, self._is_stopped = 0.0, 0.0, False
        for begin in range(0, request.samples, 50):
            stop = begin if self._is_stopped else None
            excitation = request.excitation(begin, min(begin + 50, request.samples), stop)
            positions = []
            for each in excitation:
                sticking = (each - element + STIFFNESS * y) / (STIFFNESS + HELD)
                trial = element + STIFFNESS * (sticking - y)
                limited = float(np.clip(trial, -self._force, self._force))
                y = sticking if trial == limited else (each - limited) / HELD
                element = limited
                positions.append(y)
            self.played += np.abs(excitation).tolist()
            self.positions += positions
            yield Chunk(begin, {"y": np.array(positions), "u": excitation - HELD * np.array(positions)})
            if self._is_stopped:
                return

    def stop(self) -> None:
        self._is_stopped = True


@pytest.fixture(scope="module")
def components() -> Registry:
    return discover()


def axis_of(limits: MotionLimits, sample_time: float = 1e-3) -> UnknownAxis:
    settings = MeasurementSettings.model_construct(margin=0.1, ramp_out=0.05)
    return UnknownAxis("axis", "An axis", sample_time, False, limits, settings)


def loop_of(session: MasslessSession, limits: MotionLimits, folder: Path, components: Registry) -> FrictionLoop:
    axis, file = axis_of(limits), folder / "axis.samples"
    create_sample_file(file, SampleHeader(axis.sample_time, {"play": "", **session.description.channels}))
    writer = SampleWriter(file)
    machine = WatchedMachine(session, False, limits, axis.share)
    machine.await_rest()
    try:
        return measure_friction_loop(axis, machine, writer, axis.sines([LOOP_HZ], components)[0])
    finally:
        writer.close()


def test_the_loop_closes_at_the_friction_force(tmp_path: Path, components: Registry) -> None:
    limits = MotionLimits(stroke=40e-3, velocity=1.0, force=200.0)
    session = MasslessSession()
    found = loop_of(session, limits, tmp_path, components)
    assert found.has_closed
    assert found.force == pytest.approx(FORCE, rel=0.1)
    assert max(session.played) < 4 * FORCE


def test_the_friction_force_has_no_viscous_part(tmp_path: Path, components: Registry) -> None:
    damping, sample_time = 1500.0, 1e-3

    class Damped(MasslessSession):
        """Coulomb and viscous friction beside the feedback's spring."""

        def play(self, request: PlayRequest) -> Iterator[Chunk]:
            y = 0.0
            for chunk in super().play(request):
                excitation, positions = chunk.channels["u"] + HELD * chunk.channels["y"], []
                for each in excitation:
                    drive = each - HELD * y
                    free = drive - np.clip(drive, -FORCE, FORCE)
                    y += sample_time * free / (damping + HELD * sample_time)
                    positions.append(y)
                yield Chunk(chunk.start, {"y": np.array(positions), "u": excitation - HELD * np.array(positions)})

    found = loop_of(Damped(), MotionLimits(stroke=40e-3, velocity=1.0, force=200.0), tmp_path, components)
    assert found.has_closed
    assert found.amplitude > 4 * FORCE  # most of which is viscous
    assert found.force == pytest.approx(FORCE, rel=0.25)


def test_a_growing_sine_stops_at_its_share_of_a_limit(tmp_path: Path, components: Registry) -> None:
    limits = MotionLimits(stroke=0.1e-3, velocity=1.0, force=200.0)
    session = MasslessSession(force=1e9)  # it stays in presliding: a spring
    found = loop_of(session, limits, tmp_path, components)
    assert not found.has_closed
    assert 0.08e-3 < np.ptp(session.positions) < 0.09e-3  # what it grows by until a stop has ended stays free


def test_an_axis_that_does_not_move_is_refused(tmp_path: Path, components: Registry) -> None:
    class Still(MasslessSession):
        def play(self, request: PlayRequest) -> Iterator[Chunk]:
            yield from (Chunk(c.start, {**c.channels, "y": 0 * c.channels["y"]}) for c in super().play(request))

    with refused(MachineError, "limits.force"):
        loop_of(Still(), MotionLimits(stroke=1e-3, velocity=1.0, force=5.0), tmp_path, components)


def test_no_level_is_expected_beyond_its_share_of_the_limits(components: Registry) -> None:
    axis = axis_of(MotionLimits(stroke=20e-3, velocity=1.0, force=100.0))
    design = PointDesign(axis, FrictionLoop(10.0, True, 1e-8, 1e-7, 30.0), components)
    below = {0: measured(amplitude=25.0, used=0.4), 1: measured(amplitude=25.0, used=0.1)}
    careful, free = sorted(design.level([5.0, 20.0], 3, 0, below), key=lambda point: point.number)
    assert free.amplitude == pytest.approx(60.0)
    # sliding takes what is above 8 N of friction: 0.63 of the limit where 17 N took 0.4
    assert careful.amplitude == pytest.approx(8 + 17 * 0.63 / 0.4)
    assert [point.number for point in design.level([5.0, 20.0], 0, 7, {})] == [8, 7]


def measured(amplitude: float, used: float) -> MeasuredPoint:
    return MeasuredPoint(0, "", amplitude, 0, 0, 1, 100, (1,), True, None, 1.0, used=used)


def workspace_with(text: str, folder: Path) -> WorkspaceService:
    (folder / "studies").mkdir()
    (folder / "studies" / "axis.toml").write_text(text, encoding="utf-8")
    return WorkspaceService.open(folder)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (STUDY.replace("[limits]", "[numerics]").partition("[numerics]")[0], ["[limits]"]),
        (STUDY + '[grid]\n"loop.noise" = [0.0, 1e-7]\n', ["cases", "grid"]),
        (STUDY.replace('"simulated"', '"simulatd"'), ["[measurement]", "'simulated'"]),
        (STUDY + '[accuracy]\nmagnitude = "0 dB"\n', ["accuracy.magnitude"]),
    ],
)
def test_what_is_missing_is_said_at_once(text: str, names: list[str], tmp_path: Path) -> None:
    with refused(FraexpError, "axis.toml", *names):
        AutonomousService(workspace_with(text, tmp_path), "axis")


def test_units_of_the_machine_are_read_before_it_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = STUDY.replace("linear_motor_table", "rotary_table").replace('noise = "30 nm"', 'sample_time = "0.5 ms"')
    for straight, turning in (("40 mm", "1.5 rad"), ("1 m/s", "10 rad/s"), ("force = 150", 'force = "6 N m"')):
        text = text.replace(straight, turning)
    service = workspace_with(text, tmp_path)
    started: list[Any] = []

    def start(driver: Any, folder: Path) -> MachineSession:
        started.append(driver)
        raise MachineError("started")

    monkeypatch.setattr("fraexp_plugins.machines.simulated.SimulatedMachine.connect", start)
    with refused(MachineError, "started"):
        list(AutonomousService(service, "axis").measure())
    assert started[0].loop["sample_time"] == 0.5e-3
    assert started[0].loop["rotary"] is True
    assert started[0].plant["rigid_body_gain"] == 20.0


@pytest.mark.thorough
def test_plant_and_friction_are_found_behind_the_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(autonomous_points, "MODE_OFFSETS", (-1.0, 1.0))
    monkeypatch.setattr(autonomous_points, "COARSE_POINTS", 14)
    workspace = workspace_with(STUDY + '[accuracy]\nmagnitude = "0.4 dB"\n', tmp_path)
    service = AutonomousService(workspace, "axis")
    events = list(service.measure())
    assert service.is_good, service.result
    assert service.result is not None
    assert read(service.path)["accuracy"]["magnitude"] == 0.4
    metrics: dict[str, Any] = {metric.name: metric.value for metric in service.result.metrics}
    assert metrics["k0"] == pytest.approx(0.132, rel=0.01)
    assert metrics["f1"] == pytest.approx(38.8, abs=0.2)
    assert metrics["Coulomb force"] == pytest.approx(17.9, rel=0.03)
    assert max(point.used for point in service.files.points()) <= 1
    again = AutonomousService(workspace, "axis")
    played, anew = (
        [event for event in of if not isinstance(event, EvaluationProgress)] for of in (events, again.measure())
    )
    assert len(anew) < len(played) / 10  # nothing is played twice
    assert again.is_good


def test_a_stroke_that_was_exceeded_does_not_count_for_the_next_play() -> None:
    guard = MotionGuard(MotionLimits(stroke=1e-3, velocity=10.0, force=10.0), 1e-3)
    guard.begin(0.0)
    assert "stroke" in str(guard.look(chunk_to(2e-3)))
    guard.begin(0.0)
    assert guard.look(chunk_to(0.45e-3)) is None
    guard.begin(0.0)
    assert "stroke" in str(guard.look(chunk_to(-0.6e-3)))  # but that of a play within the limits does


def chunk_to(position: float) -> Chunk:
    return Chunk(0, {"y": np.linspace(0.0, position, 100), "u": np.zeros(100)})
