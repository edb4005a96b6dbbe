from dataclasses import fields, is_dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from fraexp.data.findings import KINDS, Finding, Quantity
from fraexp.data.results import Curve, FrequencyResponse, Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.store import Store, StoredState
from tests.examples import portion
from tests.refusals import refused


def same(one: Any, other: Any) -> bool:
    """Equality that sees NaN as equal, and types and shapes of arrays as part of the value."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if is_dataclass(one):
        return all(same(getattr(one, item.name), getattr(other, item.name)) for item in fields(one))
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    return repr(one) == repr(other)  # NaN is written nan


def test_a_result_comes_back_as_it_was(store, begin, sweep, result, origin):
    run = begin([sweep()])
    store.save(run, [(sweep(), result(), origin)])
    assert same(store.result(sweep().key), result())
    assert store.stored_states([sweep().key, "fx1-absent"]) == {
        sweep().key: StoredState(Outcome.OK, {name: item.source_hash for name, item in origin.items()}, 0.5)
    }


text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)
number = st.floats()
unsigned_zero = number.map(lambda value: value + 0.0)  # SQLite keeps whole numbers as integers: no -0.0


@st.composite
def responses(draw: st.DrawFn) -> FrequencyResponse:
    n = draw(st.integers(0, 3))

    def floats(*shape: int) -> np.ndarray:
        return draw(arrays.arrays(np.float64, (n, *shape)))

    def complexes(*shape: int) -> np.ndarray:
        return draw(arrays.arrays(np.complex128, (n, *shape)))

    names = draw(text), draw(text), draw(text)
    flags = draw(arrays.arrays(np.bool_, (n,)))
    amplitudes = floats(), floats()
    return FrequencyResponse(
        floats(), complexes(), floats(2, 2), *names, *amplitudes, flags, floats(), floats(), complexes(6)
    )


@st.composite
def curves(draw: st.DrawFn) -> Curve:
    kinds = st.sampled_from([np.float64, np.complex128, np.int64, np.bool_])
    column = kinds.flatmap(lambda kind: arrays.arrays(kind, draw(st.integers(0, 4))))
    columns = draw(st.dictionaries(text, column, max_size=3))
    return Curve(draw(text), columns, {name: draw(text) for name in columns})


quantities = st.builds(Quantity, st.floats(-1e9, np.inf), text, text, st.none() | st.floats(1e-3, 1e5))
findings = st.builds(
    Finding,
    st.sampled_from(tuple(KINDS)) | text.filter(bool),  # a kind of another version is kept, too
    st.lists(quantities, max_size=2).map(tuple),
    st.lists(st.floats(1e-3, 1e5), max_size=3).map(tuple),
    st.integers(0, 9),
    text,
    text,
    text,
)
results = st.builds(
    Result,
    outcome=st.sampled_from(Outcome),
    findings=st.lists(findings, max_size=3).map(tuple),
    response=st.none() | responses(),
    metrics=st.lists(st.builds(Metric, text, unsigned_zero, text), max_size=3).map(tuple),
    curves=st.lists(curves(), max_size=3).map(tuple),
    elapsed=st.floats(0, 1e9),
)


POINT = Sweep({"source": "drive"}, {"name": "hysteresis"})


@pytest.fixture(scope="module")
def shared(tmp_path_factory, kind, request):
    file = tmp_path_factory.mktemp("shared") / "results.db"
    url = str(file) if kind == "sqlite" else request.getfixturevalue("server").new()
    with Store.open(url, create=True) as opened:
        opened.begin_run("s", "f", "c", {}, [POINT])
        yield opened


@settings(max_examples=portion(30))
@given(kept=results)
def test_every_result_comes_back_and_replaces_the_one_before(shared, kept):
    shared.save(1, [(POINT, kept, {})])
    assert same(shared.results([POINT.key])[POINT.key], kept)


def test_a_sweep_and_its_run_come_back_as_they_were(store, begin, sweep, result, origin):
    grid = [sweep(1, amplitude="12 N"), sweep(0, amplitude="75 N")]
    run = begin(grid)
    store.save(run, [(grid[1], result(), origin)])
    first, second = store.sweeps(run)
    assert (first.key, first.state, first.outcome, first.created, first.sources) == (
        grid[0].key,
        "pending",
        None,
        None,
        {},
    )
    assert (second.experiment, second.estimator) == (grid[1].experiment, grid[1].estimator)
    assert (second.labels, second.state, second.outcome) == ({"amplitude": "75 N"}, "computed", Outcome.OK)
    assert (second.message, second.elapsed, second.sources) == ("all well", 0.5, origin)
    assert second.created is not None
    assert timedelta(0) <= datetime.now(UTC) - second.created < timedelta(seconds=30)


def test_the_version_of_a_component_is_kept_with_its_origin(store, begin, sweep, result, origin, sql):
    store.save(begin([sweep()]), [(sweep(), result(), origin)])
    assert sql("SELECT kind, name, version, source_hash FROM supplied_component ORDER BY kind") == [
        ("estimator", "proposed", 3, "hash-of-proposed"),
        ("friction", "rolling", 2, "hash-of-rolling"),
    ]


def test_listing_sweeps_does_not_touch_arrays(store, begin, sweep, result, sql):
    run = begin([sweep()])
    store.save(run, [(sweep(), result(), {})])
    sql("UPDATE frequency_response SET response = :bytes", bytes=b"\0")
    assert store.sweeps(run)[0].outcome is Outcome.OK
    with refused(StoreError, sweep().key[4:12], "digest"):
        store.result(sweep().key)


def test_an_array_of_objects_is_refused_and_nothing_is_stored(store, begin, sweep, result):
    run = begin([sweep(0), sweep(1)])
    curve = Curve("bad", {"x": np.array([None, {}], dtype=object)}, {"x": "m"})
    batch = [(sweep(0), result(), {}), (sweep(1), Result(Outcome.OK, curves=(curve,)), {})]
    with refused(StoreError, "column 'x'", "curve 'bad'"):
        store.save(run, batch)
    assert store.stored_states([sweep(0).key, sweep(1).key]) == {}
    assert store.run(run).computed == 0


def test_what_is_not_plain_data_is_refused_and_nothing_is_stored(store, sweep):
    with refused(StoreError, "set"):
        store.begin_run("s", "f", "c", {"packages": {"numpy"}}, [sweep()])
    assert store.runs() == []


def test_text_that_no_encoding_holds_is_escaped(store, begin, sweep):
    run = begin([sweep()])
    store.fail(run, sweep().key, "no file 'a\udcff'", "log \0 end")
    assert store.sweeps(run)[0].message == r"no file 'a\udcff'"
    assert store.log(sweep().key) == r"log \x00 end"
