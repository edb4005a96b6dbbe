"""Deletion, and what brings deleted runs and sweeps back."""

import pytest

from fraexp.data.results import Outcome, Result
from fraexp.errors import StoreError
from fraexp.store import Deletion, Store
from fraexp.store.tables import TRASH
from tests.refusals import refused

TABLES = ("run", "run_sweep", "sweep", "tag", "frequency_response", "metric", "curve", "curve_column")


@pytest.fixture
def filled(store, begin, sweep, result, origin):
    """Two runs: of sweeps 1 and 2, and of 2 and 3."""
    for numbers in ((1, 2), (2, 3)):
        run = begin([sweep(number) for number in numbers])
        store.save(run, [(sweep(number), result(number), origin) for number in numbers])
        store.end_run(run, "complete")
    store.tag([sweep(1).key, sweep(2).key], "baseline")
    return store


def rows(sql) -> dict[str, list]:
    return {name: sorted(map(repr, sql(f"SELECT * FROM {name}"))) for name in TABLES}


def test_a_running_run_and_its_sweeps_cannot_be_deleted(store, begin, sweep):
    run = begin([sweep(1)])
    with refused(StoreError, "run 1", "fraexp stop 1"):
        store.delete([sweep(1).key])
    with refused(StoreError, "run 1", "fraexp stop 1"):
        store.delete(runs=[run])
    with refused(StoreError, "run 9"):
        store.delete(runs=[9])
    assert (store.trash(), store.run(run).total) == ([], 1)


def test_deleted_sweeps_are_gone_and_come_back_as_they_were(filled, sweep, sql):
    before = rows(sql)
    assert filled.delete([sweep(1).key, sweep(2).key, "fx1-none"]) == 2
    assert [of.key for of in filled.page().rows] == [sweep(3).key]
    assert (filled.tags(), filled.stored_states([sweep(1).key]), filled.health()) == ({}, {}, "sound")
    assert [(run.total, run.deleted, run.state) for run in filled.runs()] == [(1, 1, "complete"), (0, 2, "complete")]
    assert filled.undelete() == Deletion((), tuple(sorted((sweep(1).key, sweep(2).key))))
    assert rows(sql) == before
    assert (filled.health(), filled.trash()) == ("sound", [])


def test_a_deleted_run_comes_back_with_the_sweeps_that_no_other_run_has(filled, sweep, sql):
    before = rows(sql)
    assert filled.delete(runs=[2]) == 1
    assert {(row.key, row.run) for row in filled.page().rows} == {(sweep(1).key, 1), (sweep(2).key, 1)}
    assert filled.undelete(runs=[2]) == Deletion((2,), (sweep(3).key,))
    assert rows(sql) == before
    assert filled.health() == "sound"


def test_the_latest_deletion_is_undone_first(filled, sweep):
    filled.delete([sweep(3).key])
    filled.delete(runs=[1])
    filled.delete(runs=[2])
    assert filled.trash()[0] == Deletion((2,), (sweep(2).key,))
    filled.undelete()
    assert [run.number for run in filled.runs()] == [2]
    filled.undelete()  # a run comes back with all of its sweeps
    assert [(run.number, run.total, run.deleted) for run in filled.runs()] == [(2, 2, 0), (1, 2, 0)]
    assert (filled.undelete(), filled.health()) == (Deletion((), ()), "sound")


def test_a_sweep_comes_back_with_its_deleted_runs_but_not_their_other_sweeps(filled, sweep):
    filled.delete(runs=[1, 2])
    assert (filled.runs(), filled.page().total) == ([], 0)
    assert filled.undelete([sweep(2).key]) == Deletion((1, 2), (sweep(2).key,))
    (row,) = filled.page().rows
    assert (row.key, row.run, row.tags, filled.health()) == (sweep(2).key, 2, ("baseline",), "sound")
    assert [(run.study, run.total, run.deleted) for run in filled.runs()] == [(row.study, 1, 1)] * 2
    filled.undelete(runs=[1])
    assert [(row.key, row.run) for row in filled.page(order="key").rows] == sorted(
        [(sweep(1).key, 1), (sweep(2).key, 2)]
    )
    assert filled.health() == "sound"


def test_a_sweep_that_was_computed_again_keeps_its_newer_result(filled, begin, sweep, result, origin):
    filled.delete([sweep(1).key])
    run = begin([sweep(1)])
    assert filled.stored_states([sweep(1).key]) == {}
    filled.save(run, [(sweep(1), result(5.0), origin)])
    filled.end_run(run, "complete")
    assert filled.undelete() == Deletion((), ())
    assert filled.result(sweep(1).key).metrics[0].value == 5.0
    assert ([run.total for run in filled.runs()], filled.health()) == ([1, 2, 2], "sound")
    filled.delete([sweep(1).key])  # replaces the older one in the trash
    assert filled.undelete() == Deletion((), (sweep(1).key,))
    assert (filled.result(sweep(1).key).metrics[0].value, filled.health()) == (5.0, "sound")


def test_a_sweep_whose_new_attempt_failed_gets_its_result_back(filled, begin, sweep):
    filled.delete([sweep(1).key])
    run = begin([sweep(1)])
    filled.fail(run, sweep(1).key, "out of memory", "log")
    filled.end_run(run, "partial")
    assert filled.undelete() == Deletion((), (sweep(1).key,))
    assert filled.result(sweep(1).key).metrics[0].value == 1.0
    assert (filled.find(sweep(1).key).tags, filled.health()) == (("baseline",), "sound")


def test_emptying_the_trash_leaves_nothing_of_it(filled, sweep, sql):
    filled.delete([sweep(3).key], [1])
    assert filled.empty_trash().runs == (1,)
    for table in TRASH.values():
        assert sql(f"SELECT count(*) FROM {table.name}") == [(0,)], table.name
    assert filled.undelete() == Deletion((), ())
    assert (filled.result(sweep(2).key).outcome, filled.run(2).deleted) == (Outcome.OK, 1)
    filled.delete(runs=[2])
    filled.empty_trash()
    for name in (*TABLES, "part"):
        assert sql(f"SELECT count(*) FROM {name}") == [(0,)], name


def test_merging_leaves_the_trash_alone(filled, sweep, tmp_path):
    filled.delete([sweep(1).key])
    with Store.open(str(tmp_path / "copy.db"), create=True) as copy:
        list(copy.merge(filled))
        assert ([run.deleted for run in copy.runs()], copy.trash(), copy.page().total) == ([0, 1], [], 2)
        list(filled.merge(copy))
    assert (filled.page().total, filled.health(), len(filled.trash())) == (2, "sound", 1)


def test_a_deleted_sweep_without_a_result_comes_back(store, begin, sweep):
    run = begin([sweep(1)])
    store.end_run(run, "interrupted")
    store.delete([sweep(1).key])
    assert store.undelete() == Deletion((), (sweep(1).key,))
    store.save(run, [(sweep(1), Result(Outcome.OK), {})])
    assert (store.find(sweep(1).key).outcome, store.health()) == (Outcome.OK, "sound")
