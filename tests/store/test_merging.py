"""Joining two databases of any kind: what is added, what stays, and that doing it again adds nothing."""

import math
import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from fraexp.data.results import Metric, Outcome, Result
from fraexp.errors import StoreError
from fraexp.store import Merged, Store
from fraexp.store.changes import merging
from fraexp.store.diff import differences
from tests.store.conftest import KINDS


@pytest.fixture(params=KINDS)
def other(request, tmp_path):
    """A second database, of either kind."""
    of_sqlite = request.param == "sqlite"
    with Store.open(
        str(tmp_path / "other.db") if of_sqlite else request.getfixturevalue("server").new(), create=True
    ) as opened:
        yield opened


def joined(store, other) -> Merged:
    steps = store.merge(other)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value


def begin_in(store, grid, study="s"):
    return store.begin_run(study, f"{study}.toml", "fraexp run", {"git": {"commit": "c0ffee"}}, grid)


def test_results_runs_tags_and_notes_are_added_once(store, other, sweep, result, origin):
    mine, theirs = (
        begin_in(store, [sweep(0)], "mine"),
        begin_in(other, [sweep(0, a=1), sweep(1, a=2), sweep(2, a=3)], "theirs"),
    )
    store.save(mine, [(sweep(0), result(), origin)])
    other.save(theirs, [(sweep(number), result(), origin) for number in (0, 1)])
    other.fail(theirs, sweep(2).key, "killed", "the log")
    other.end_run(theirs, "partial")
    other.tag([sweep(0).key, sweep(1).key], "baseline")
    other.annotate(sweep(1).key, "good")
    assert joined(store, other) == Merged(2, 1, 1, 1, 0, ())
    assert repr(store.result(sweep(1).key)) == repr(other.result(sweep(1).key))
    added = store.run(2)
    assert replace(added, number=1, heartbeat=None) == replace(other.run(theirs), heartbeat=None)
    assert [item.labels for item in store.sweeps(2)] == [{"a": 1}, {"a": 2}, {"a": 3}]
    assert store.find(sweep(1).key) == other.find(sweep(1).key)
    assert (store.find(sweep(1).key).note, store.tags()) == ("good", {"baseline": 2})
    assert store.log(sweep(2).key) == "the log"
    assert store.page("a>=2").total == store.page("metric.overshoot>1").total == 2
    assert store.health() == "sound"
    assert joined(store, other) == Merged(0, 0, 2, 0, 1, ())
    assert len(store.runs()) == 2


def test_a_difference_is_told_and_nothing_is_overwritten(store, other, sweep, result):
    first, theirs = result(), result()
    assert theirs.response is not None
    response = theirs.response.response.copy()
    response[1] *= 1 + 1e-3
    theirs = replace(
        theirs, response=replace(theirs.response, response=response), metrics=(Metric("overshoot", 1.6, "1"),)
    )
    store.save(begin_in(store, [sweep()]), [(sweep(), first, {})])
    other.save(begin_in(other, [sweep()]), [(sweep(), theirs, {})])
    (conflict,) = joined(store, other).conflicts
    assert (conflict.key, conflict.what) == (sweep().key, ("response", "metrics"))
    assert conflict.how.startswith("response: response by ")
    assert "overshoot is 1.5 here, 1.6 there" in conflict.how
    assert repr(store.result(sweep().key)) == repr(first)
    assert len(joined(store, other).conflicts) == 1


def test_a_result_is_added_where_there_was_none(store, other, sweep, result):
    begin_in(store, [sweep()])
    other.save(begin_in(other, [sweep()]), [(sweep(), result(), {})])
    merged = joined(store, other)
    assert (merged.sweeps, merged.results) == (0, 1)
    assert store.known([sweep().key])[sweep().key].outcome is Outcome.OK


def test_a_run_that_was_going_on_is_brought_up_to_date(store, other, sweep, result):
    run = begin_in(other, [sweep(0), sweep(1)])
    other.save(run, [(sweep(0), result(), {})])
    joined(store, other)
    assert (store.run(1).state, store.run(1).computed) == ("running", 1)
    other.save(run, [(sweep(1), result(), {})])
    other.end_run(run, "complete")
    assert joined(store, other) == Merged(0, 1, 1, 0, 1, ())
    assert (store.run(1).state, store.run(1).computed, len(store.runs())) == ("complete", 2, 1)


