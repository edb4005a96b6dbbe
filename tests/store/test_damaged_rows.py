"""Rows that another program has changed, on every kind of database: they are shown as damaged, and by doctor."""

import sqlite3
from contextlib import closing

import pytest

from fraexp.data.results import Outcome
from fraexp.store import Store

OF_A_SWEEP = {
    "a metric": "UPDATE metric SET value = 2",
    "a metric that is missing": "DELETE FROM metric",
    "an array": "UPDATE frequency_response SET response = covariance",
    "an array of a curve": "DELETE FROM curve_column WHERE name = 'f'",
    "a finding": """UPDATE sweep SET findings = '[{"kind": "no motion"}]'""",
    "an outcome": "UPDATE sweep SET outcome = 'NOT_SETTLED'",
    "a computing time": "UPDATE sweep SET elapsed = 2",
    "an origin": "UPDATE supplied_component SET source_hash = 'another'",
    "a parameter": """UPDATE part SET content = '{"name": "rolling", "version": 3}' WHERE section = 'friction'""",
    "a tag": "UPDATE tag SET name = 'reference'",
    "a run that is missing": "DELETE FROM run",
    "a label": """UPDATE run_sweep SET labels = '{"amplitude": 13}'""",
    "a failure": "UPDATE run_sweep SET message = 'killed'",
}
OF_A_RUN = {
    "a study": "UPDATE run SET study = 'another'",
    "a provenance": """UPDATE run SET provenance = '{"fraexp": "0.2.0"}'""",
    "a state": "UPDATE run SET state = 'finished'",
    "a sweep's state": "UPDATE run_sweep SET state = 'calculated'",
    "a sweep that is missing": "DELETE FROM run_sweep",
}


@pytest.fixture
def tagged(store, sweep, result, origin) -> Store:
    """One sweep in one run, with all that is stored of either."""
    run = store.begin_run("friction", "studies/friction.toml", "fraexp run", {}, [sweep(amplitude=12)])
    store.save(run, [(sweep(), result(), origin)])
    store.end_run(run, "complete")
    store.tag([sweep().key], "baseline")
    assert store.health() == "sound"
    return store


@pytest.mark.parametrize("statement", OF_A_SWEEP.values(), ids=OF_A_SWEEP)
def test_a_changed_sweep_is_shown_as_damaged(tagged, sql, sweep, statement):
    sql(statement)
    shown = {tagged.find(sweep().key).outcome, tagged.results([sweep().key])[sweep().key].outcome}
    assert Outcome.DAMAGED in shown
    if "run_sweep" in statement:
        assert [row.outcome for row in tagged.page().rows] == [Outcome.DAMAGED]
        assert "run 1: damaged at position 0" in tagged.health()
    else:
        assert f"sweep {sweep().key[4:12]}" in tagged.health()


@pytest.mark.parametrize("statement", OF_A_RUN.values(), ids=OF_A_RUN)
def test_a_changed_run_is_shown_as_damaged(tagged, sql, statement):
    sql(statement)
    assert [run.state for run in tagged.runs()] == ["damaged"]
    assert "run 1: damaged" in tagged.health()


def test_a_sweep_whose_key_is_no_text_is_shown_as_damaged(path, tagged):
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE sweep SET key = x'00ff'")
    (row,) = tagged.page().rows
    assert row.outcome is Outcome.DAMAGED
    assert "b'\\x00\\xff'" in row.key
    assert "damaged" in tagged.health()
