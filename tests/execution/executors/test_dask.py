"""Studies on a real Dask cluster: same numbers, unfit workers refused, losses survived, nothing left behind."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed", reason="Dask is not installed: pip install distributed")

from fraexp.cli.exits import ExitCode
from fraexp.data.results import Result
from fraexp.errors import StudyError
from fraexp.execution.events import Finished
from fraexp.execution.executors import ResourceLimits, WorkerLostError, create_workers
from fraexp.execution.sent_jobs import Job
from fraexp.store import Store
from fraexp.workspace.workspace_service import WorkspaceService
from tests.dask_cluster import Cluster, distribution
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S, wait_until

pytestmark = pytest.mark.thorough
PLUGIN = '''
import os
import signal
import time
from pathlib import Path

from fraexp.api import Estimator, Metric, Outcome, Result, param


class Trial(Estimator, name="trial", version=1):
    """Takes its time, and may take its worker with it."""

    seconds: float = param("s", "time that it takes", 0.0)
    deadly: float = param("1", "1 to kill the process", 0.0)

    def estimate(self, signals):
        """Return the greatest displacement."""
        Path("began").touch()
        until = time.monotonic() + self.seconds
        while time.monotonic() < until:
            time.sleep(0.01)
        if self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        value = float(signals.segments[0].channels["displacement"].max())
        return Result(Outcome.OK, metrics=(Metric("greatest", value, "m"), Metric("mark", MARK, "1")))
'''
EXPERIMENT = {
    "source": "drive",
    "loop": {"sample_time": 500e-6},
    "friction": {"name": "dahl", "stiffness": 3.9e5, "coulomb_force": 17.9},
    "excitation": {"name": "displacement_sine", "frequency": 10.0, "amplitude": 1e-4},
}
STUDY = """
title = "Trials"

[loop]
sample_time = 500e-6

[friction]
name = "dahl"
stiffness = 3.9e5
coulomb_force = 17.9

[excitation]
name = "displacement_sine"
frequency = 10.0

[estimator]
name = "trial"

[grid]
"""


def workspace(folder: Path, grid: str = '"excitation.amplitude" = [1e-4, 2e-4, 3e-4]', mark: int = 1) -> Path:
    """Write a workspace with a plugin of its own, and a study that uses it."""
    for part in ("plugins", "studies"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    (folder / "plugins" / "trial.py").write_text(PLUGIN.replace("MARK", f"{mark}.0"))
    (folder / "studies" / "trials.toml").write_text(STUDY + grid)
    return folder


def job(folder: Path, amplitude: float = 1e-4, **parameters: float) -> Job:
    """Return one of the study's jobs."""
    experiment = {**EXPERIMENT, "excitation": {**EXPERIMENT["excitation"], "amplitude": amplitude}}
    return Job(experiment, ({"name": "trial", **parameters},), plugins=str(folder / "plugins"))


def run(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fraexp", "run", *arguments]
    environ = {**os.environ, **environment}
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False, env=environ, timeout=HANG_TIMEOUT_S
    )


def start(folder: Path, cluster: Cluster, **environment: str) -> "subprocess.Popen[str]":
    """Start a run of the trials on a cluster."""
    command = [sys.executable, "-m", "fraexp", "run", "trials", f"--executor=dask:{cluster.address}"]
    environ = {**os.environ, **environment}
    return subprocess.Popen(command, cwd=folder, env=environ, stderr=subprocess.PIPE, text=True)


def results(folder: Path, database: str = "results.db") -> dict[str, object]:
    """Return all that is stored but for the time that it took, down to the last bit."""
    with Store.open(str(folder / database), read_only=True) as store:
        keys = [sweep.key for run in store.runs() for sweep in store.sweeps(run.number)]
        return {key: bits(replace(result, elapsed=0.0)) for key, result in store.results(keys).items()}


