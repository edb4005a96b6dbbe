"""What is said of the columns of a record that was played: each wrong one is named, and no right one is doubted."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_machines import LAWS, drawn_machine

from fraexp.components.kinds import Excitation
from fraexp.components.registry import Registry, create
from fraexp.data.results import Outcome
from fraexp.data.signals import Signals
from fraexp.errors import LimitError, MachineError, RecordError
from fraexp.measurement import measurement_plan
from fraexp.measurement.excitation_files import ExcitationTable, excitation_table
from fraexp.measurement.measurement_plan import MeasurementPlan, plan_points, planning_setup
from fraexp.measurement.tasks import MeasurementTask
from fraexp.records.loop_equation import WRONG
from fraexp.simulation.experiment_run import LiveLoop, live_setup
from fraexp.simulation.experiments import Experiment
from fraexp.simulation.machine import build_machine
from fraexp.simulation.motion_limits import Demand, MotionLimits
from fraexp.study.accuracy import Accuracy
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_service import WorkspaceService
from tests.measurement.conftest import STUDY
from tests.measurement.played_axes import CORRUPTIONS, RIGHT, Array, is_doubted, load_record, section_of, write_record
from tests.refusals import refused

SECTIONS = ("plant", "friction", "controller", "loop", "numerics")


class Played:
    """A play of the study's machine: excitation, control input and position, and what its study says of it."""

    def __init__(self, folder: Path) -> None:
        (folder / "studies").mkdir()
        (folder / "studies" / "axis.toml").write_text(STUDY, encoding="utf-8")
        workspace = WorkspaceService.open(folder)
        service = MeasurementService(workspace, "axis")
        table, experiment = excitation_table(service.plans()[0]), service.tasks[0].experiment
        self.registry, self.file = workspace.registry, folder / "studies" / "axis-record.csv"
        self.section = service.record_study(self.file, table, force=False)[1]["record"]
        self.excitation = table.columns()["excitation"]
        self._setup = live_setup({name: experiment[name] for name in SECTIONS}, folder)
        self.u, self.y = self.recorded(self.excitation)

    def recorded(self, excitation: Array) -> tuple[Array, Array]:
        played = LiveLoop(self._setup).play(excitation)
        return played["u"], played["y"]

    def signals(self, u: Array, y: Array, **changes: Any) -> Signals:
        write_record(self.file, u, y)
        return load_record(self.file, {**self.section, **changes}, self.registry)

    def message(self, u: Array, y: Array, **changes: Any) -> str:
        """Return what is wrong with a record, if a response needs the usual accuracy."""
        signals = self.signals(u, y, **changes)
        wrong = tuple(each for each in signals.findings if not 0 < each.error <= Accuracy().relative_error)
        is_unsized = any(each.kind == WRONG and not each.error for each in wrong)
        assert signals.outcome is (Outcome.INACCURATE if is_unsized else Outcome.OK)
        return replace(signals, findings=wrong).message


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return Played(tmp_path_factory.mktemp("played"))


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_wrong_column_is_named(played: Played, name: str) -> None:
    change, message = CORRUPTIONS[name]
    found = played.message(*change(played.excitation, played.u, played.y))
    assert re.search(message, found), found


def test_a_likely_gain_of_the_controller_comes_before_one_of_the_position(played: Played) -> None:
    found = played.message(played.u, 1.5 * played.y)
    assert re.search(
        r"^'y' is 1\.5 times .*; correct record\.controller if its gain is 0\.6667 .* if 'y' is wrong", found
    )


def test_a_drive_at_its_limit_is_named(played: Played) -> None:
    found = played.message(np.clip(played.u, -20, 20), played.y)
    assert re.search("the drive is at its limit: limits ± 20 N; lower excitation.amplitude", found)


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_record_is_not_doubted(played: Played, name: str) -> None:
    assert not played.message(*RIGHT[name](played.u, played.y))


def test_an_excitation_that_came_weaker_does_no_harm_and_another_one_is_named(played: Played) -> None:
    assert not played.message(*played.recorded(0.9 * played.excitation))
    found = played.message(*played.recorded(0.5 * played.excitation))
    assert found.startswith("'u' has 0.5 times the excitation that was written; correct gain and sign of the output")


