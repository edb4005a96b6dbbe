"""Joining two databases of any kind: what is added, what stays, and that doing it again adds nothing."""

import math
import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

from fraexp.data.findings import remarks
from fraexp.data.results import Metric, Outcome
from fraexp.errors import StoreError
from fraexp.store import MergeSummary, Store
from fraexp.store.changes import merge_source, merging
from tests.examples import some
from tests.refusals import refused
from tests.store.conftest import KINDS, reseal


@pytest.fixture(params=KINDS)
def other(request, tmp_path):
    """A second database, of either kind."""
    of_sqlite = request.param == "sqlite"
    with Store.open(
        str(tmp_path / "other.db") if of_sqlite else request.getfixturevalue("server").new(), create=True
    ) as opened:
        yield opened


def joined(store, other) -> MergeSummary:
    """Merge all, check that each sweep and each run is counted once, and return the summary."""
    steps = store.merge(other)
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            merged: MergeSummary = stop.value
            break
    assert merged.read == merged.added + merged.there + len(merged.conflicts) + len(merged.damaged)
    runs = merged.runs + merged.known_runs + len(merged.run_conflicts) + len(merged.damaged_runs)
    assert merged.read_runs == runs
    return merged


def added_counts(merged: MergeSummary) -> tuple[int, int, int, int, int]:
    """Return the numbers of a merge without a finding: sweeps and results added, same results, runs, known runs."""
    assert not (merged.conflicts or merged.damaged or merged.run_conflicts or merged.damaged_runs)
    return merged.sweeps, merged.results, merged.same, merged.runs, merged.known_runs


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
    merged = joined(store, other)
    assert added_counts(merged) == (2, 1, 1, 1, 0)
    assert merged.tags == 2
    assert repr(store.result(sweep(1).key)) == repr(other.result(sweep(1).key))
    added = store.run(2)
    assert replace(added, number=1, heartbeat=None) == replace(other.run(theirs), heartbeat=None)
    assert [item.labels for item in store.sweeps(2)] == [{"a": 1}, {"a": 2}, {"a": 3}]
    assert store.find(sweep(1).key) == replace(other.find(sweep(1).key), run=2)
    assert store.tags() == {"baseline": 2}
    assert store.log(sweep(2).key) == "the log"
    assert store.page("a>=2").total == store.page("metric.overshoot>1").total == 2
    assert store.health() == "sound"
    assert added_counts(joined(store, other)) == (0, 0, 2, 0, 1)
    assert len(store.runs()) == 2


def test_a_result_is_added_where_there_was_none(store, other, sweep, result):
    begin_in(store, [sweep()])
    other.save(begin_in(other, [sweep()]), [(sweep(), result(), {})])
    merged = joined(store, other)
    assert (merged.sweeps, merged.results) == (0, 1)
    assert store.stored_states([sweep().key])[sweep().key].outcome is Outcome.OK


def test_a_run_that_was_going_on_is_brought_up_to_date(store, other, sweep, result):
    run = begin_in(other, [sweep(0), sweep(1)])
    other.save(run, [(sweep(0), result(), {})])
    joined(store, other)
    assert (store.run(1).state, store.run(1).computed) == ("running", 1)
    other.save(run, [(sweep(1), result(), {})])
    other.end_run(run, "complete")
    assert added_counts(joined(store, other)) == (0, 1, 1, 0, 1)
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
    monkeypatch.setattr(merging, "BATCH_SIZE", 7)
    monkeypatch.setattr(merge_source, "MAX_ARRAY_BYTES", 5000)
    grid = [sweep(number, n=number) for number in range(40)]
    other.save(begin_in(other, grid), [(point, result(float(number)), {}) for number, point in enumerate(grid)])
    assert added_counts(joined(store, other)) == (40, 40, 0, 1, 0)
    assert [item.labels["n"] for item in store.sweeps(1)] == list(range(40))
    assert repr(store.result(grid[33].key)) == repr(other.result(grid[33].key))


def test_a_sweep_whose_key_is_not_that_of_its_parameters_is_left_out(store, path, sweep, result, tmp_path):
    with Store.open(str(tmp_path / "forged.db"), create=True) as forged:
        forged.save(begin_in(forged, [sweep(0), sweep(1)]), [(sweep(0), result(), {})])
    spoil(
        tmp_path / "forged.db", f"UPDATE sweep SET excitation_part = {other_part(sweep)} WHERE key = '{sweep(0).key}'"
    )
    reseal(str(tmp_path / "forged.db"))
    with Store.open(str(tmp_path / "forged.db"), read_only=True) as forged:
        merged = joined(store, forged)
    assert [(conflict.key, conflict.what) for conflict in merged.conflicts] == [(sweep(0).key, ("key",))]
    assert (merged.sweeps, merged.results, store.run(1).total) == (1, 0, 1)


def other_part(sweep) -> str:
    return f"(SELECT excitation_part FROM sweep WHERE key = '{sweep(1).key}')"


def test_a_database_is_not_merged_into_itself(store, url):
    with Store.open(url, read_only=True) as again, refused(StoreError, "itself"):
        store.merge(again)


def spoil(file, statement) -> None:
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(statement)