def bits(result: Result) -> object:
    def plain(value: object) -> object:
        if isinstance(value, dict):
            return {key: plain(part) for key, part in value.items()}
        if isinstance(value, list | tuple):
            return [plain(part) for part in value]
        return (value.dtype.str, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else repr(value)

    return plain(asdict(result))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler with two workers, for tests that leave it as it is."""
    with Cluster(tmp_path_factory.mktemp("cluster")) as found:
        found.start_worker("one")
        found.start_worker("two")
        yield found


@pytest.fixture
def doomed(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler without workers, for tests that start and break it."""
    (tmp_path / "cluster").mkdir()
    with Cluster(tmp_path / "cluster") as found:
        yield found


def test_the_numbers_are_those_of_a_serial_run_bit_for_bit(cluster, tmp_path):
    workspace(tmp_path)
    quick = ["quick", "--set", "excitation.points=3"]
    for study, place in ((["trials"], cluster.file), (quick, cluster.address)):
        for executor in (f"--executor=dask:{place}", "--executor=serial"):
            told = run(tmp_path, *study, executor, *(["--db=serial.db"] * executor.endswith("serial")))
            assert told.returncode == 0, told.stderr
    assert results(tmp_path) == results(tmp_path, "serial.db")
    assert len(results(tmp_path)) == 7
    assert cluster.tasks() == 0


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("dask:", ["dask:ADDRESS"]),
        ("dask:tcp://somewhere", ["port"]),
        ("dask:text.json", ["text.json", "scheduler file"]),
        ("dask:tcp://127.0.0.1:1", ["tcp://127.0.0.1:1"]),
    ],
)
def test_a_place_without_a_cluster_is_one_line(tmp_path, monkeypatch, name, names):
    monkeypatch.chdir(tmp_path)
    Path("text.json").write_text("no JSON")
    with refused(StudyError, *names):
        create_workers(name, 1)


def test_workers_of_another_version_are_left_out_by_name(doomed, tmp_path):
    doomed.start_worker("old", environment=distribution(tmp_path / "site", "numpy", "1.0"))
    workspace(tmp_path)
    told = run(tmp_path, "trials", f"--executor=dask:{doomed.address}")
    assert told.returncode == ExitCode.USAGE, told.stderr
    last = told.stderr.splitlines()[-1]
    assert f"no worker of Dask at {doomed.address} can compute this study: old (tcp://" in last
    assert f"has numpy 1.0, but {np.__version__} is here; install the same there and restart it" in last
    doomed.start_worker("new")
    told = run(tmp_path, "trials", f"--executor=dask:{doomed.address}")
    assert told.returncode == 0
    assert any(line.startswith("Dask worker old (tcp://") and "is left out: it has numpy 1.0" in line
               for line in told.stderr.splitlines())  # fmt: skip


def test_workers_with_another_source_of_fraexp_are_refused(doomed, tmp_path, checkout):
    site = tmp_path / "site"
    shutil.copytree(checkout / "fraexp", site / "fraexp", ignore=shutil.ignore_patterns("__pycache__"))
    with (site / "fraexp" / "execution" / "job.py").open("a") as source:
        source.write("# changed\n")
    doomed.start_worker("changed", environment={"PYTHONPATH": str(site)})
    with refused(StudyError, "changed", "fraexp.execution.job"):
        create_workers(f"dask:{doomed.address}", 1)


def test_a_worker_without_the_plugin_is_left_out_by_name(doomed, tmp_path):
    site = tmp_path / "site"
    environment = distribution(site, "trials", "1.5", "trials = trial_plugin")
    (site / "trial_plugin.py").write_text(PLUGIN.replace("MARK", "3.0"))
    doomed.start_worker("bare")
    workspace(tmp_path)
    (tmp_path / "plugins" / "trial.py").unlink()
    told = run(tmp_path, "trials", f"--executor=dask:{doomed.address}", **environment)
    assert "bare (tcp://" in told.stderr.splitlines()[-1]
    assert "has no estimator 'trial'; install trials 1.5 there" in told.stderr.splitlines()[-1]
    doomed.start_worker("equipped", environment=environment)
    told = run(tmp_path, "trials", f"--executor=dask:{doomed.address}", **environment)
    assert told.returncode == 0, told.stderr


def test_a_plugin_that_is_edited_between_two_runs_of_a_process_is_computed_as_it_is(cluster, tmp_path):
    cluster.start_worker("only")
    service = WorkspaceService.open(workspace(tmp_path), None)
    for mark in (1, 2):
        workspace(tmp_path, mark=mark)
        service.reload()
        events = list(service.run(["trials"], f"dask:{cluster.address}", rerun="all"))
        found = [event.result for event in events if isinstance(event, Finished) and event.result is not None]
        assert [of.value for result in found for of in result.metrics if of.name == "mark"] == [mark] * 3


def test_what_workers_cannot_read_is_refused_by_name(cluster, tmp_path):
    workspace(tmp_path)
    record = tmp_path / "record.csv"
    experiment = {"source": "record", "record": {"hash": "0", "reader": {"name": "csv"}}}
    lost = replace(job(tmp_path), experiment=experiment, files={"record": str(record)})
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        workers.submit(0, lost)
        with refused(StudyError, record):
            wait_until(lambda: list(workers.reports()))
    record.write_text("1,2")
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        workers.submit(0, lost)
        with refused(StudyError, record):
            wait_until(lambda: list(workers.reports()))
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        workers.submit(0, job(tmp_path)).result(HANG_TIMEOUT_S)
        (tmp_path / "plugins" / "trial.py").rename(tmp_path / "elsewhere.py")
        assert workers.submit(1, job(tmp_path)).result(HANG_TIMEOUT_S), "what is loaded goes on"


