"""The time that a run is expected to take follows from what like sweeps took."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.execution.events import Finished, Planned, Progress, TimeLeft
from fraexp.execution.run_time import MAX_LIKE_SWEEPS, RunTime, choose_executor, likeness, run_time_of
from fraexp.store import Store
from fraexp.workspace.workspace_service import WorkspaceService
from tests.trouble import study, trouble, write_plugin


def sweep(number: int, estimator: str = "hysteresis") -> Sweep:
    return Sweep({"source": "drive", "friction": {"name": "dahl", "x": number}}, {"name": estimator, "version": 1})


def grid(count: int, first: int = 0, estimator: str = "hysteresis") -> list[Sweep]:
    return [sweep(first + number, estimator) for number in range(count)]


def stored_times(folder: Path, sweeps: Sequence[Sweep], seconds: float) -> Store:
    store = Store.open(str(folder / "results.db"), create=True)
    run = store.begin_run("study", "f", "c", {}, sweeps)
    store.save(run, [(one, Result(Outcome.OK, elapsed=seconds), {}) for one in sweeps])
    return store


def test_stored_sweeps_of_the_same_components_tell_the_time(tmp_path: Path) -> None:
    with stored_times(tmp_path, grid(20), 0.5) as store:
        assert run_time_of(grid(40, 100), store).left(workers=1) == TimeLeft(20.0, MAX_LIKE_SWEEPS, 0)
        assert run_time_of(grid(40, 100), store).left(workers=4) == TimeLeft(5.0, MAX_LIKE_SWEEPS, 0)
        assert run_time_of(grid(40, 100, "h1"), store).left(workers=1) == TimeLeft(None, 0, 40)
        assert run_time_of([*grid(2), *grid(3, 0, "h1")], store).left(workers=1) == TimeLeft(1.0, MAX_LIKE_SWEEPS, 3)
        assert run_time_of([], store).left(workers=1) == TimeLeft(0.0, 0, 0)
    assert run_time_of(grid(40), None).left(workers=1) == TimeLeft(None, 0, 40)


def test_computed_sweeps_displace_stored_ones_and_a_first_one_that_compiles_tells_nothing() -> None:
    sweeps = grid(300)
    time = RunTime(sweeps, {likeness(sweeps[0]): [0.01] * 50})
    time.finish(sweeps[0], 20.0)
    assert time.left(workers=1).seconds == pytest.approx(2.99)
    for one in sweeps[1:11]:
        time.finish(one, 1.0)
    assert time.left(workers=2).seconds == pytest.approx(289 / 2)


def test_what_runs_counts_for_the_rest_of_it_and_no_sweep_is_divided() -> None:
    sweeps = grid(4)
    time = RunTime(sweeps, {likeness(sweeps[0]): [10.0]})
    assert time.left(8, [(one, 0.75) for one in sweeps]).seconds == pytest.approx(2.5)
    assert time.left(8, [(sweeps[0], 0.75)]).seconds == pytest.approx(10.0)
    for one in sweeps:
        time.finish(one)
    assert time.left(8) == TimeLeft(0.0, 0, 0)


def test_processes_are_started_unless_the_run_is_known_to_be_short() -> None:
    sweeps = grid(40)
    assert choose_executor(sweeps[:2], TimeLeft(3.0, 3, 0)) == "serial", "two workers save less than their start"
    assert choose_executor(sweeps, TimeLeft(0.5, 3, 1)) == "processes"
    assert choose_executor(sweeps, TimeLeft(None, 0, 40)) == "processes"
    assert choose_executor(sweeps, TimeLeft(60.0, 3, 0)) == "processes"
    assert choose_executor(sweeps[:1], TimeLeft(None, 0, 1)) == "serial", "it has one job"


def test_a_run_tells_its_remaining_time_within_a_factor_of_two(tmp_path: Path) -> None:
    write_plugin(tmp_path / "plugins")
    (tmp_path / "studies").mkdir()
    slow = trouble("time.sleep(0.03)")
    (tmp_path / "studies" / "slow.toml").write_text(study(30, slow))
    service = WorkspaceService.open(tmp_path, None)
    events = list(service.run(["slow"], "serial"))
    finished = [event.sweep.key for event in events if isinstance(event, Finished)]
    with service.open_store() as store:
        elapsed = {key: result.elapsed for key, result in store.results(finished).items()}
    done, told = 0, 0
    for event in events:
        done += isinstance(event, Finished)
        if isinstance(event, Planned):
            assert event.time == TimeLeft(None, 0, 60)
        if isinstance(event, Progress) and 10 <= done <= 50:
            rest = sum(elapsed[key] for key in finished[done:])
            assert event.time.seconds is not None
            assert rest / 2 < event.time.seconds < 2 * rest, f"after {done} of 60"
            assert event.time.unlike == 0
            told += 1
    assert told > 2
    (tmp_path / "studies" / "slow.toml").write_text(study(40, slow, least=2e-6))
    (planned,) = service.plan("slow")[1]
    warm = [elapsed[key] for key in finished[2:]]  # before them libraries are loaded
    expected = planned.missing * sum(warm) / len(warm)
    assert expected / 2 < planned.time.seconds < 2 * expected