def test_an_older_run_does_not_hide_a_newer_one(store, other, sweep, result):
    older = begin_in(other, [sweep()], "older")
    other.fail(older, sweep().key, "killed", "")
    newer = begin_in(store, [sweep()], "newer")
    store.save(newer, [(sweep(), result(), {})])
    joined(store, other)
    (row,) = store.page().rows
    assert (row.study, row.state, len(store.runs())) == ("newer", "computed", 2)


def test_many_sweeps_and_large_ones_are_joined_in_parts(store, other, sweep, result, monkeypatch):
    monkeypatch.setattr(merging, "AT_ONCE", 7)
    monkeypatch.setattr(merging, "MOST", 5000)
    grid = [sweep(number, n=number) for number in range(40)]
    other.save(begin_in(other, grid), [(point, result(float(number)), {}) for number, point in enumerate(grid)])
    assert joined(store, other) == Merged(40, 40, 0, 1, 0, ())
    assert [item.labels["n"] for item in store.sweeps(1)] == list(range(40))
    assert repr(store.result(grid[33].key)) == repr(other.result(grid[33].key))


def test_a_sweep_whose_key_is_not_that_of_its_parameters_is_left_out(store, path, sweep, result, tmp_path):
    with Store.open(str(tmp_path / "forged.db"), create=True) as forged:
        forged.save(begin_in(forged, [sweep(0), sweep(1)]), [(sweep(0), result(), {})])
    spoil(
        tmp_path / "forged.db", f"UPDATE sweep SET excitation_part = {other_part(sweep)} WHERE key = '{sweep(0).key}'"
    )
    with Store.open(str(tmp_path / "forged.db"), read_only=True) as forged:
        merged = joined(store, forged)
    assert [(conflict.key, conflict.what) for conflict in merged.conflicts] == [(sweep(0).key, ("key",))]
    assert (merged.sweeps, merged.results, store.run(1).total) == (1, 0, 1)


def other_part(sweep) -> str:
    return f"(SELECT excitation_part FROM sweep WHERE key = '{sweep(1).key}')"


def test_a_database_is_not_merged_into_itself(store, url):
    with Store.open(url, read_only=True) as again, pytest.raises(StoreError, match="cannot be merged into itself"):
        store.merge(again)


def spoil(file, statement) -> None:
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(statement)


@pytest.mark.parametrize("known", [False, True])
def test_an_outcome_that_is_none_is_refused_with_the_name_of_its_database(store, sweep, result, tmp_path, known):
    if known:
        store.save(begin_in(store, [sweep()]), [(sweep(), result(), {})])
    file = tmp_path / "theirs.db"
    with Store.open(str(file), create=True) as theirs:
        theirs.save(begin_in(theirs, [sweep()]), [(sweep(), result(), {})])
    spoil(file, "UPDATE sweep SET outcome = 'ok'")
    with (
        Store.open(str(file), read_only=True) as theirs,
        pytest.raises(StoreError, match=r"theirs\.db: it holds what fraexp does not write \(KeyError: 'ok'\)"),
    ):
        joined(store, theirs)


@pytest.mark.parametrize("spoilt", ["results.db", "theirs.db"])
def test_a_damaged_array_is_told_with_its_database_and_its_sweep(store, path, sweep, result, tmp_path, spoilt):
    theirs = Store.open(str(tmp_path / "theirs.db"), create=True)
    for one in (store, theirs):
        one.save(begin_in(one, [sweep()]), [(sweep(), result(), {})])
    theirs.close()
    spoil(tmp_path / spoilt, "UPDATE frequency_response SET response = x'00'")
    where = rf"{spoilt}: sweep {sweep().key[4:12]}: a stored array is damaged \(.*\); compute the sweep again"
    with Store.open(str(tmp_path / "theirs.db"), read_only=True) as theirs, pytest.raises(StoreError, match=where):
        joined(store, theirs)


def test_nan_is_equal_to_itself_and_the_distance_is_relative(result):
    nan = replace(result(), metrics=(Metric("m", math.nan, "1"),))
    assert differences(nan, replace(nan)) == ((), "")
    response = result().response
    assert response is not None
    far = replace(response, input_amplitude=response.input_amplitude * 1.5, coherence=np.ones(3))
    what, how = differences(result(), replace(result(), response=far))
    assert what == ("response",)
    assert how == "response: input_amplitude by 5.0e-01, coherence in one alone"
    assert differences(Result(Outcome.OK), Result(Outcome.DIVERGED)) == (
        ("outcome",),
        "outcome: ok here, diverged there",
    )
