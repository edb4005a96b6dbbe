"""Who computes what: claims of several runs, and what ends them."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CLAIMS = """
import sys
from fraexp.store import Store
from fraexp.data.sweep import Sweep
store = Store.open(sys.argv[1], timeout=30)
grid = [Sweep({"source": "loop", "number": number}, {"name": "e"}) for number in range(60)]
run = store.begin_run("s", "f", "c", {}, grid)
mine = set()
for start in range(0, 60, 4):
    mine |= store.claim(run, [point.key for point in grid[start : start + 8]])
    store.beat(run)
print("ready", flush=True)
print(*sorted(mine), flush=True)
sys.stdin.read()
"""


@pytest.fixture
def keys(sweep):
    return [sweep(number).key for number in range(4)]


@pytest.fixture
def two_runs(begin, sweep):
    grid = [sweep(number) for number in range(4)]
    return begin(grid), begin(grid)


def test_what_one_run_holds_another_is_not_given(store, two_runs, keys):
    one, other = two_runs
    assert store.claim(one, keys[:3]) == set(keys[:3])
    assert store.claim(other, keys) == {keys[3]}
    assert store.lease_holders(keys) == {**dict.fromkeys(keys[:3], one), keys[3]: other}
    assert store.claim(one, keys) == set(keys[:3])  # asking again is no harm
    assert store.claim(one, ["fx1-none"]) == set()


def test_what_has_a_result_is_not_claimed_unless_it_is_to_be_computed_again(
    store, two_runs, sweep, keys, result, begin
):
    one, other = two_runs
    store.save(one, [(sweep(0), result(), {})])
    assert store.claim(other, keys[:2]) == {keys[1]}
    assert store.claim(other, keys[:2], again=True) == {keys[1]}  # it was computed since this run began
    later = begin([sweep(0)])
    assert store.claim(later, keys[:1], again=True) == {keys[0]}
    store.save(later, [(sweep(0), result(), {})])
    assert store.claim(later, keys[:1], again=True) == set()


def test_results_failures_and_the_end_of_a_run_release(store, two_runs, sweep, keys, result):
    one, other = two_runs
    store.claim(one, keys)
    store.save(one, [(sweep(0), result(), {})])
    store.fail(one, keys[1], "killed", "")
    assert store.lease_holders(keys) == {keys[2]: one, keys[3]: one}
    assert store.claim(other, keys) == {keys[1]}
    store.end_run(one, "interrupted")
    assert store.lease_holders(keys) == {keys[1]: other}
    assert store.claim(other, keys) == {keys[1], keys[2], keys[3]}
    assert store.claim(one, keys) == set()  # it is over


@pytest.mark.parametrize(
    "change", ["pid = 4194305", "boot = 'another'", "process_start = 1", "state = 'interrupted'", "heartbeat = :silent"]
)
def test_a_run_that_is_dead_or_silent_holds_nothing(store, two_runs, keys, sql, kind, change):
    one, other = two_runs
    store.claim(one, keys)
    silent = datetime.now(UTC) - timedelta(seconds=90)
    moment = str(silent.replace(tzinfo=None)) if kind == "sqlite" else silent
    sql(f"UPDATE run SET {change} WHERE number = {one}", **({"silent": moment} if ":silent" in change else {}))
    assert store.lease_holders(keys) == {}
    assert store.claim(other, keys) == set(keys)
    assert store.lease_holders(keys) == dict.fromkeys(keys, other)


def test_two_processes_never_get_the_same_and_a_killed_one_leaves_all(store, url, program):
    with program(CLAIMS, url) as first, program(CLAIMS, url) as second:
        one, two = (set(process.stdout.readline().split()) for process in (first, second))
        assert not one & two
        assert len(one | two) == 60
        first.kill()
        first.wait()
        run = store.begin_run("s", "f", "c", {}, [])
        assert store.claim(run, one | two) == one