def test_another_controller_is_said_to_be_another_one(played: Played) -> None:
    controller = {**played.section["controller"], "derivative_time": 0.02}
    found = played.message(played.u, played.y, controller=controller)
    assert found.startswith("'u' is not the excitation minus what the controller makes of 'y', and no factor, delay")
    assert "state the machine's own numbers in record.controller" in found
    assert not played.message(
        played.u, played.y, controller={"name": "pid", **controller, "derivative_time": 0.0566204}
    )


def test_a_record_is_not_trusted_because_what_it_is_compared_with_is_deleted(played: Played) -> None:
    assert "opposite sign" in played.message(-played.u, played.y)
    silent = [{key: value for key, value in one.items() if key != "excitation"} for one in played.section["segments"]]
    for change in ({"controller": None}, {"segments": silent}):
        found = played.signals(-played.u, played.y, **change)
        assert found.outcome is Outcome.INACCURATE
        assert [of.kind for of in found.findings] == ["not verified"]


def table_of(sections: dict[str, Any], registry: Registry) -> ExcitationTable:
    """Return the excitation of a drawn machine as it is written to a file."""
    machine, excitation = build_machine(sections, registry), create(registry, Excitation, sections["excitation"])
    setup = planning_setup(machine)
    periods = enumerate(excitation.periods(setup.sample_time))
    points = plan_points(machine, [Experiment(setup, of, excitation.schedule, k) for k, of in periods], ramp_out=20)
    limits = MotionLimits()
    task = MeasurementTask("drawn", "drawn", "", sections, "", limits, None, ())
    return excitation_table(MeasurementPlan(task, tuple(points), limits))


WEAKLY_SEEN = ("y late", "y early", "u in percent")
"""What may not be seen where the feedback does little, or little at frequencies at which a sample matters."""

WEAK_SHARE = 0.05
SEEN_BY_FEEDBACK = ("excitation as u", "y negated", "y / 1000", "y * 3", "y in mm", "y in counts", "swapped")
"""Part of the excitation below which a feedback is weak, and what may then be unseen, or be taken for another fault."""


@pytest.mark.thorough
@pytest.mark.parametrize("number", [0, 3, 4])
def test_on_drawn_machines(number: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, registry: Registry) -> None:
    still = Demand(0.0, 0.0, 0.0, 0.0, 0.0)  # what a stop asks for takes long, and no limit is near
    monkeypatch.setattr(measurement_plan, "simulate_demands", lambda plays: [still] * len(plays))
    draws = np.random.default_rng([40611, number])
    sections = drawn_machine(number, 40611, LAWS[number % len(LAWS)], (2.5e-4, 5e-4, 1e-3)).sections()
    resolution, noise = 10 ** draws.uniform(-9, -6.5), 10 ** draws.uniform(-9, -7)
    has_steps, has_noise = draws.integers(2, size=2)
    sections["loop"].update(resolution=resolution * has_steps, noise=noise * has_noise, seed=number)
    frequencies = np.geomspace(10.0, sections["excitation"]["frequencies"][-1], 5)
    sections["excitation"].update(frequencies=frequencies.tolist(), min_record_time=0.2)
    table = table_of(sections, registry)
    excitation = table.columns()["excitation"]
    played = LiveLoop(live_setup({name: sections[name] for name in SECTIONS}, tmp_path)).play(excitation)
    section = section_of(tmp_path / "drawn.csv", table, sections["controller"])
    if not np.ptp(played["y"]):
        return  # its encoder shows nothing
    is_weak = np.std(played["u"] - excitation) < WEAK_SHARE * np.std(excitation)
    for name, right in RIGHT.items():
        write_record(tmp_path / "drawn.csv", *right(played["u"], played["y"]))
        found = load_record(tmp_path / "drawn.csv", section, registry)
        assert not is_doubted(found), (name, found.message)
    for name, (change, message) in CORRUPTIONS.items():
        if is_weak and name in SEEN_BY_FEEDBACK:
            continue
        write_record(tmp_path / "drawn.csv", *change(excitation, played["u"], played["y"]))
        try:
            found = load_record(tmp_path / "drawn.csv", section, registry)
        except RecordError:  # what resonates is refused as the input of a stepped sine
            assert name in ("swapped", "u without excitation"), name
            continue
        is_hidden = name == "few rows" or (name == "compensation" and has_noise)
        if is_hidden and found.message.startswith("'u' is not the excitation"):
            continue  # a loss within each period, or noise beside a small motion
        assert re.search(message, found.message) or (name in WEAKLY_SEEN and not found.message), (name, found.message)


