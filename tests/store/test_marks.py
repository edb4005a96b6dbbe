"""Tags, progress, and watching a database that changes."""

import gc
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from fraexp.errors import StoreError
from fraexp.store import RunProgress, Store
from tests.refusals import refused


def test_tags_come_back_and_go(store, begin, sweep):
    one, two = sweep(1), sweep(2)
    begin([one, two])
    store.tag([one.key, two.key], "baseline")
    store.tag([one.key], "baseline")
    store.tag([one.key], "äpfel")
    assert store.tags() == {"baseline": 2, "äpfel": 1}
    assert store.find(one.key).tags == ("baseline", "äpfel")
    store.untag([two.key], "baseline")
    assert store.tags() == {"baseline": 1, "äpfel": 1}
    store.untag([one.key], "baseline")
    assert store.tags() == {"äpfel": 1}


@pytest.mark.parametrize("name", ["", "a b", "a,b", 'a"b', "a\tb", "a\x00b", "a\u00a0b"])
def test_a_tag_is_a_word(store, begin, sweep, name):
    begin([sweep()])
    with refused(StoreError, repr(name), "baseline"):
        store.tag([sweep().key], name)


def test_what_does_not_exist_cannot_be_marked(store, begin, sweep):
    begin([sweep()])
    with refused(StoreError, "fx1-0"):
        store.tag(["fx1-0"], "good")
    store.tag([sweep().key], "baseline")
    with refused(StoreError, "'basline'", "'baseline'"):
        store.untag([sweep().key], "basline")


def test_a_run_tells_its_progress_and_its_process(store, begin, sweep):
    run = begin([sweep()])
    assert store.run(run).progress is None
    told = RunProgress(0.5, 1, 2, {sweep().key: 0.5})
    store.beat(run, told)
    store.beat(run)
    summary = store.run(run)
    assert (summary.progress, summary.process.pid) == (told, os.getpid())
    assert summary.heartbeat >= summary.started


def test_the_version_changes_with_what_is_written_and_only_then(store, begin, sweep, url):
    begin([sweep()])
    with Store.open(url, read_only=True) as watcher:
        before = watcher.version(), store.version()
        assert (watcher.version(), store.version()) == before
        store.tag([sweep().key], "t")
        assert watcher.version() != before[0]
        assert store.version() != before[1]


def open_files():
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0


@pytest.mark.thorough
def test_a_watcher_survives_hours_and_holds_no_lock(store, begin, sweep, path):
    run = begin([sweep()])
    with Store.open(str(path), read_only=True, timeout=0.1) as watcher:
        watcher.page()
        gc.collect()  # closes what earlier tests have left open
        files = open_files()
        for _ in range(300):
            watcher.version()
            watcher.page("friction")
            store.beat(run)
        assert open_files() <= files  # what earlier tests have left open may be closed meanwhile
        with closing(sqlite3.connect(path)) as connection:  # nothing keeps the log from being emptied
            assert connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0] == 0


@pytest.mark.parametrize("what", ["deleted", "replaced"])
def test_a_database_that_is_deleted_or_replaced_is_noticed(store, begin, path, what):
    begin([])
    with Store.open(str(path), read_only=True) as watcher:
        assert not watcher.is_replaced()
        path.rename(path.with_name("elsewhere.db"))
        if what == "replaced":
            path.write_bytes(b"another")
        assert watcher.is_replaced()
        with refused(StoreError, path, what):
            watcher.page()
