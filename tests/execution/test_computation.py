"""What becomes of sweeps whose workers are lost, of sweeps that several runs want, and of a run whose disk is full."""

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.components.registry import Registry
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.execution.computation import Computation, Heartbeat, RunContext
from fraexp.execution.events import Event, Finished
from fraexp.execution.executors import Answer, WorkerLostError, Workers
from fraexp.execution.run_time import RunTime
from fraexp.execution.sent_jobs import Failure, Job
from fraexp.store import Store, StoredSweep
from tests.trouble import study, trouble, write_plugin
from tests.waiting import HANG_TIMEOUT_S, wait_until

ROOT = Path(__file__).parents[2]
Answering = Callable[[Job, int], Answer | Exception]


class Scripted(Workers):
    """Workers that answer at once what a function says of a job and of how many others were under way."""

    def __init__(self, answering: Answering, count: int = 4) -> None:
        super().__init__()
        self.count = count
        self._answering = answering
        self._open: list[tuple[Job, Future[Answer]]] = []
        self.sent: list[tuple[Job, int]] = []

    def submit(self, number: int, job: Job) -> "Future[Answer]":
        future: Future[Answer] = Future()
        self._open.append((job, future))
        self.sent.append((job, len(self._open)))
        return future

    def reports(self) -> Iterator[tuple[int, float]]:
        under_way, self._open = self._open, []
        for job, future in under_way:
            found = self._answering(job, len(under_way))
            if isinstance(found, Exception):
                future.set_exception(found)
            else:
                future.set_result(found)
        return iter(())

    def stop(self) -> None:
        """Do nothing."""

    close = stop


def grid(experiments: int, estimators: Sequence[str] = ("h1",)) -> list[Sweep]:
    return [
        Sweep({"source": "drive", "n": n}, {"name": name, "version": 1}, {})
        for n in range(experiments)
        for name in estimators
    ]


def good(job: Job) -> Answer:
    return [Result(Outcome.OK)] * len(job.estimators)


def computed(path: Path, sweeps: Sequence[Sweep], workers: Workers) -> tuple[list[Event], list[StoredSweep]]:
    with Store.open(str(path / "results.db"), create=True) as store:
        run = store.begin_run("scripted", "scripted.toml", "", {}, sweeps)
        context = RunContext(run, store, Registry(), "", False, RunTime(sweeps, {}))
        heartbeat = Heartbeat(store, run, len(sweeps))
        events = list(Computation(sweeps, context, workers, lambda reference: reference, heartbeat).events())
        assert store.lease_holders([sweep.key for sweep in sweeps]) == {}
        store.end_run(run, "complete")
        return events, store.sweeps(run)


def test_a_sweep_that_is_lost_twice_is_computed_alone_and_may_succeed(tmp_path):
    def answer(job: Job, under_way: int) -> Answer | Exception:
        hungry = job.experiment["n"] == 5 and under_way > 1
        return WorkerLostError("its worker was killed by signal 9 (SIGKILL)") if hungry else good(job)

    workers = Scripted(answer)
    _, sweeps = computed(tmp_path, grid(20), workers)
    assert [sweep.state for sweep in sweeps] == ["computed"] * 20
    assert [under_way for job, under_way in workers.sent if job.experiment["n"] == 5][-1] == 1
    assert len(workers.sent) == 22


def test_a_sweep_that_is_lost_alone_too_has_failed_with_the_reason_and_no_other_has(tmp_path):
    def answer(job: Job, under_way: int) -> Answer | Exception:
        return (
            WorkerLostError("its worker was killed by signal 11 (SIGSEGV)") if job.experiment["n"] == 5 else good(job)
        )

    workers = Scripted(answer)
    events, sweeps = computed(tmp_path, grid(20), workers)
    assert [sweep.state for sweep in sweeps] == [*["computed"] * 5, "failed", *["computed"] * 14]
    assert "killed by signal 11 (SIGSEGV), the 3rd time; the last time it was computed alone" in sweeps[5].message
    assert sum(job.experiment["n"] == 5 for job, _ in workers.sent) == 3
    assert len(workers.sent) == 22  # whoever else was under way was not sent again
    told = [event for event in events if isinstance(event, Finished)]
    assert len(told) == 20