PROGRAM = """
import sys
numerator, denominator = {numerator}, {denominator}
errors, answers = [0.0] * len(numerator), [0.0] * len(denominator)
y = v = 0.0
for k, line in enumerate(open(sys.argv[1])):
    w = float(line)
    errors = [-y, *errors[:-1]]
    answer = sum(b * e for b, e in zip(numerator, errors)) - sum(a * c for a, c in zip(denominator[1:], answers))
    answers = [answer, *answers[:-1]]
    u = w + answer
    print({printed}, flush=True)
    for _ in range(10):
        v += (u - 15.0 * v / (abs(v) + 1e-4) - 4.7 * v) / 7.6 * 5e-5
        y += v * 5e-5
"""
"""A mass with friction under the study's controller, simulated by the user's own program."""


def program_of(workspace: WorkspaceService, printed: str, channels: str = '["y", "u"]') -> str:
    """Write the program, and return the override that names it."""
    experiment = workspace.studies(["axis"])[0].sweeps[0].experiment
    parts = build_machine(experiment, workspace.registry).controller.transfer_function(5e-4)
    numerator, denominator = (part.tolist() for part in parts)
    text = PROGRAM.format(numerator=numerator, denominator=denominator, printed=printed)
    (workspace.folder / "axis.py").write_text(text, encoding="utf-8")
    return f'measurement.machine={{name="command", program=["python3", "axis.py", "{{file}}"], channels={channels}}}'


LOOSE = (
    "limits.stroke=1e6", "limits.velocity=1e9", "limits.force=1e6", "excitation.frequencies=[38.8, 100.0]",
    'grid.estimator=[{name="conventional"}]',
)  # fmt: skip


@pytest.mark.parametrize(
    ("printed", "message"), [("f'{y!r},{u!r}'", ""), ("f'{u!r},{y!r}'", "'u' and 'y' are swapped")]
)
def test_measured_records_are_compared_like_imports(workspace: WorkspaceService, printed: str, message: str) -> None:
    service = MeasurementService(workspace, "axis", (program_of(workspace, printed), *LOOSE), is_trusted=True)
    points = [event for event in service.measure_points() if isinstance(event, PointEstimated)]
    assert len(points) == 2
    (study,) = workspace.studies(["axis-measured"])
    record = study.sweeps[0].experiment["record"]
    assert len(record["controller"]) == 2
    assert all(segment["excitation"] for segment in record["segments"])
    list(workspace.run(["axis-measured"], executor="serial"))
    with workspace.open_store() as store:
        (result,) = store.results([study.sweeps[0].key]).values()
    assert result.message.startswith(message), result.message
    assert (result.outcome is Outcome.OK) == (not message)


def test_a_stop_at_a_limit_names_the_column_that_caused_it(workspace: WorkspaceService) -> None:
    program = program_of(workspace, "f'{1e3 * y!r},{u!r}'")
    service = MeasurementService(workspace, "axis", (program,), is_trusted=True)
    with refused(LimitError, "limits.stroke", "'y'", "1,000 times", "mm", "measurement.machine"):
        list(service.measure_points())


def test_a_friction_compensation_that_keeps_a_play_from_settling_is_named(workspace: WorkspaceService) -> None:
    program = program_of(workspace, "f'{y!r},{u!r}'")
    file = workspace.folder / "axis.py"
    text = file.read_text(encoding="utf-8").replace("y = v = 0.0", "y = v = last = 0.0")
    text = text.replace("    u = w + answer\n", "    u = w + answer + 8.0 * ((y > last) - (y < last))\n    last = y\n")
    file.write_text(text, encoding="utf-8")
    service = MeasurementService(workspace, "axis", (program, *LOOSE), is_trusted=True)
    with refused(MachineError, "'u'", "8 N", "excitation.settling_tolerance"):
        list(service.measure_points())