def test_a_worker_that_is_killed_costs_one_job_and_others_go_on(doomed, tmp_path):
    workspace(tmp_path)
    first = doomed.start_worker("first")
    with create_workers(f"dask:{doomed.address}", 2, ResourceLimits()) as workers:
        future = workers.submit(0, job(tmp_path, seconds=600))
        wait_until((doomed.folder / "began").exists)
        doomed.kill(first)
        with refused(WorkerLostError, "worker first", "tcp://"):
            future.result(HANG_TIMEOUT_S)
        again = workers.submit(1, job(tmp_path))
        doomed.start_worker("late")
        assert isinstance(again.result(HANG_TIMEOUT_S)[0], Result)


def test_a_worker_that_takes_its_leave_costs_nothing(doomed, tmp_path):
    workspace(tmp_path, '"excitation.amplitude" = [1e-4, 2e-4]\n"estimator.seconds" = [2.0]')
    first = doomed.start_worker("first", "--nanny")
    process = start(tmp_path, doomed)
    wait_until((doomed.folder / "began").exists)
    first.terminate()
    doomed.start_worker("second")
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == 0, told
    assert len(results(tmp_path)) == 2


def test_a_job_that_kills_its_workers_fails_with_its_reason_and_no_other(doomed, tmp_path):
    workspace(tmp_path, '"excitation.amplitude" = [1e-4, 2e-4, 3e-4, 4e-4]')
    deadly = tmp_path / "studies" / "deadly.toml"
    deadly.write_text(STUDY + '"excitation.amplitude" = [8e-4]\n"estimator.deadly" = [0.0, 1.0]')
    doomed.start_worker("nanny", "--nworkers=2")
    told = run(tmp_path, "trials", "deadly", f"--executor=dask:{doomed.address}", "--json")
    assert [(one["state"], one["failed"]) for one in json.loads(told.stdout)["runs"]] == [
        ("complete", 0),
        ("partial", 1),
    ]
    (line,) = [line for line in told.stderr.splitlines() if " failed: " in line]
    assert "its Dask worker nanny-" in line
    assert "the 3rd time; the last time it was computed alone" in line


def test_a_scheduler_that_comes_back_is_given_what_is_missing(doomed, tmp_path):
    workspace(tmp_path)
    worker = doomed.start_worker("first")
    with create_workers(f"dask:{doomed.address}", 5, ResourceLimits()) as workers:
        futures = [workers.submit(n, job(tmp_path, 1e-4 * (n + 1), seconds=0.5)) for n in range(5)]
        futures[0].result(HANG_TIMEOUT_S)
        doomed.kill(doomed.scheduler)
        wait_until(lambda: any("is gone; waiting for it" in note for note in workers.notes()))
        doomed.kill(worker)
        doomed.start_scheduler()
        doomed.start_worker("second")
        assert [len(future.result(HANG_TIMEOUT_S)) for future in futures] == [1] * 5


def test_ctrl_c_leaves_the_cluster_clean(doomed, tmp_path):
    workspace(tmp_path, '"excitation.amplitude" = [1e-4, 2e-4, 3e-4]\n"estimator.seconds" = [2.0]')
    doomed.start_worker("first")
    process = start(tmp_path, doomed)
    wait_until((doomed.folder / "began").exists)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert "stopped by you" in told.splitlines()[-1]
    assert "Traceback" not in told
    wait_until(lambda: doomed.tasks() == 0)
    assert run(tmp_path, "trials", f"--executor=dask:{doomed.address}").returncode == 0


@pytest.mark.parametrize("nanny", ["--no-nanny", "--nanny"])
def test_a_job_beyond_its_time_ends_its_worker(doomed, tmp_path, monkeypatch, nanny):
    workspace(tmp_path)
    monkeypatch.chdir(tmp_path)  # where the plugin notes that it has begun
    with create_workers("serial", 1) as workers:  # which compiles the law
        workers.submit(0, job(tmp_path)).result(HANG_TIMEOUT_S)
    doomed.start_worker("slow", nanny)
    with create_workers(f"dask:{doomed.address}", 1, ResourceLimits(time=8.0)) as workers:
        future = workers.submit(0, job(tmp_path, seconds=600))
        with refused(WorkerLostError, "8 s") as error:
            future.result(HANG_TIMEOUT_S)
        assert not error.value.is_retryable
        again = workers.submit(1, job(tmp_path))
        if nanny == "--no-nanny":
            doomed.start_worker("other")
        assert isinstance(again.result(HANG_TIMEOUT_S)[0], Result)