DAMAGE = {
    "UPDATE sweep SET outcome = 'ok'": "it cannot be read, or its parameters are damaged; left out",
    "UPDATE sweep SET findings = '[]'": "its row is damaged; it is left out",
    "UPDATE frequency_response SET response = x'00'": "result damaged and left out",
    "UPDATE metric SET value = 1.25": "result damaged and left out",
    "DELETE FROM curve_column": "result damaged and left out",
    "UPDATE part SET content = '{}'": "it cannot be read, or its parameters are damaged; left out",
    "DELETE FROM tag": "tags damaged and left out",
}


@pytest.mark.parametrize("known", some([False, True], True))
@pytest.mark.parametrize(("statement", "how"), DAMAGE.items(), ids=range(len(DAMAGE)))
def test_what_is_damaged_is_left_out_with_a_line(store, path, sweep, result, tmp_path, known, statement, how):
    if known:
        store.save(begin_in(store, [sweep()]), [(sweep(), result(), {})])
    file = tmp_path / "theirs.db"
    with Store.open(str(file), create=True) as theirs:
        theirs.save(begin_in(theirs, [sweep(), sweep(1)]), [(sweep(), result(), {})])
        theirs.tag([sweep().key], "baseline")
    spoil(file, statement)
    with Store.open(str(file), read_only=True) as theirs:
        merged = joined(store, theirs)
        assert theirs.health() != "sound"
    assert (sweep().key, how) in [(of.key, of.how) for of in merged.damaged]
    assert store.health() == "sound"
    assert not known or repr(store.result(sweep().key)) == repr(result())
    assert "result" not in how or merged.results == 0


def test_what_is_damaged_here_stays_and_is_a_conflict(store, path, sweep, result, tmp_path):
    theirs = Store.open(str(tmp_path / "theirs.db"), create=True)
    for one in (store, theirs):
        one.save(begin_in(one, [sweep()]), [(sweep(), result(), {})])
    theirs.close()
    spoil(path, "UPDATE frequency_response SET response = x'00'")
    with Store.open(str(tmp_path / "theirs.db"), read_only=True) as theirs:
        (conflict,) = joined(store, theirs).conflicts
    assert (conflict.what, conflict.how) == (
        ("damaged",), "damaged here, sound there; fraexp delete it here, and merge again"
    )  # fmt: skip


def test_whatever_differs_is_a_conflict_with_both_texts_and_nothing_is_overwritten(store, other, sweep, result, origin):
    first, theirs = (
        replace(result(), metrics=(Metric("overshoot", value, "1"), Metric("undefined", math.nan, "1")))
        for value in (1.5, 1.6)
    )
    assert theirs.response is not None
    response = theirs.response.response.copy()
    response[1] *= 1 + 1e-3
    changed = replace(theirs.response, response=response)
    theirs = replace(theirs, findings=remarks("half well"), numerics="8 lanes", response=changed)
    store.save(begin_in(store, [sweep()]), [(sweep(), first, origin)])
    other.save(begin_in(other, [sweep()]), [(sweep(), theirs, {})])
    other.tag([sweep().key], "laser")
    (conflict,) = joined(store, other).conflicts
    assert set(conflict.what) == {"findings", "numerics", "origins", "response", "metrics"}
    assert 'findings: text "all well" here, "half well" there' in conflict.how
    assert "estimator proposed: " in conflict.how
    assert "response: response by " in conflict.how
    assert "overshoot 1.5 here, 1.6 there" in conflict.how
    assert "undefined" not in conflict.how  # NaN is equal to itself
    found = store.find(sweep().key)
    assert (found.message, found.tags) == ("all well", ("laser",))
    assert repr(store.result(sweep().key)) == repr(first)
    assert len(joined(store, other).conflicts) == 1


def test_a_run_that_differs_is_a_conflict(store, other, sweep, result):
    run = begin_in(other, [sweep(0), sweep(1)])
    other.save(run, [(sweep(0), result(), {})])
    other.end_run(run, "partial")
    joined(store, other)
    store.delete([sweep(1).key])
    (conflict,) = joined(store, other).run_conflicts
    assert (conflict.key, conflict.how) == ("run 1", f"sweep {sweep(1).key[4:12]} only there")


@pytest.mark.parametrize("here", [True, False])
def test_a_known_run_with_a_damaged_sweep_is_no_difference_of_its_sweeps(store, path, sweep, tmp_path, here):
    file = tmp_path / "theirs.db"
    with Store.open(str(file), create=True) as theirs:
        theirs.end_run(begin_in(theirs, [sweep(0), sweep(1)]), "partial")
        joined(store, theirs)
    spoil(path if here else file, "UPDATE run_sweep SET message = 'x' WHERE position = 1")
    with Store.open(str(file), read_only=True) as theirs:
        merged = joined(store, theirs)
    conflicts, damaged = ([of.how for of in found] for found in (merged.run_conflicts, merged.damaged_runs))
    expected = ["1 of its sweeps are damaged here"], ["1 of its 2 sweeps are damaged and not compared"]
    assert (conflicts, damaged) == ((expected[0], []) if here else ([], expected[1]))
