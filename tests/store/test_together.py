"""Several processes, sudden deaths and many sweeps."""

import sqlite3
import threading
import time
from contextlib import closing

from sqlalchemy import event
from sqlalchemy.engine import Engine

from fraexp.data.results import Metric, Outcome, Result
from fraexp.store import Store
from tests.store.conftest import reseal
from tests.waiting import HANG_TIMEOUT_S

STOPS_IN_MID_TRANSACTION = """
import sys
import numpy as np
from sqlalchemy import event
from sqlalchemy.engine import Engine
from fraexp.data.findings import remarks
from fraexp.data.results import Curve, Metric, Outcome, Result
from fraexp.store import Store
from fraexp.store import ComponentOrigin
from fraexp.data.sweep import Sweep

def stop(connection, cursor, statement, parameters, context, executemany):
    if statement.startswith("INSERT INTO curve_column"):
        print("ready", flush=True)
        sys.stdin.read()

grid = [Sweep({"source": "drive", "number": number}, {"name": "hysteresis"}) for number in range(4)]
curve = Curve("loop", {"y": np.zeros(300_000)}, {"y": "m"})  # larger than the cache, so that pages reach the disk
results = [(point, Result(Outcome.OK, metrics=(Metric("m", 1.0, "1"),), curves=(curve,)), {}) for point in grid]
store = Store.open(sys.argv[1])
run = store.begin_run("s", "f", "c", {}, grid)
store.save(run, [(point, Result(Outcome.OK, remarks("first")), {}) for point, _, _ in results[:2]])
event.listen(Engine, "after_cursor_execute", stop)
store.save(run, results)
"""


def test_a_killed_writer_leaves_no_half_sweep(store, path, program):
    with program(STOPS_IN_MID_TRANSACTION, path) as process:
        assert path.with_name("results.db-wal").stat().st_size > 2**20  # the transaction has reached the disk
        process.kill()
        process.wait()
    with Store.open(str(path)) as again:
        run = again.run(1)
        assert (run.state, run.total, run.computed) == ("interrupted", 4, 2)
        sweeps = again.sweeps(1)
        assert [item.message for item in sweeps] == ["first", "first", "", ""]
        found = again.results(item.key for item in sweeps)
        assert [(item.metrics, item.curves) for item in found.values()] == [((), ()), ((), ())]
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []


def test_readers_see_whole_batches_while_one_writes(store, begin, sweep, url):
    grid = [sweep(number) for number in range(60)]
    run = begin(grid)
    seen: dict[int, set[int]] = {1: set(), 2: set()}
    errors: list[BaseException] = []

    def watch(number: int) -> None:
        try:
            with Store.open(url, read_only=True) as reader:
                while (summary := reader.run(run)).computed < len(grid):
                    found = reader.results(item.key for item in grid)
                    seen[number].add(len(found) % 5)
                    assert all(len(item.metrics) == 2 for item in found.values())
                    assert summary.computed <= len(found)
        except BaseException as error:
            errors.append(error)

    watchers = [threading.Thread(target=watch, args=(number,), daemon=True) for number in seen]
    for watcher in watchers:
        watcher.start()
    metrics = (Metric("a", 1.0, "1"), Metric("b", 2.0, "1"))
    for start in range(0, len(grid), 5):
        store.save(run, [(point, Result(Outcome.OK, metrics=metrics), {}) for point in grid[start : start + 5]])
        time.sleep(0.01)
    for watcher in watchers:
        watcher.join(HANG_TIMEOUT_S)
        assert not watcher.is_alive()
    assert errors == []
    assert seen == {1: {0}, 2: {0}}


def test_heartbeats_from_a_thread_do_not_disturb_the_writer(store, begin, sweep, result):
    grid = [sweep(number) for number in range(40)]
    run = begin(grid)
    done = threading.Event()
    beats: list[int] = []

    def heart() -> None:
        while not done.is_set():
            store.beat(run)
            beats.append(1)
            done.wait(0.002)

    thread = threading.Thread(target=heart)
    thread.start()
    try:
        for point in grid:
            store.save(run, [(point, result(), {})])
    finally:
        done.set()
        thread.join()
    assert store.run(run).computed == 40
    assert beats


def test_asking_for_known_sweeps_takes_few_statements(store, begin, sweep, url, sql):
    grid = [sweep(number) for number in range(1000)]
    begin(grid)
    store.close()
    sql("UPDATE sweep SET outcome = 'OK'")
    sql("INSERT INTO supplied_component SELECT key, 'friction', 'rolling', 2, 'hash', '' FROM sweep")
    reseal(url)
    asked: list[str] = []

    def note(connection, cursor, statement, *_):
        asked.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    try:
        with Store.open(url) as again:
            asked.clear()
            known = again.stored_states(point.key for point in grid[400:600])
    finally:
        event.remove(Engine, "before_cursor_execute", note)
    assert len(known) == 200
    assert all(state.sources == {"friction:rolling": "hash"} for state in known.values())
    assert len(asked) < 10
