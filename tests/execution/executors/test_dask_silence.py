"""Silent clusters: a scheduler or a worker that hangs with its connections open is noticed, told and survived."""

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="Dask is not installed: pip install distributed")

from fraexp.cli.exits import ExitCode
from fraexp.errors import StudyError, UnreachedError
from fraexp.execution.executors import Workers, create_workers
from fraexp.execution.executors.dask import TIMEOUT_VARIABLE
from fraexp.store import Store
from tests.dask_cluster import Cluster
from tests.execution.executors.test_dask import job, results, run, start, workspace
from tests.refusals import refused
from tests.waiting import HANG_TIMEOUT_S, wait_until

SLOW = '"excitation.amplitude" = [1e-4, 2e-4, 3e-4, 4e-4]\n"estimator.seconds" = [1.0]'


@pytest.fixture
def cluster(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Cluster]:
    """A scheduler without workers, for tests that start and break it; they may set its `worker-ttl`."""
    (tmp_path / "cluster").mkdir()
    with Cluster(tmp_path / "cluster", getattr(request, "param", "5 minutes")) as found:
        yield found


def wait_for_words(workers: Workers, words: str) -> None:
    """Wait until the status of workers contains some words."""
    wait_until(lambda: (list(workers.reports()), words in workers.status())[1])


@pytest.mark.thorough
def test_a_silent_scheduler_is_told_and_answers_are_accepted_when_it_is_back(cluster, tmp_path):
    workspace(tmp_path)
    cluster.start_worker("one")
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        future = workers.submit(0, job(tmp_path, seconds=2.0))
        wait_until((cluster.folder / "began").exists)
        cluster.pause(cluster.scheduler)
        wait_for_words(workers, "Dask scheduler silent for 5 s")
        assert not future.done()
        wait_until(lambda: any("is silent; waiting for it up to 120 s" in note for note in workers.notes()))
        cluster.resume(cluster.scheduler)
        assert len(future.result(HANG_TIMEOUT_S)) == 1
        wait_until(lambda: workers.status() == "")
        wait_until(lambda: any("answers again after" in note for note in workers.notes()))


@pytest.mark.thorough
@pytest.mark.parametrize("is_killed", [False, True])
def test_a_scheduler_that_stays_away_ends_the_run_which_can_go_on(cluster, tmp_path, is_killed):
    workspace(tmp_path, SLOW)
    cluster.start_worker("one")
    process = start(tmp_path, cluster, FRAEXP_DASK_TIMEOUT="7s")
    wait_until(lambda: (tmp_path / "results.db").exists() and results(tmp_path))
    (cluster.kill if is_killed else cluster.pause)(cluster.scheduler)
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INCOMPLETE
    state = "gone" if is_killed else "silent"
    assert f"the Dask scheduler at {cluster.address} was {state} for 7 s; what is computed is stored" in told
    assert f"is {state}; waiting for it up to 7 s" in told
    with Store.open(str(tmp_path / "results.db"), read_only=True) as store:
        stored = store.run(1)
    assert stored.state == "partial" and 0 < stored.computed < 4
    if is_killed:
        cluster.start_scheduler()
        cluster.start_worker("second")
    else:
        cluster.resume(cluster.scheduler)
    assert run(tmp_path, "trials", f"--executor=dask:{cluster.address}").returncode == 0
    assert len(results(tmp_path)) == 4


@pytest.mark.thorough
@pytest.mark.parametrize("cluster", ["5s"], indirect=True)
def test_the_jobs_of_a_worker_that_hangs_are_computed_by_another_and_each_is_stored_once(cluster, tmp_path):
    workspace(tmp_path, SLOW)
    hung = cluster.start_worker("hung")
    cluster.start_worker("other")
    process = start(tmp_path, cluster)
    wait_until((cluster.folder / "began").exists)
    cluster.pause(hung)
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == 0, told
    cluster.resume(hung)
    assert len(results(tmp_path)) == 4


@pytest.mark.thorough
@pytest.mark.parametrize("cluster", ["5s"], indirect=True)
def test_a_cluster_of_silent_workers_ends_the_run_after_a_time(cluster, tmp_path, monkeypatch):
    monkeypatch.setenv(TIMEOUT_VARIABLE, "3s")
    workspace(tmp_path)
    hung = cluster.start_worker("hung")
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        lost = workers.submit(0, job(tmp_path, seconds=600))
        wait_until((cluster.folder / "began").exists)
        cluster.pause(hung)
        assert "its Dask worker hung (tcp://" in str(lost.exception(HANG_TIMEOUT_S))
        workers.submit(1, job(tmp_path))
        with refused(UnreachedError, "3 s", "dask worker"):
            wait_until(lambda: list(workers.reports()) and None)


@pytest.mark.thorough
def test_workers_announce_the_laws_that_they_compile(cluster, tmp_path):
    workspace(tmp_path)
    cluster.start_worker("cold", environment={"FRAEXP_CACHE_DIR": str(tmp_path / "cache")})
    with create_workers(f"dask:{cluster.address}", 1) as workers:
        workers.submit(7, job(tmp_path))
        assert wait_until(lambda: list(workers.compilations())) == [(7, "'dahl'")]
        assert wait_until(lambda: (7, "") in list(workers.compilations()))


@pytest.mark.thorough
@pytest.mark.parametrize("state", ["silent scheduler", "no workers", "start"])
def test_ctrl_c_is_obeyed_whatever_is_silent(cluster, tmp_path, state):
    workspace(tmp_path, SLOW)
    worker = cluster.start_worker("one")
    if state == "start":
        cluster.pause(cluster.scheduler)
    process = start(tmp_path, cluster)
    if state == "start":
        time.sleep(3.0)  # it connects; nothing tells when
    else:
        wait_until((cluster.folder / "began").exists)
        disturb(cluster, worker, state)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANG_TIMEOUT_S)
    assert process.returncode == ExitCode.INTERRUPTED, told
    assert "stopped by you" in told.splitlines()[-1]
    assert "Traceback" not in told


def disturb(cluster: Cluster, worker: "subprocess.Popen[bytes]", state: str) -> None:
    """Bring a cluster into a state."""
    process = cluster.scheduler if "scheduler" in state else worker
    cluster.pause(process) if "silent" in state else cluster.kill(process)


def test_the_time_to_wait_must_be_a_time(monkeypatch):
    monkeypatch.setenv(TIMEOUT_VARIABLE, "soon")
    with refused(StudyError, TIMEOUT_VARIABLE, "'soon'"):
        create_workers("dask:tcp://127.0.0.1:1", 1)