def test_an_estimator_that_costs_workers_fails_alone_where_it_is_known(tmp_path):
    def answer(job: Job, under_way: int) -> Answer | Exception:
        names = [estimator["name"] for estimator in job.estimators]
        return WorkerLostError("died", estimator=names.index("bad")) if "bad" in names else good(job)

    workers = Scripted(answer)
    _, sweeps = computed(tmp_path, grid(1, ["h1", "bad", "h2"]), workers)
    assert [sweep.state for sweep in sweeps] == ["computed", "failed", "computed"]


def test_an_estimator_that_costs_workers_fails_alone_where_it_is_not_known(tmp_path):
    def answer(job: Job, under_way: int) -> Answer | Exception:
        bad = any(estimator["name"] == "bad" for estimator in job.estimators)
        return WorkerLostError("died") if bad else good(job)

    workers = Scripted(answer)
    _, sweeps = computed(tmp_path, grid(1, ["h1", "bad", "h2"]), workers)
    assert [sweep.state for sweep in sweeps] == ["computed", "failed", "computed"]


def test_a_limit_that_is_reached_is_not_tried_again(tmp_path):
    def answer(job: Job, under_way: int) -> Answer | Exception:
        return WorkerLostError("it took longer than the time limit of 3 s", is_retryable=False)

    workers = Scripted(answer)
    _, sweeps = computed(tmp_path, grid(2), workers)
    assert [sweep.message for sweep in sweeps] == ["it took longer than the time limit of 3 s"] * 2
    assert len(workers.sent) == 2


@pytest.mark.thorough
def test_what_is_lost_now_and_then_is_never_blamed_on_a_sweep(tmp_path):
    """Workers that are killed at random, one in ten jobs: a sweep is to lose three times to fail."""
    draw = random.Random(1)

    def answer(job: Job, under_way: int) -> Answer | Exception:
        return WorkerLostError("died") if under_way > 1 and draw.random() < 0.1 else good(job)

    _, sweeps = computed(tmp_path, grid(500), Scripted(answer))
    assert {sweep.state for sweep in sweeps} == {"computed"}


def test_a_failure_is_stored_with_its_log(tmp_path):
    workers = Scripted(lambda job, _: [Failure("no", "the log")])
    _, sweeps = computed(tmp_path, grid(1), workers)
    assert [sweep.message for sweep in sweeps] == ["no"]


STARTED: list[subprocess.Popen[str]] = []


@pytest.fixture(autouse=True)
def nothing_left() -> Iterator[None]:
    """End what a test that fails has left running."""
    yield
    while STARTED:
        process = STARTED.pop()
        process.kill()
        process.communicate()


def begun(folder: Path, text: str, *options: str, **more: object) -> subprocess.Popen[str]:
    """Start a run of a study in a folder with the plugin that makes trouble."""
    write_plugin(folder / "plugins")
    (folder / "studies").mkdir(exist_ok=True)
    (folder / "studies" / "trouble.toml").write_text(text, encoding="utf-8")
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has what runs in the background ignore Ctrl-C
    command = [sys.executable, "-W", "error", "-m", "fraexp", "run", "trouble", "--json", *options]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=folder, env=environment, **pipes, **more)  # type: ignore[call-overload]
    STARTED.append(process)
    return process


def states(folder: Path, run: int) -> list[str]:
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        return [sweep.state for sweep in store.sweeps(run)]


def notes_of(folder: Path) -> Path:
    (folder / "notes").mkdir()
    return folder / "notes"


@pytest.mark.thorough
def test_a_sweep_that_kills_its_worker_fails_after_three_attempts_and_all_others_are_there(tmp_path):
    notes = notes_of(tmp_path)
    deadly = trouble("os.kill(os.getpid(), 9)", folder=str(notes))
    process = begun(tmp_path, study(6, deadly), "--executor=processes:2", "--set=grid.excitation.amplitude=[1e-6]")
    told, _ = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INCOMPLETE
    sweeps = {sweep["labels"]["case"]: sweep for sweep in json.loads(told)["runs"][0]["sweeps"]}
    assert sweeps["trouble 0"]["state"] == "failed"
    assert "killed by signal 9 (SIGKILL)" in sweeps["trouble 0"]["message"]
    assert sweeps["trivial"]["state"] == "computed"
    assert len(list(notes.iterdir())) == 3


