"""Controllers of stored sweeps as code: they run the machine as the study does."""

import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import fraexp
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.data.results import Fit, Outcome, Result
from fraexp.errors import FraexpError
from fraexp.store import StoredSweep
from fraexp.workspace.controller_export import controller_parts, export_controller
from fraexp.workspace.workspace_service import WorkspaceService
from tests.components.translation.compiled import STRICT, CompiledBlocks, needs_gcc
from tests.components.translation.grammar import grammar_error
from tests.components.translation.structured_text import Machine
from tests.examples import thorough
from tests.refusals import refused

Sweeps = dict[str, tuple[StoredSweep, Result]]
Nominal = tuple[WorkspaceService, StoredSweep, Result]


def run_study(
    folder: Path, checkout: Path, name: str, text: str = "", *overrides: str
) -> tuple[WorkspaceService, Sweeps]:
    """Run a study in a workspace of its own, and return the sweeps with their results by their case."""
    target = folder / "studies" / f"{name}.toml"
    target.parent.mkdir(parents=True, exist_ok=True)
    source = checkout / "studies"
    target.write_text(text or next(source.rglob(f"{name}.toml")).read_text("utf-8"), "utf-8")
    machines = folder / "studies" / "machines"
    if not machines.exists():
        machines.symlink_to(source / "machines")
    workspace = WorkspaceService.open(folder, None)
    for _ in workspace.run([name], "serial", overrides):
        pass
    with workspace.open_store() as store:
        found = {str(sweep.labels.get("case", "")): (sweep, store.result(sweep.key)) for sweep in store.sweeps(1)}
    return workspace, found


@pytest.fixture(scope="module")
def moves(tmp_path_factory: pytest.TempPathFactory, checkout: Path) -> tuple[WorkspaceService, Sweeps]:
    """The study of the paper's Fig 8."""
    return run_study(tmp_path_factory.mktemp("moves"), checkout, "fig08")


@pytest.fixture
def nominal(moves: tuple[WorkspaceService, Sweeps]) -> Nominal:
    workspace, sweeps = moves
    return workspace, *sweeps["nominal, P_d = P"]


@pytest.mark.thorough
@needs_gcc
@pytest.mark.parametrize("case", [thorough("nominal, P_d = P"), "identification error, 177 mm/(N s²) and 41.9 Hz"])
def test_exported_c_runs_the_move_of_fig_8_on_a_machine_that_is_written_apart(
    tmp_path: Path, checkout: Path, moves: tuple[WorkspaceService, Sweeps], case: str
) -> None:
    workspace, sweeps = moves
    sweep, result = sweeps[case]
    export_controller(workspace, sweep, result, tmp_path / "axis.h")
    loop = checkout / "tests" / "workspace" / "positioning_loop.c"
    command = ["gcc", *STRICT, f"-I{tmp_path}", str(loop), "-o", str(tmp_path / "loop"), "-lm"]
    subprocess.run(command, check=True, timeout=120)
    done = subprocess.run([tmp_path / "loop"], capture_output=True, text=True, check=True, timeout=120)
    position = np.array([float(line) for line in done.stdout.split()])
    (curve,) = [curve for curve in result.curves if "position" in curve.columns]
    overshoot = next(metric.value for metric in result.metrics if metric.name == "overshoot")
    assert abs((position.max() - 1.5e-3) - overshoot) <= 0.1e-6 + 1e-12
    assert np.abs(position - curve.columns["position"][: position.size]).max() < 1e-6


@needs_gcc
def test_c_of_a_whole_controller_agrees_with_plain_python(tmp_path: Path, nominal: Nominal) -> None:
    workspace, sweep, result = nominal
    blocks = replace(controller_parts(sweep, result, workspace.registry), force_limit=1e3).blocks()
    assert [block.name for block in blocks] == [
        "friction",
        "observer",
        "smith_delay",
        "feedback",
        "tracking",
        "control",
    ]
    compiled = CompiledBlocks(tmp_path, blocks)
    for block in blocks:
        difference = compiled.run(block.name, block.test_inputs) - block.test_outputs
        assert np.abs(difference).max() <= 1e-12 * np.abs(block.test_outputs).max()


@pytest.mark.thorough
def test_structured_text_of_a_whole_controller_agrees_with_plain_python(tmp_path: Path, nominal: Nominal) -> None:
    workspace, sweep, result = nominal
    export_controller(workspace, sweep, result, tmp_path / "axis.st")
    source = (tmp_path / "axis.st").read_text("utf-8")
    assert grammar_error(source) is None
    plc = Machine(source)
    program = plc.create("axis_self_test")
    assert plc.cycle("axis_self_test", program)["worst_error"] <= 1e-12


