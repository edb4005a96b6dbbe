"""Runs whose database is away: they wait for it, go on, and keep what they cannot store."""

import json
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.components.registry import Registry
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import UnavailableError
from fraexp.execution.computation import RunContext
from fraexp.execution.database_retry import DatabaseRetry
from fraexp.execution.events import Ended, Event, Finished, Noticed, Progress
from fraexp.execution.executors import Answer
from fraexp.execution.run_time import RunTime
from fraexp.execution.scheduler import Spool, compute_recorded
from fraexp.execution.sent_jobs import Job
from fraexp.store import Store
from fraexp.study.study_file import ResolvedStudy
from fraexp.workspace.workspace_service import WorkspaceService
from tests.examples import some
from tests.execution.test_computation import Scripted, begun
from tests.postgresql import running
from tests.refusals import refused
from tests.trouble import study, trouble
from tests.waiting import HANG_TIMEOUT_S, wait_until

GRID = tuple(Sweep({"source": "drive", "n": n}, {"name": "h1", "version": 1}) for n in range(6))
STUDY = ResolvedStudy("study", Path("study.toml"), "", "", GRID)


def number_of(job: Job, _: int) -> Answer:
    return [Result(Outcome.OK, metrics=(Metric("number", float(job.experiment["n"]), "1"),))]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    with closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as connection:
        connection.execute("BEGIN IMMEDIATE")
        yield


def events_of(path: Path, timeout: float, store: Store) -> Iterator[Event]:
    provenance = {"run_id": "0123456789abcdef"}
    run = store.begin_run("study", "study.toml", "", provenance, GRID)
    spool = Spool(STUDY, "", provenance, path.parent).keep_results
    context = RunContext(
        run, store, Registry(), "", False, RunTime(GRID, {}), retry=DatabaseRetry(timeout=timeout), spool=spool
    )
    yield from compute_recorded(STUDY, GRID, context, Scripted(number_of))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "results.db"


def test_a_run_waits_for_a_locked_database_and_goes_on(path: Path) -> None:
    with Store.open(str(path), create=True, timeout=0.05) as store:
        events = events_of(path, 3600.0, store)
        seen = [next(events)]
        with locked(path):
            while not (isinstance(seen[-1], Progress) and seen[-1].doing == "waiting for the database"):
                seen.append(next(events))
        seen += events
        assert sum(isinstance(event, Finished) for event in seen) == len(GRID)
        noticed = [event.what for event in seen if isinstance(event, Noticed)]
        assert noticed[0].startswith("waiting for the database: ")
        assert noticed[-1].startswith("the database is available again")
        assert [sweep.state for sweep in store.sweeps(1)] == ["computed"] * len(GRID)
        assert store.run(1).state == "complete"


def test_results_of_a_run_that_gives_up_are_in_a_file_that_merge_reads(path: Path) -> None:
    with Store.open(str(path), create=True, timeout=0.05) as store:
        events = events_of(path, 0.0, store)
        claimed = wait_for_claim(events, store)
        with locked(path), refused(UnavailableError, "6 results", "'fraexp merge", path.with_name("kept-01234567.db")):
            list(events)
        assert claimed == len(GRID)
        with Store.open(str(path.with_name("kept-01234567.db"))) as kept:
            assert len(kept.results(kept.keys())) == len(GRID)
            list(store.merge(kept))
        assert {key: result.metrics[0].value for key, result in store.results(store.keys()).items()} == {
            sweep.key: float(sweep.experiment["n"]) for sweep in GRID
        }


def wait_for_claim(events: Iterator[Event], store: Store) -> int:
    """Advance a run until it has claimed its sweeps; its workers answer later."""
    while not store.leases():
        next(events)
    return sum(store.leases().values())


def test_a_run_whose_sweeps_were_taken_over_stores_none_of_them(path: Path) -> None:
    with Store.open(str(path), create=True) as store:
        sleeper, other = (store.begin_run("study", "study.toml", "", {}, GRID) for _ in range(2))
        keys = {sweep.key for sweep in GRID}
        store.claim(sleeper, keys)
        silent = str((datetime.now(UTC) - timedelta(seconds=90)).replace(tzinfo=None))
        with closing(sqlite3.connect(path)) as connection, connection:
            connection.execute("UPDATE run SET heartbeat = ? WHERE number = ?", (silent, sleeper))
        assert 89 < store.run(sleeper).silence < 89 + HANG_TIMEOUT_S
        taken = GRID[:4]
        assert store.claim(other, {sweep.key for sweep in taken}) == {sweep.key for sweep in taken}
        results = [(sweep, Result(Outcome.OK), {}) for sweep in GRID]
        kept = {sweep.key for sweep in GRID[4:]}
        assert store.save(sleeper, results, is_fenced=True) == kept
        assert store.save(sleeper, results, is_fenced=True) == kept  # repeated, because the answer was lost
        assert not store.fail(sleeper, taken[0].key, "lost", "", is_fenced=True)
        assert store.fail(other, taken[0].key, "lost", "", is_fenced=True)
        assert store.fail(other, taken[0].key, "lost", "", is_fenced=True)
        assert [sweep.state for sweep in store.sweeps(sleeper)] == ["pending"] * 4 + ["computed"] * 2


DRIVEN = """
title = "Driven"
loop = {sample_time = 1e-3}
friction = {name = "none"}
excitation = {name = "displacement_sine", frequency = 10.0, amplitude = 1e-5}
estimator = {name = "hysteresis"}
"""


@pytest.mark.parametrize("call", some(["stored_states", "runs", "sweeps", "results"], "results"))
def test_planning_and_figures_wait_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    (tmp_path / "driven.toml").write_text(DRIVEN)
    failures, original = [UnavailableError("the server restarts")], getattr(Store, call)

    def fail_once(store: Store, *arguments: object) -> object:
        if failures:
            raise failures.pop()
        return original(store, *arguments)

    monkeypatch.setattr(Store, call, fail_once)
    events = list(WorkspaceService.open(tmp_path, None).run(["driven.toml"], "serial"))
    noticed = [event.what for event in events if isinstance(event, Noticed)]
    assert noticed[0] == "waiting for the database: the server restarts"
    assert noticed[-1].startswith("the database is available again")
    assert isinstance(events[-1], Ended)
    assert (events[-1].state, events[-1].note) == ("complete", "")
    assert [path.name for path in events[-1].figures] == ["driven.png"]


@pytest.mark.thorough
def test_a_run_outlasts_a_server_that_restarts_and_cuts_connections(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    slow = trouble("time.sleep(0.2)", folder=str(tmp_path / "notes"))
    with running() as server:
        database = server.new()
        process = begun(tmp_path, study(30, slow), "--executor=processes:1", f"--db={database}")
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.extend(process.stderr))
        reader.start()
        wait_until(lambda: len(list((tmp_path / "notes").iterdir())) > 3)
        server.cut_connections()
        server.stop()
        wait_until(lambda: any("waiting for the database" in line for line in lines))
        server.start()
        document = json.loads(process.stdout.read())
        assert process.wait(HANG_TIMEOUT_S) == ExitCode.OK, lines
        reader.join()
        assert {sweep["state"] for sweep in document["runs"][0]["sweeps"]} == {"computed"}
