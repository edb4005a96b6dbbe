"""Workers lose what they are given to lose, and nothing else; they keep to their limits and leave nothing behind."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import wait
from pathlib import Path

import pytest

from fraexp.data.results import Result
from fraexp.errors import StudyError
from fraexp.execution.executors import ResourceLimits, WorkerLostError, Workers, create_workers, worker_count
from fraexp.execution.executors.limits import DEFAULT_TIME_LIMIT_S
from fraexp.execution.sent_jobs import Failure
from tests.examples import thorough
from tests.refusals import refused
from tests.trouble import job, trouble, write_plugin
from tests.waiting import HANG_TIMEOUT_S, wait_until

FOREVER = "while not (notes / 'end').exists(): pass"
needs_linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")


@pytest.fixture(scope="module")
def plugins(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_plugin(tmp_path_factory.mktemp("plugins"))


@pytest.fixture(scope="module")
def pair(plugins: str) -> Iterator[Workers]:
    """Two worker processes that many tests share: what one test kills is replaced for the next."""
    with create_workers("processes:2", 100) as workers:
        yield workers


def metrics(answer: list[Result | Failure], at: int = 0) -> dict[str, float]:
    found = answer[at]
    assert isinstance(found, Result)
    return {metric.name: metric.value for metric in found.metrics}


def lost(workers: Workers, number: int, plugins: str, *estimators: dict[str, object]) -> WorkerLostError:
    error = workers.submit(number, job(plugins, *estimators)).exception(HANG_TIMEOUT_S)
    assert isinstance(error, WorkerLostError)
    return error


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("os.kill(os.getpid(), 9)", "killed by signal 9 (SIGKILL), as a system does that is out of memory"),
        thorough("import ctypes; ctypes.string_at(0)", "killed by signal 11 (SIGSEGV)"),
        thorough("os.abort()", "killed by signal 6 (SIGABRT)"),
        thorough("os._exit(3)", "its worker exited with code 3"),
    ],
)
def test_a_worker_that_dies_costs_its_own_job_alone(pair: Workers, plugins: str, code: str, reason: str) -> None:
    others = [pair.submit(n, job(plugins, amplitude=(n + 1) * 1e-6)) for n in range(20)]
    culprit = pair.submit(20, job(plugins, trouble(code)))
    others += [pair.submit(n, job(plugins, amplitude=(n + 1) * 1e-6)) for n in range(21, 40)]
    error = culprit.exception(HANG_TIMEOUT_S)
    assert isinstance(error, WorkerLostError)
    assert reason in str(error)
    assert error.is_retryable
    assert not wait(others, HANG_TIMEOUT_S).not_done
    assert [metrics(future.result())["peak"] for future in others] == pytest.approx(
        [(n + 1) * 1e-6 for n in range(40) if n != 20]
    )


@pytest.mark.thorough
def test_the_estimator_that_cost_the_worker_is_known(pair: Workers, plugins: str) -> None:
    who = {"name": "who", "version": 1}
    assert lost(pair, 1, plugins, who, trouble("os._exit(1)"), who).estimator == 1


@pytest.mark.parametrize("code", ["raise SystemExit(2)", thorough("raise KeyboardInterrupt"), thorough("1 / 0")])
@pytest.mark.parametrize("executor", ["serial", "processes:1"])
def test_an_exception_of_any_kind_is_a_failure_and_costs_no_worker(executor: str, code: str, plugins: str) -> None:
    with create_workers(executor, 2) as workers:
        before = metrics(workers.submit(0, job(plugins, {"name": "who", "version": 1})).result(HANG_TIMEOUT_S))
        future = workers.submit(1, job(plugins, trouble(code)))
        failed = future.exception(HANG_TIMEOUT_S) or future.result()[0]
        assert isinstance(failed, SystemExit | KeyboardInterrupt | Failure)
        after = metrics(workers.submit(2, job(plugins, {"name": "who", "version": 1})).result(HANG_TIMEOUT_S))
    assert before["process"] == after["process"]


@pytest.mark.thorough
def test_what_cannot_be_sent_back_is_a_failure(pair: Workers, plugins: str) -> None:
    code = "Result.__reduce_ex__ = lambda self, protocol: 1 / 0"
    found = pair.submit(1, job(plugins, trouble(code))).result(HANG_TIMEOUT_S)[0]
    assert isinstance(found, Failure)
    assert "ZeroDivisionError" in found.message
    assert "killed" in str(lost(pair, 2, plugins, trouble("os.kill(os.getpid(), 9)")))  # so that it is a new one


@pytest.mark.thorough
def test_a_job_that_never_returns_is_ended(plugins: str, tmp_path: Path) -> None:
    endless = trouble(FOREVER, folder=str(tmp_path))
    with create_workers("serial", 1) as workers:  # others need nearly no time once all is compiled
        workers.submit(0, job(plugins)).result(HANG_TIMEOUT_S)
    with create_workers("serial", 3, ResourceLimits(time=3.0)) as workers:
        jobs = [job(plugins), job(plugins, endless), job(plugins)]
        first, overdue, last = (workers.submit(number, of) for number, of in enumerate(jobs))
        wait_until(lambda: (list(workers.reports()), last.done())[1])
        error = overdue.exception(0)
        (tmp_path / "end").touch()  # or a thread of this process would go on
        assert isinstance(error, WorkerLostError)
        assert str(error) == "it took longer than the time limit of 3 s; see --time-limit"
        assert not error.is_retryable
        assert metrics(first.result(0)) == metrics(last.result(0))


@pytest.mark.thorough
@needs_linux
def test_memory_is_capped(plugins: str) -> None:
    with create_workers("processes:1", 2, ResourceLimits(memory=10**9)) as workers:
        code = "np.ones(150_000_000)"
        found = workers.submit(0, job(plugins, trouble(code))).result(HANG_TIMEOUT_S)[0]
        assert isinstance(found, Failure)
        assert "MemoryError: Unable to allocate 1.12 GiB" in found.message
        assert found.message.endswith("; a worker may have 1 GB, see --memory-limit")
        assert "1 GB of memory" in str(lost(workers, 1, plugins, trouble("os.kill(os.getpid(), 11)")))
        assert metrics(workers.submit(2, job(plugins)).result(HANG_TIMEOUT_S))


@needs_linux
@pytest.mark.thorough
def test_a_worker_computes_with_one_thread(plugins: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    with create_workers("processes:1", 1) as workers:
        told = metrics(workers.submit(0, job(plugins, {"name": "who", "version": 1})).result(HANG_TIMEOUT_S))
    assert told["threads"] <= 4  # the main one and that of the job; those that watch the parent, and calls of kernels
    assert os.environ["OPENBLAS_NUM_THREADS"] == "4"


def test_stopping_leaves_no_process_whatever_it_is_at(plugins: str, tmp_path: Path) -> None:
    before = set(multiprocessing.active_children())
    workers = create_workers("processes:2", 4)
    pids = [metrics(workers.submit(0, job(plugins, {"name": "who", "version": 1})).result(HANG_TIMEOUT_S))["process"]]
    for number in range(4):
        workers.submit(number, job(plugins, trouble(FOREVER, folder=str(tmp_path))))
    wait_until(lambda: list(tmp_path.iterdir()))  # one is at it
    stopping = threading.Thread(target=workers.stop, daemon=True)
    stopping.start()
    stopping.join(HANG_TIMEOUT_S)
    assert not stopping.is_alive()
    assert set(multiprocessing.active_children()) == before
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid), 0)


def test_workers_that_cannot_start_end_the_run_in_one_line(plugins: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fraexp.execution.executors.processes.serve_jobs", exit)
    with create_workers("processes:1", 1) as workers:
        workers.submit(0, job(plugins))
        with refused(StudyError, "worker process", "code"):
            wait_until(lambda: list(workers.reports()) and None)


def test_progress_is_reported_under_the_number(pair: Workers, plugins: str) -> None:
    list(pair.reports())
    pair.submit(17, job(plugins)).result(HANG_TIMEOUT_S)
    assert (17, 0.0) in list(pair.reports())


@pytest.mark.parametrize(
    ("text", "seconds"), [("60", 60), ("90s", 90), ("5min", 300), ("2 h", 7200), ("0.5", 0.5), ("none", float("inf"))]
)
def test_a_time_limit_is_a_time(text: str, seconds: float) -> None:
    limits = ResourceLimits.parse(text, None)
    assert limits.time == seconds
    assert ResourceLimits.parse(*_texts(limits)) == limits


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is capped on Linux alone")
@pytest.mark.parametrize(("text", "size"), [("2GB", 2 * 10**9), ("1.5 GiB", 3 * 2**29), ("800MB", 8 * 10**8)])
def test_a_memory_cap_is_a_size(text: str, size: int) -> None:
    limits = ResourceLimits.parse(None, text)
    assert limits == ResourceLimits(DEFAULT_TIME_LIMIT_S, size)
    assert ResourceLimits.parse(*_texts(limits)) == limits


def _texts(limits: ResourceLimits) -> tuple[str | None, str | None]:
    told = dict(option.removeprefix("--").split("=") for option in limits.options())
    return told.get("time-limit"), told.get("memory-limit")


@pytest.mark.parametrize(
    ("time_limit", "memory", "names"),
    [
        ("soon", None, ["time limit", "'soon'", 60]),
        ("0", None, ["time limit", "'0'"]),
        ("-3", None, ["time limit", "'-3'"]),
        (None, "much", ["memory cap", "'much'", "2GB"]),
        (None, "10MB", ["memory cap", "'10MB'", "400 MB"]),
    ],
)
def test_what_is_no_limit_is_refused(time_limit: str | None, memory: str | None, names: list[str]) -> None:
    with refused(StudyError, *names):
        ResourceLimits.parse(time_limit, memory)


def test_this_process_caps_no_memory() -> None:
    with refused(StudyError, "processes:1"):
        ResourceLimits(memory=10**9).check("serial")


@pytest.mark.parametrize("name", ["serial:2", "processes:0", "processes:x", "threads", thorough("processes:513")])
def test_there_is_no_other_executor(name: str) -> None:
    with refused(StudyError, "executor"):
        worker_count(name)


@needs_linux
@pytest.mark.thorough
def test_a_worker_ends_with_its_scheduler_though_its_law_never_returns(plugins: str, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import sys, time\n"
        "from fraexp.execution.executors import create_workers\n"
        "from tests.trouble import job, trouble\n"
        "if __name__ == '__main__':\n"
        "    workers = create_workers('processes:1', 1)\n"
        f"    workers.submit(0, job({plugins!r}, trouble('time.sleep(3600)', folder={str(tmp_path / 'notes')!r})))\n"
        "    time.sleep(3600)\n"
    )
    (tmp_path / "notes").mkdir()
    root = Path(__file__).parents[3]
    environment = {**os.environ, "PYTHONPATH": f"{root}:{root / 'plugins'}"}
    process = subprocess.Popen([sys.executable, str(script)], env=environment)
    notes = wait_until(lambda: list((tmp_path / "notes").iterdir()))
    process.send_signal(signal.SIGKILL)
    process.wait()
    worker = int(notes[0].name.split("-")[1])
    wait_until(lambda: not _runs(worker))


def _runs(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