def test_moves_follow_one_another_and_a_late_target_waits(nominal: Nominal) -> None:
    workspace, sweep, result = nominal
    control = controller_parts(sweep, result, workspace.registry).blocks()[-1]
    target = np.concatenate([[2e-3], np.full(40, 3e-3), np.full(200, 2.5e-3)])
    course = np.zeros(5)
    states = {name: np.zeros(size) for name, size in control.states.items()} | {"course": course}
    origins = []
    for goal in target.tolist():
        control.function(**states, position=2e-3, target=goal, force_limit=1e3, **control.constants)
        origins.append(course[2])
    assert origins[0] == 2e-3
    assert list(dict.fromkeys(origins)) == [2e-3, 3e-3, 2.5e-3]


def test_the_observer_gives_the_thrust_that_moves_the_plant(nominal: Nominal) -> None:
    """On the simulated machine û_e is the acceleration's force: without friction and delay, as the paper's eq (2)."""
    workspace, sweep, result = nominal
    observer = controller_parts(sweep, result, workspace.registry).blocks()[1]
    (curve,) = [curve for curve in result.curves if "position" in curve.columns]
    thrust, position = curve.columns["thrust"], curve.columns["position"]
    effective = observer.run(np.column_stack([thrust, position]))
    late = np.concatenate([np.zeros(2), thrust[:-2]])
    held = 0.5 * (late + np.concatenate([[0.0], late[:-1]]))
    moving = slice(10, 70)
    assert np.abs(held[moving] - effective[moving]).max() > 15.0  # friction is taken off
    planned = controller_parts(sweep, result, workspace.registry).feedforward
    assert planned is not None
    ideal = np.concatenate([np.zeros(2), planned.thrust[:-2]]) * 1.5e-3
    ideal = 0.5 * (ideal + np.concatenate([[0.0], ideal[:-1]]))
    assert np.abs(effective[moving] - ideal[moving]).max() < 1.5  # N of 60 N: the encoder's steps, and friction between


def test_the_limit_is_that_of_the_study_once_it_states_one(tmp_path: Path, nominal: Nominal) -> None:
    workspace, sweep, result = nominal
    study = workspace.folder / "studies" / "fig08.toml"
    before = study.read_text("utf-8")
    for text, expected in ((before, "is not known: state it"), (f"{before}\n[limits]\nforce = 250\n", "LIMIT 250.0")):
        study.write_text(text, "utf-8")
        export_controller(workspace, sweep, result, tmp_path / "axis.h", force=True)
        assert expected in (tmp_path / "axis.h").read_text("utf-8")
    study.write_text(before, "utf-8")


@pytest.mark.parametrize("suffix", [".c", thorough(".st")])
def test_what_cannot_be_written_leaves_no_file(tmp_path: Path, nominal: Nominal, suffix: str) -> None:
    workspace, sweep, result = nominal
    taken = tmp_path / f"axis{suffix}"
    taken.write_text("mine", "utf-8")
    with refused(FraexpError, taken.name, "--force"):
        export_controller(workspace, sweep, result, taken)
    assert taken.read_text("utf-8") == "mine"
    nothing = replace(sweep, experiment={"source": "record"}, estimator={"name": "conventional"})
    with refused(FraexpError, f"none{suffix}"):
        export_controller(workspace, nothing, result, tmp_path / f"none{suffix}")
    assert [file.name for file in tmp_path.iterdir()] == [taken.name]


def test_an_identified_law_comes_before_the_given_one(nominal: Nominal) -> None:
    workspace, sweep, result = nominal
    dahl = {"name": "dahl", "version": 1, "stiffness": 2e5, "coulomb_force": 5.0, "viscous_coefficient": 0.0}
    fit = Fit("friction", dahl, (), (), np.empty(0), np.empty((0, 0)))
    parts = controller_parts(sweep, replace(result, fits=(fit,)), workspace.registry)
    assert parts.friction is not None
    assert parts.friction.name == "dahl"


@pytest.mark.thorough
def test_command_line_and_python_write_the_same_code(tmp_path: Path, nominal: Nominal) -> None:
    workspace, sweep, _ = nominal
    fraexp.Workspace(workspace.folder).sweep(sweep.key[4:12]).export(tmp_path / "axis.st")
    by_command = tmp_path / "command" / "axis.st"
    by_command.parent.mkdir()
    arguments = ["--workspace", str(workspace.folder), "export", sweep.key[4:12], "-o", str(by_command)]
    assert main(arguments) == 0
    assert by_command.read_bytes() == (tmp_path / "axis.st").read_bytes()
    assert main([*arguments, "--single", "--force"]) == 0
    assert "LREAL" not in by_command.read_text("utf-8")


def test_a_controller_for_each_of_several_thrusts_is_refused_with_what_to_do(registry: Registry) -> None:
    pid = {"name": "pid", "proportional": 1e3}
    sweep = SimpleNamespace(experiment={"controller": {"left": pid, "right": pid}}, estimator={"name": "conventional"})
    with refused(FraexpError, "left, right", "[controller]", "loop.thrust"):
        controller_parts(cast(StoredSweep, sweep), Result(Outcome.OK), registry)
