"""How long a run is expected to take, and by which executor."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fraexp.components.registry import Registry, discover
from fraexp.data.sweep import Sweep
from fraexp.execution.estimates import estimate as estimates
from fraexp.execution.estimates.compile_time import compile_seconds
from fraexp.execution.estimates.estimate import (
    PROCESSES,
    SERIAL,
    EstimatedTask,
    Workload,
    count_workload,
    estimate,
    known_seconds,
    law_hash_lookup,
)
from fraexp.execution.estimates.group_sampling import MAX_EXPERIMENTS, SAMPLED_SWEEPS, sampled_groups
from fraexp.execution.estimates.speeds import Speeds
from fraexp.execution.estimates.work import Work
from fraexp.execution.executors import ResourceLimits
from fraexp.views.pace import expected_time_text
from fraexp.workspace.workspace_service import WorkspaceService

SOURCE = law_hash_lookup(discover())("rolling")
KERNELS = frozenset(f"{family}/rolling/lanes/{SOURCE}" for family in ("loop", "drive"))
KNOWN = Speeds(kernels=KERNELS)


@pytest.fixture(autouse=True)
def idle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the machine have nothing else to do."""
    monkeypatch.setattr("fraexp.execution.estimates.estimate.slowdown", lambda processes: 1.0)


def sweeps(*overrides: str) -> tuple[Sweep, ...]:
    (study,) = WorkspaceService.open(".").studies(["quick"], overrides)
    return study.sweeps


def amplitudes(count: int) -> str:
    return f"grid.excitation.amplitude={[10.0 + 0.01 * number for number in range(count)]}"


def test_what_is_shared_is_computed_once(registry: Registry) -> None:
    found = count_workload(sweeps(), registry)
    assert [len(batch) for batch in found.batches] == [2], "two amplitudes"
    assert [task.sweeps for task in found.batches[0]] == [2, 2], "two estimators of each"


@pytest.mark.thorough
def test_a_large_study_is_counted_by_a_sample(registry: Registry) -> None:
    few, many = (sampled_groups(sweeps(amplitudes(count))) for count in (MAX_EXPERIMENTS, 500))
    assert [group.weight for group in few] == [1.0] * MAX_EXPERIMENTS
    assert len(many) == pytest.approx(MAX_EXPERIMENTS, abs=2)
    assert sum(group.weight for group in many) == pytest.approx(500)
    speeds = Speeds()
    one, ten = (estimate(sweeps(amplitudes(count)), registry, speeds, SERIAL) for count in (50, 500))
    start = estimate(sweeps(amplitudes(1)), registry, speeds, SERIAL)
    assert (ten.seconds - start.seconds) / (one.seconds - start.seconds) == pytest.approx(499 / 49, rel=0.1)


@pytest.mark.thorough
def test_of_very_many_sweeps_a_few_groups_stand_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.estimates.group_sampling.MAX_GROUPED", 500)
    axis = amplitudes(500)
    found = sweeps(axis)
    groups = sampled_groups(found)
    assert len(groups) <= SAMPLED_SWEEPS
    assert {len(group.sweeps) for group in groups} == {2}
    assert sum(group.weight * len(group.sweeps) for group in groups) == pytest.approx(len(found))
    assert [group.weight for group in sampled_groups(sweeps(axis))] == [group.weight for group in groups]


