import os
import signal
from datetime import UTC, datetime, timedelta

from fraexp.data.findings import remarks
from fraexp.data.results import Outcome, Result
from fraexp.errors import StoreError
from fraexp.store import Store, liveness
from fraexp.store.queries import reading
from tests.refusals import refused
from tests.store.conftest import reseal
from tests.waiting import wait_until

DIES = """
import sys
from fraexp.store import Store
store = Store.open(sys.argv[1])
store.begin_run("s", "f", "c", {}, [])
print("ready", flush=True)
sys.stdin.read()
"""


def test_a_run_counts_what_became_of_its_sweeps(store, begin, sweep, result):
    grid = [sweep(number) for number in range(5)]
    run = begin(grid)
    store.reuse(run, [grid[0].key, grid[1].key])
    store.save(run, [(grid[2], result(), {})])
    store.fail(run, grid[3].key, "killed its worker twice", "Traceback ...")
    summary = store.run(run)
    assert (summary.total, summary.computed, summary.reused, summary.failed) == (5, 1, 2, 1)
    assert (summary.state, summary.ended, summary.provenance) == ("running", None, {"git": None})
    assert (summary.study, summary.study_file, summary.command) == ("friction", "studies/friction.toml", "fraexp run")
    assert [item.state for item in store.sweeps(run)] == ["reused", "reused", "computed", "failed", "pending"]


def test_a_failed_attempt_keeps_the_older_result(store, begin, sweep, result):
    store.save(begin([sweep()]), [(sweep(), result(), {})])
    later = begin([sweep()])
    store.fail(later, sweep().key, "out of memory", "the log")
    failed = store.sweeps(later)[0]
    assert (failed.state, failed.message, failed.outcome) == ("failed", "out of memory", Outcome.OK)
    assert store.log(sweep().key) == "the log"
    assert store.result(sweep().key).message == "all well"
    store.save(later, [(sweep(), result(), {})])
    assert (store.sweeps(later)[0].state, store.sweeps(later)[0].message) == ("computed", "all well")


def test_a_new_result_replaces_the_older_one_entirely(store, begin, sweep, result, origin):
    run = begin([sweep()])
    store.save(run, [(sweep(), result(), origin)])
    store.save(run, [(sweep(), Result(Outcome.NOT_SETTLED, remarks("after 60 s")), {})])
    found = store.result(sweep().key)
    assert (found.outcome, found.message) == (Outcome.NOT_SETTLED, "after 60 s")
    assert (found.response, found.metrics, found.curves) == (None, (), ())
    assert store.find(sweep().key).sources == {}


def test_runs_are_listed_newest_first_and_numbers_are_never_given_twice(store, begin, sweep, sql):
    begin([sweep()])
    newest = begin([])
    assert [item.number for item in store.runs()] == [2, 1]
    sql("DELETE FROM run WHERE number = :number", number=newest)
    assert begin([]) == 3


def test_an_ended_run_says_how_and_when(store, begin):
    run = begin([])
    store.end_run(run, "partial")
    summary = store.run(run)
    assert summary.state == "partial"
    assert summary.ended is not None
    assert summary.started <= summary.ended <= datetime.now(UTC)
    with refused(StoreError, "'done'", "complete, partial, interrupted"):
        store.end_run(run, "done")


def test_a_point_that_stands_twice_in_a_grid_is_stored_once(store, begin, sweep, result):
    run = begin([sweep(0, a=1), sweep(0, a=2)])
    store.save(run, [(sweep(0), result(), {})])
    assert [(item.labels, item.state) for item in store.sweeps(run)] == [({"a": 1}, "computed"), ({"a": 2}, "computed")]


def test_a_run_whose_process_died_shows_as_interrupted(store, url, program):
    with program(DIES, url) as process:
        assert store.run(1).state == "running"
        os.kill(process.pid, signal.SIGKILL)  # a zombie until it is waited for
        wait_until(lambda: store.run(1).state != "running")
        assert store.run(1).state == "interrupted"
        process.wait()
    with Store.open(url, read_only=True) as watcher:
        assert [item.state for item in watcher.runs()] == ["interrupted"]


def test_without_proc_the_system_says_whether_the_process_of_a_run_exists(store, url, program, monkeypatch):
    monkeypatch.setattr(liveness, "_read_stat", lambda pid: None)
    with program(DIES, url) as process:
        assert store.run(1).state == "running"
        process.kill()
        process.wait()
        assert store.run(1).state == "interrupted"


def test_a_run_on_another_host_lives_by_its_heartbeat(store, begin, sql, url, kind):
    run = begin([])
    silent = datetime.now(UTC) - timedelta(minutes=5)
    moment = str(silent.replace(tzinfo=None)) if kind == "sqlite" else silent
    sql("UPDATE run SET heartbeat = :silent", silent=moment)
    assert store.run(run).state == "running"  # its process is here, and alive
    store.beat(run)
    sql("UPDATE run SET host = 'elsewhere', pid = 1, boot = 'another'")
    reseal(url)
    assert store.run(run).state == "running"
    sql("UPDATE run SET heartbeat = :silent", silent=moment)
    assert store.run(run).state == "interrupted"
    store.beat(run)
    assert store.run(run).state == "running"


def test_a_run_that_does_not_exist_is_named_with_the_newest(store, begin):
    with refused(StoreError, "run 1", "fraexp run STUDY"):
        store.run(1)
    begin([])
    for number in (2, 0, -1, 10**30):
        with refused(StoreError, f"run {number}", "run 1"):
            store.sweeps(number)


def test_a_sweep_is_found_by_the_beginning_of_its_key(store, begin, sweep, result):
    grid = [sweep(number, step=number) for number in range(30)]
    run = begin(grid)
    wanted = grid[7]
    store.save(run, [(wanted, result(), {})])
    assert store.find(wanted.key) == store.find(wanted.key[:16]) == store.find(wanted.key[4:16].upper())
    assert (store.find(wanted.key).labels, store.find(wanted.key).state) == ({"step": 7}, "computed")


def test_a_prefix_of_several_keys_or_of_none_is_refused(store, begin, sweep, monkeypatch):
    grid = [sweep(number) for number in range(30)]
    keys = [item.key for item in grid]
    begin(grid)
    shared = next(key[4] for key in keys if sum(other[4] == key[4] for other in keys) > 1)
    with refused(StoreError, f"'{shared}'", "4 characters"):
        store.find(shared)
    monkeypatch.setattr(reading, "MIN_PREFIX", 1)
    with refused(StoreError, f"'{shared}'", *(key for key in keys if key[4] == shared)):
        store.find(shared)
    for prefix in ("nothing", "%", "_", "fx1-f" * 9):
        with refused(StoreError, f"'{prefix}'", "fraexp list", "fraexp show RUN", "fraexp run STUDY"):
            store.find(prefix)


def test_a_result_that_does_not_exist_is_refused(store, begin, sweep):
    begin([sweep()])
    with refused(StoreError, sweep().key):
        store.result(sweep().key)
    assert store.results([sweep().key]) == {}


def test_a_result_for_a_run_that_does_not_exist_is_stored_for_nobody(store, sweep, result):
    with refused(StoreError, "run 9"):
        store.save(9, [(sweep(), result(), {})])
    assert store.stored_states([sweep().key]) == {}
