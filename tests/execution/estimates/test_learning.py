"""What runs teach about the speed of their machine."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from fraexp.components.registry import Registry
from fraexp.data.results import EFFORT, Metric, Outcome, Result, Timing
from fraexp.data.sweep import Sweep
from fraexp.execution.estimates.estimate import SERIAL, work_seconds
from fraexp.execution.estimates.learning import Lessons
from fraexp.execution.estimates.run_times import MAX_START_RATIO, RunTimes, add_run_ratios
from fraexp.execution.estimates.speeds import Speeds, read_speeds, save_ratios, speeds_file
from fraexp.execution.estimates.workload import estimator_work, experiment_work
from fraexp.execution.events import Ended, Planned
from fraexp.kernels.cache_folder import CACHE_FOLDER_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

WARM, COLD = (True, True), (False, False)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CACHE_FOLDER_VARIABLE, str(tmp_path / "cache"))
    for place in (
        "fraexp.execution.estimates.estimate.slowdown",
        "fraexp.execution.estimates.run_times.slowdown",
    ):  # as if nothing else were to do
        monkeypatch.setattr(place, lambda processes: 1.0)


@pytest.fixture(scope="module")
def sweeps() -> Sequence[Sweep]:
    (study,) = WorkspaceService.open(".").studies(["quick"])
    return study.sweeps


def result(
    sweep: Sweep, registry: Registry, slower: float, settling: float = 1.0, is_warm: tuple[bool, bool] = WARM
) -> Result:
    """Return the result of a machine so many times slower than the reference core, of a loop that settles later."""
    counted = experiment_work(sweep.experiment, registry)
    own = estimator_work(sweep.estimator, sweep.experiment, counted.shape, registry)
    loop, *others = counted.work
    experiment = slower * (settling * loop.seconds + work_seconds(others, Speeds()))
    estimator = slower * work_seconds(own, Speeds())
    measuring = Metric(EFFORT[2], settling * counted.rows * counted.sample_time, "s")
    return Result(Outcome.OK, metrics=(measuring,), timing=Timing(experiment, 2, estimator, is_warm))


def test_speed_and_settling_are_told_apart(sweeps: Sequence[Sweep], registry: Registry) -> None:
    save_ratios({}, ["loop/rolling/lanes", "drive/rolling/lanes"])
    lessons = Lessons(registry)
    for sweep in sweeps:
        lessons.add(sweep, result(sweep, registry, 3.0, settling=5.0))
    lessons.save_speeds(SERIAL)
    found = read_speeds()
    assert found.ratio("settling/stepped_sine/rolling") == pytest.approx(5.0, rel=0.01)
    assert found.ratio("loop/rolling/lanes") == pytest.approx(3.0, rel=0.01)
    assert found.ratio("estimate/conventional") == pytest.approx(3.0, rel=0.01)


def test_what_was_loading_or_compiling_tells_no_speed(sweeps: Sequence[Sweep], registry: Registry) -> None:
    lessons = Lessons(registry)
    lessons.add(sweeps[0], result(sweeps[0], registry, 900.0, is_warm=COLD))
    lessons.save_speeds(SERIAL)
    found = read_speeds()
    assert not {"loop/rolling/lanes", "estimate/conventional"} & set(found.ratios)
    assert any(kernel.startswith("loop/rolling/lanes/") for kernel in found.kernels), (
        "but the next plan knows that it is compiled"
    )


def test_failed_sweeps_and_stored_ones_teach_nothing(sweeps: Sequence[Sweep], registry: Registry) -> None:
    lessons = Lessons(registry)
    lessons.add(sweeps[0], None)
    lessons.add(sweeps[0], Result(Outcome.OK))
    lessons.save_speeds(SERIAL)
    assert not speeds_file().exists()


def times(
    took: float, computing: float, executor: str = SERIAL, count: int = 4, kernels: Sequence[str] = ()
) -> RunTimes:
    return RunTimes(took, executor, count, computing, 0.0, frozenset(kernels))


def learned(run: RunTimes, before: Speeds) -> dict[str, list[float]]:
    kinds = ("compile/shared", "compile/loop", "compile/drive", "start_serial", "start_processes", "sweep", "parallel")
    ratios: dict[str, list[float]] = {kind: [] for kind in kinds}
    add_run_ratios(run, before, before, ratios)
    return {kind: found for kind, found in ratios.items() if found}


def test_a_short_run_tells_how_long_starting_takes() -> None:
    (found,) = learned(times(took=1.6, computing=0.1), Speeds())["start_serial"]
    assert found == pytest.approx(2.0, rel=0.1)
    assert set(learned(times(4.0, 1.0, "processes:2"), Speeds())) == {"start_processes"}


def test_a_first_run_tells_how_long_compiling_takes() -> None:
    found = learned(times(took=13.0, computing=0.1, kernels=["loop/a/lanes"]), Speeds())
    assert set(found) == {"compile/loop", "compile/shared"}
    assert found["compile/loop"][0] == pytest.approx(2.0, rel=0.1)
    there = learned(times(took=1.6, computing=0.1, kernels=["loop/a/lanes"]), Speeds())
    assert set(there) == {"start_serial"}, "it was compiled before, without our knowing"


def test_a_start_that_took_very_long_was_none() -> None:
    assert not learned(times(took=2 * MAX_START_RATIO, computing=0.1), Speeds())


def test_long_runs_tell_how_work_is_stored_and_divided() -> None:
    (stored,) = learned(times(took=10.0, computing=8.0, count=250), Speeds())["sweep"]
    assert stored == pytest.approx(2.0, rel=0.01), "8 ms instead of 4 ms"
    (divided,) = learned(times(took=61.6, computing=100.0, executor="processes:2"), Speeds())["parallel"]
    assert divided == pytest.approx(1.2, rel=0.01)


@pytest.mark.thorough
def test_a_plan_uses_what_earlier_runs_have_taught(tmp_path: Path) -> None:
    arguments = ["excitation.points=40", "grid.excitation.amplitude=[10.0, 20.0, 30.0]"]

    def run(folder: str) -> Planned:
        (tmp_path / folder).mkdir()
        events = list(WorkspaceService.open(tmp_path / folder).run(["quick"], SERIAL, arguments))
        assert isinstance(events[-1], Ended)
        return next(event for event in events if isinstance(event, Planned))

    first, second = run("first"), run("second")
    known = read_speeds()
    assert first.seconds is not None
    assert second.seconds is not None
    assert first.compiling > 0 == second.compiling
    assert {"loop/rolling/lanes", "estimate/effective_input", "estimate/conventional", "figure"} <= set(known.ratios)
    data = json.loads(speeds_file().read_text())
    slower = {kind: [log + 1.0, runs] for kind, (log, runs) in data["ratios"].items()}
    then = WorkspaceService.open(tmp_path).plan("quick", arguments, executor=SERIAL)[1][0].seconds
    speeds_file().write_text(json.dumps({**data, "ratios": slower}))
    now = WorkspaceService.open(tmp_path).plan("quick", arguments, executor=SERIAL)[1][0].seconds
    assert then is not None
    assert now is not None
    assert now > 2 * then


def test_learning_never_ends_a_run(
    sweeps: Sequence[Sweep], registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    lessons = Lessons(registry)
    lessons.add(sweeps[0], result(sweeps[0], registry, 1.0))
    monkeypatch.setattr("fraexp.execution.estimates.learning.experiment_work", lambda *_: 1 / 0)
    lessons.save_speeds(SERIAL)