@pytest.mark.parametrize("most", [10, 20_000])
def test_what_is_drawn_is_shared_by_estimators_too(most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.estimates.group_sampling.MAX_GROUPED", most)
    file = tmp_path / "drawn.toml"
    text = (Path(__file__).parents[3] / "studies" / "quick.toml").read_text()
    draw = '{ paths = "plant.rigid_body_gain", relative = 0.01 }'
    file.write_text(f"{text}\n[monte_carlo]\ncount = 50\ndraw = [{draw}]\n")
    (study,) = WorkspaceService.open(tmp_path).studies([str(file)])
    groups = sampled_groups(study.sweeps)
    assert len(study.sweeps) == 2 * 2 * 50
    assert {len(group.sweeps) for group in groups} == {2}
    assert sum(group.weight for group in groups) == pytest.approx(100)


@pytest.mark.thorough
def test_a_few_slow_sweeps_among_many_are_not_overlooked(registry: Registry) -> None:
    (slow,) = (study.sweeps for study in WorkspaceService.open(".").studies(["identification/friction_triangle"]))
    found = sampled_groups([*sweeps(amplitudes(1000)), *slow])
    kinds = [str(group.sweeps[0].experiment["excitation"]["name"]) for group in found]
    assert "slow_triangle" in kinds


def task(seconds: float, weight: float = 1.0) -> EstimatedTask:
    return EstimatedTask((Work("estimate/x", seconds),), (), 1.0, weight, 1)


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let starting and storing take no time."""
    monkeypatch.setattr(estimates, "known_seconds", lambda name, speeds: 0.0)


@pytest.mark.usefixtures("free")
def test_workers_share_tasks_but_none_is_cut_in_two() -> None:
    def seconds(executor: str, *batches: list[EstimatedTask]) -> float:
        return Workload(batches, lambda name: "").seconds(executor, Speeds())

    assert seconds("serial", [task(3.0), task(1.0)]) == pytest.approx(4.0)
    assert seconds("processes:2", [task(1.0, weight=8)]) == pytest.approx(4.0)
    assert seconds("processes:2", [task(3.0), task(1.0)]) == pytest.approx(3.0), "the longest one is waited for"
    assert seconds("processes:8", [task(2.0), task(2.0)]) == pytest.approx(2.0), "there are but two"
    assert seconds("processes:2", [task(2.0)], [task(1.0)]) == pytest.approx(3.0), "a batch waits for the one before"


@pytest.mark.thorough
def test_the_faster_executor_is_chosen(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.executors.usable_cores", lambda: 2)
    short, long = sweeps(), sweeps(amplitudes(500))
    assert estimate(short, registry, KNOWN).executor == SERIAL
    assert estimate(long, registry, KNOWN).executor == PROCESSES
    assert estimate(long, registry, KNOWN, SERIAL).executor == SERIAL
    assert estimate(long, registry, KNOWN).seconds < estimate(long, registry, KNOWN, SERIAL).seconds
    assert estimate(short, registry, KNOWN, limits=ResourceLimits(memory=10**9)).executor == PROCESSES
    slow = KNOWN.updated({"start_processes": [20.0], "loop/rolling/lanes": [1.0], "estimate/effective_input": [1.0]})
    assert estimate(long, registry, slow).executor == SERIAL


def test_a_study_that_outlasts_the_start_uses_both_cores(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.executors.usable_cores", lambda: 2)
    (study,) = WorkspaceService.open(".").studies(["identification/friction_laws"])
    assert estimate(study.sweeps, registry, Speeds(), None).executor == PROCESSES


def test_compiling_is_counted_until_it_is_done(registry: Registry) -> None:
    new, known = (estimate(sweeps(), registry, speeds) for speeds in (Speeds(), KNOWN))
    assert known.compiling == 0.0
    assert new.compiling == compile_seconds(KERNELS, Speeds()) > 0
    assert new.seconds == pytest.approx(known.seconds + new.compiling, rel=0.05)
    slower = Speeds().updated({"compile/shared": [3.0], "compile/loop": [3.0], "compile/drive": [3.0]})
    assert compile_seconds(KERNELS, slower) == pytest.approx(3 * new.compiling)
    edited = Speeds(kernels=frozenset(kernel.replace(SOURCE, "before") for kernel in KERNELS))
    assert 0 < estimate(sweeps(), registry, edited).compiling < new.compiling, "what all laws share is there"


def test_a_slow_machine_takes_longer(registry: Registry) -> None:
    slow = KNOWN.updated({"loop/rolling/lanes": [4.0]})
    fast, slow_ = (estimate(sweeps(), registry, speeds, SERIAL) for speeds in (KNOWN, slow))
    assert slow_.seconds == pytest.approx(4 * fast.seconds, rel=0.01), "and so at all that has not been measured"


def test_components_that_nobody_knows_are_a_guess(registry: Registry) -> None:
    strange = [Sweep({"source": "loop", "n": number}, {"name": "strange"}) for number in range(10)]
    found = estimate(strange, registry, Speeds(), SERIAL)
    fixed = known_seconds("start_serial", Speeds()) + known_seconds("figure", Speeds())
    assert 0.5 < found.seconds - fixed < 5


@pytest.mark.parametrize(
    ("seconds", "compiling", "text"),
    [
        (None, 0.0, ""),
        (12.0, 0.0, ", about 12 s"),
        (12.0, 0.4, ", about 12 s"),
        (100.0, 8.0, ", about 1 min 40 s including 8 s for compiling"),
    ],
)
def test_the_estimate_is_told_with_what_is_compiled(seconds: float | None, compiling: float, text: str) -> None:
    assert expected_time_text(seconds, compiling) == text


def test_the_estimate_follows_the_grid(tmp_path: Path) -> None:
    plans: dict[str, Any] = {
        text: WorkspaceService.open(tmp_path).plan("quick", ["excitation.points=400", text], executor=SERIAL)[1][0]
        for text in ("excitation.recorded_periods=1", "excitation.recorded_periods=100")
    }
    one, many = plans.values()
    assert many.seconds > 2 * one.seconds
    assert replace(many, seconds=one.seconds) == one