@pytest.mark.thorough
def test_a_sweep_that_dies_once_is_computed(tmp_path):
    unlucky = trouble("os._exit(1)", folder=str(notes_of(tmp_path)), times=1)
    process = begun(tmp_path, study(1, unlucky), "--executor=processes:2")
    _, talk = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.OK, talk
    assert states(tmp_path, 1) == ["computed"] * 2


@pytest.mark.thorough
def test_two_runs_at_once_compute_each_sweep_once(tmp_path):
    slow = trouble("time.sleep(0.1)", folder=str(notes_of(tmp_path)))
    runs = [begun(tmp_path, study(24, slow), "--executor=processes:1") for _ in range(2)]
    for process in runs:
        _, talk = process.communicate(timeout=HANG_TIMEOUT_S)
        assert process.returncode == ExitCode.OK, talk
    found = [states(tmp_path, 1), states(tmp_path, 2)]
    assert all(sorted(pair) == ["computed", "reused"] for pair in zip(*found, strict=True))
    assert len(list((tmp_path / "notes").iterdir())) == 24


@pytest.mark.thorough
def test_what_a_run_that_is_killed_had_claimed_is_taken_over_at_once(tmp_path):
    notes = notes_of(tmp_path)
    text = study(12, trouble("time.sleep(3600)", folder=str(notes), times=1))
    stuck = begun(tmp_path, text, "--executor=serial")
    wait_until(lambda: list(notes.iterdir()))
    other = begun(tmp_path, text, "--executor=serial")
    while "waiting for sweeps that run 1 computes" not in (line := other.stderr.readline()):
        assert line
    stuck.kill()
    stuck.communicate()
    _, talk = other.communicate(timeout=HANG_TIMEOUT_S)
    assert other.returncode == ExitCode.OK, talk
    assert set(states(tmp_path, 2)) <= {"computed", "reused"}
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        assert [run.state for run in store.runs()] == ["complete", "interrupted"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs limits of the system")
@pytest.mark.thorough
def test_a_disk_that_is_full_ends_the_run_in_one_line_and_loses_nothing(tmp_path):
    import resource

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (900_000, 900_000))

    process = begun(tmp_path, study(4000), "--executor=processes:1", preexec_fn=limited)
    told, talk = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.STORE, talk
    assert "disk" in json.loads(told)["error"]["message"]
    (line,) = [line for line in talk.splitlines() if line.startswith("fraexp: ")]
    assert "disk" in line
    assert "Traceback" not in talk
    with Store.open(str(tmp_path / "results.db")) as store:
        assert store.health() == "sound"
        assert [run.state for run in store.runs()] in ([], ["interrupted"])
    process = begun(tmp_path, study(4000), "--executor=processes:1")
    _, talk = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.OK, talk


@pytest.mark.thorough
def test_a_law_that_never_returns_can_be_interrupted_and_is_ended_by_the_time_limit(tmp_path):
    process = begun(tmp_path, study(1, friction="endless"), "--executor=serial")
    process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.OK  # the law is compiled, and returns from small steps
    text = study(1, friction="endless", least=10.0)
    process = begun(tmp_path, text, "--executor=serial")
    wait_until(lambda: begins(tmp_path, 2))
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INTERRUPTED
    assert states(tmp_path, 2) == ["pending"]
    for executor in ("serial", "processes:1"):
        process = begun(tmp_path, text, f"--executor={executor}", "--time-limit=3")
        _, talk = process.communicate(timeout=HANG_TIMEOUT_S)
        assert process.returncode == ExitCode.INCOMPLETE
        assert "failed: it took longer than the time limit of 3 s; see --time-limit" in talk


def begins(folder: Path, run: int) -> bool:
    """Say whether a run has told that it computes."""
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        newest = store.runs()[0]
    return newest.number == run and newest.progress is not None
