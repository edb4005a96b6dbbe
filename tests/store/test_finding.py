"""Filters, sorting and pages: what SQL answers is what plain Python answers."""

import json
from dataclasses import replace
from datetime import datetime, timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fraexp.data.findings import remarks
from fraexp.data.results import Metric, Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.errors import FilterError
from fraexp.store import Store
from fraexp.store.queries.filters import parse_filter
from tests.examples import portion
from tests.refusals import refused

OK = Result(Outcome.OK)


def point(amplitude, name="proposed", label="one", **labels):
    experiment = {
        "source": "loop",
        "friction": {"name": "rolling", "version": 1, "curve": {"coulomb_force": 17.9}},
        "excitation": {"name": "stepped_sine", "amplitude": amplitude, "frequencies": [float(n) for n in range(100)]},
    }
    return Sweep(experiment, {"name": name, "method": None, "hold": True}, {"case": label, **labels})


def found(store, text, run=None):
    return {row.labels["case"] for row in store.page(text, run=run).rows}


@pytest.fixture
def filled(store):
    a, b, c, d = (
        point(12.0, label="a"),
        point(75.0, label="b"),
        point(1e-7, "conventional", "c_%"),
        point("fit", "x", "d"),
    )
    first = store.begin_run("paper/old", "f", "c", {}, [a, b])
    store.save(first, [(a, OK, {}), (b, Result(Outcome.NOT_SETTLED, remarks("after 60 s")), {})])
    second = store.begin_run("new", "f", "c", {}, [d, c, a])
    metrics = (Metric("peak force", 14.5, "N"),)
    store.save(second, [(c, Result(Outcome.DIVERGED, remarks("100 % gone"), metrics=metrics, elapsed=2.0), {})])
    store.reuse(second, [a.key])
    store.fail(second, d.key, "killed", "log")
    store.tag([a.key, c.key], "baseline")
    return store


FILTERS = [
    ("", {"a", "b", "c_%", "d"}),
    ("estimator=proposed", {"a", "b"}),
    ("estimator:PROP", {"a", "b"}),
    ("estimator!=proposed", {"c_%", "d"}),
    ("excitation.amplitude>=12", {"a", "b"}),
    ("excitation.amplitude>0", {"a", "b", "c_%"}),  # a text is no number
    ("-excitation.amplitude>0", {"d"}),
    ("excitation.amplitude=0.1um", {"c_%"}),
    ("excitation.amplitude=12", {"a"}),
    ("amplitude=12", {"a"}),
    ("-coulomb_force>18 hold=true", {"a", "b", "c_%", "d"}),
    ("excitation.amplitude:fi", {"d"}),
    ("estimator.hold=true", {"a", "b", "c_%", "d"}),
    ("estimator.method=x", set()),
    ("state:unusable", {"c_%", "d"}),
    ("state:reused", {"a"}),
    ('outcome:"not settled"', {"b"}),
    ("outcome:not_settled", {"b"}),
    ("tag:baseline", {"a", "c_%"}),
    ("-tag:baseline", {"b", "d"}),
    ("tag:base", set()),
    ('message:"% gone"', {"c_%"}),
    ("study:old", {"a", "b"}),
    ("study=new", {"a", "c_%", "d"}),
    ("run=1", {"a", "b"}),
    ("run>1", {"a", "c_%", "d"}),
    ("message:%", {"c_%"}),
    ("message:killed", {"d"}),
    ("elapsed>1s", {"c_%"}),
    ("elapsed>0.03m", {"c_%"}),
    ('metric."peak force">0.014kN', {"c_%"}),
    ("friction.curve.coulomb_force>0.001kg", {"a", "b", "c_%", "d"}),  # of which no unit is known here
    ("created:today", {"a", "b", "c_%"}),
    ("created<2020-01-01", set()),
    ('metric."peak force">14', {"c_%"}),
    ("case:_", {"c_%"}),
    ("c_%", {"c_%"}),
    ("BASELINE", {"a", "c_%"}),
    ("paper", {"b"}),  # a's latest run is of another study
    ("gone", {"c_%"}),
    ("'; DROP TABLE sweep; --", set()),
]


def test_a_filter_lets_through_what_it_says(filled):
    for text, cases in FILTERS:
        assert found(filled, text) == cases, text
        assert filled.page(text).total == len(cases), text
        assert len(filled.keys(text)) == len(cases), text


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("amplitud>3", ["'amplitud'", "'excitation.amplitude'"]),
        ("name=x", ["'name'", "estimator.name, excitation.name, friction.name"]),
        ("friction.curve.coulomb_force=seventy", ["'seventy'", "1e-6"]),
        ("coulomb_force:70x", ["'coulomb_force:70x'", "'70x'"]),
        ("metric.stroke>1", ["'metric.stroke'"]),
        ("state:fialed", ["'fialed'", "'failed'"]),
        ("estimator>x", ["'estimator>x'", "estimator=", "estimator:"]),
        ("created>soon", ["'soon'", "yesterday"]),
        ('message:"open', ["quote", """'message:"open'"""]),
        ("tag:", ["'tag:'", "tag:ok"]),
        ("=3", ["'=3'", "tag:baseline"]),
        ("-", ["'-'", "tag:baseline"]),
        ("excitation.amplitude", ["excitation.amplitude=VALUE"]),
        ("elapsed>1mm", ["'elapsed>1mm'", "'mm'", "'s'"]),
        ('metric."peak force">14kg', ["'kg'", "'N'"]),
        ("excitation.amplitude>=12kg", ["'kg'", "'N'", "'m'"]),
        ("excitation.amplitude >= 20 N m", ["'N m'", "'N'", "'m'", "quotes"]),
        ("excitation.amplitude >= ", ["'excitation.amplitude>='"]),
        ("estimator=propsed", ["'propsed'", "'proposed'"]),
    ],
)
def test_a_filter_that_cannot_be_understood_is_refused_in_one_line(filled, url, text, names):
    units = {"excitation.amplitude": {"stepped_sine": ["N", "m"]}}
    with Store.open(url, read_only=True, units=lambda path: units.get(path, {})) as store:
        with refused(FilterError, "filter", *names):
            store.page(text)
        assert store.page("excitation.amplitude>=0.012kN excitation.amplitude>1um").total == 2


def test_a_unit_finds_components_that_declare_it_and_is_refused_if_none_is_stored(store, url):
    thrust, motion = point(12.0, label="thrust"), point(12.0, label="motion")
    motion = replace(motion, experiment={**motion.experiment, "excitation": {"name": "sine_motion", "amplitude": 12.0}})
    units = {"stepped_sine": ["N"], "sine_motion": ["m"]}
    number = store.begin_run("both", "f", "c", {}, [thrust])
    with Store.open(url, read_only=True, units=lambda path: units) as reader:
        with refused(FilterError, "'mm'", "'N'"):
            reader.page("excitation.amplitude>=20mm")
        store.save(number, [(thrust, OK, {})])
        store.begin_run("both", "f", "c", {}, [thrust, motion])
        assert found(reader, "excitation.amplitude>=20mm") == {"motion"}
        assert found(reader, "excitation.amplitude>=20mN") == {"thrust"}
        assert found(reader, "-excitation.amplitude>=20mN") == {"motion"}
        assert found(reader, "excitation.amplitude>=1") == {"motion", "thrust"}


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("a.b >= 20 N", ["a.b>=20 N"]),
        ("a.b = -5 -c.d != 3", ["a.b=-5", "-c.d!=3"]),
        ('a.b>=20 "N" x', ["a.b>=20", "N", "x"]),
        ("a.b>=20 N.m loop.noise", ["a.b>=20 N.m", "loop.noise"]),
        ("tag : 12 m", ["tag:12", "m"]),
        ('message:"a =" b', ["message:a =", "b"]),
    ],
)
def test_blanks_around_operators_and_before_units_separate_nothing(text, same):
    assert [condition.term for condition in parse_filter(text)] == same


def test_a_torque_finds_rotary_axes_and_a_force_straight_ones(store, url):
    straight, turning = (
        replace(of := point(12.0, label=label), experiment={**of.experiment, "loop": {"rotary": rotary}})
        for label, rotary in (("straight", False), ("turning", True))
    )
    store.begin_run("one", "f", "c", {}, [straight])
    with Store.open(url, read_only=True, units=lambda path: {"stepped_sine": ["N"]}) as reader:
        with refused(FilterError, "'N m'", "'N'", "quotes"):
            reader.page("excitation.amplitude >= 1 N m")
        store.begin_run("both", "f", "c", {}, [straight, turning])
        assert found(reader, "excitation.amplitude >= 1 N m") == {"turning"}
        assert found(reader, "excitation.amplitude >= 1 N") == {"straight"}
        assert found(reader, "excitation.amplitude >= 1") == {"straight", "turning"}
        assert found(reader, "loop.rotary=true") == {"turning"}


def test_a_listing_is_sorted_with_what_lacks_a_value_last(filled):
    def cases(order, **options):
        return [row.labels["case"] for row in filled.page(order=order, **options).rows]

    assert cases("excitation.amplitude") == ["c_%", "a", "b", "d"]  # numbers, then texts
    assert cases("-created")[-1] == cases("created")[-1] == "d"
    assert cases("metric.peak force")[0] == "c_%"
    assert cases("-case") == ["d", "c_%", "b", "a"]
    assert cases("", run=2) == ["d", "c_%", "a"]
    assert cases("-case", offset=1, limit=2) == ["c_%", "b"]
    with refused(FilterError, "order", "'estimater'", "'estimator'"):
        cases("estimater")


def test_a_row_tells_what_the_latest_run_or_the_one_asked_for_saw(filled):
    (row,) = filled.page("case=a").rows
    assert (row.run, row.study, row.state, row.tags) == (2, "new", "reused", ("baseline",))
    (earlier,) = filled.page("case=a", run=1).rows
    assert (earlier.run, earlier.study, earlier.state) == (1, "paper/old", "computed")
    assert [row.component(kind) for kind in ("estimator", "friction", "plant")] == ["proposed", "rolling", None]


def test_a_long_list_comes_back_although_it_is_kept_apart(filled):
    key = filled.keys("case=a")[0]
    assert filled.find(key).experiment == point(12.0).experiment
    assert "excitation.amplitude" in filled.fields()
    assert "metric.peak force" in filled.fields()
    assert "case" in filled.fields()


NAMES = ["a", "A%", "b_", "é", 'q"', "proposed"]
WORDS = st.sampled_from(NAMES)
AMPLITUDES = st.sampled_from([1.0, 2, 12.0, "12 N", True, None])
ROWS = st.lists(st.tuples(AMPLITUDES, WORDS, WORDS, st.sampled_from([*Outcome, None])), max_size=6)
TERMS = st.one_of(
    st.tuples(
        st.sampled_from(["", "-"]),
        st.just("x.amplitude"),
        st.sampled_from([">", ">=", "<", "<=", "=", "!="]),
        st.sampled_from(["1", "2", "12"]),
    ),
    st.tuples(
        st.sampled_from(["", "-"]), st.sampled_from(["estimator", "case"]), st.sampled_from(["=", ":", "!="]), WORDS
    ),
    st.tuples(
        st.sampled_from(["", "-"]), st.just("outcome"), st.just(":"), st.sampled_from([item.name for item in Outcome])
    ),
    st.tuples(st.sampled_from(["", "-"]), st.just(""), st.just(""), WORDS),
)


def lower(text):
    return "".join(letter.lower() if letter.isascii() else letter for letter in text)


def expected(row, term):
    amplitude, name, case, outcome = row
    sign, field, operator, value = term
    if field == "x.amplitude":
        number = amplitude if isinstance(amplitude, int | float) and not isinstance(amplitude, bool) else None
        compare = {">": float.__gt__, ">=": float.__ge__, "<": float.__lt__, "<=": float.__le__}
        compare |= {"=": float.__eq__, "!=": float.__eq__}
        holds = number is not None and compare[operator](float(number), float(value))
    elif field == "outcome":
        holds = outcome is not None and outcome.name == value
    elif field:
        text = name if field == "estimator" else case
        holds = lower(value) in lower(text) if operator == ":" else text == value
    else:
        labels = json.dumps({"case": case}, separators=(",", ":"))
        holds = lower(value) in lower(name) or lower(json.dumps(value)[1:-1]) in lower(labels) or lower(value) in "s"
    return holds != ((sign == "-") != (operator == "!="))


@pytest.fixture(scope="module")
def another(tmp_path_factory, kind, request):
    """Return what makes an empty database."""

    def make():
        if kind == "sqlite":
            return str(tmp_path_factory.mktemp("db") / "r.db")
        return request.getfixturevalue("server").new()

    return make


@settings(max_examples=portion(60))
@given(rows=ROWS, terms=st.lists(TERMS, max_size=3))
def test_sql_and_python_agree(another, rows, terms):
    grid = {
        sweep.key: (sweep, row)
        for index, row in enumerate(rows)
        for sweep in [Sweep({"x": {"amplitude": row[0], "n": index}}, {"name": row[1]}, {"case": row[2]})]
    }
    # something that has every field, so that none is unknown, and that no term is asked of
    rest = Sweep({"x": {"amplitude": 0}}, {"name": "n"}, {"case": "n"})
    with Store.open(another(), create=True) as store:
        others = [Sweep({"y": 1}, {"name": name}, {"case": "n"}) for name in NAMES]
        store.begin_run("s", "f", "c", {}, [rest, *others])
        run = store.begin_run("s", "f", "c", {}, [sweep for sweep, _ in grid.values()])
        store.save(run, [(sweep, Result(row[3]), {}) for sweep, row in grid.values() if row[3]])
        quote = lambda text: '"' + text.replace('"', '\\"') + '"'  # noqa: E731
        text = " ".join(f"{sign}{field}{operator}{quote(value)}" for sign, field, operator, value in terms)
        wanted = {key for key, (_, row) in grid.items() if all(expected(row, term) for term in terms)}
        assert set(store.keys(text)) - {sweep.key for sweep in (rest, *others)} == wanted
        assert store.page(text, run=run).total == len(wanted)


def test_a_day_is_that_of_the_clock_on_the_wall(filled):
    today = datetime.now().astimezone()
    assert filled.page(f"created={today:%Y-%m-%d}").total == 3
    assert filled.page(f"created>{today:%Y-%m-%d}").total == 0
    assert filled.page(f"created={today - timedelta(days=1):%Y-%m-%d}").total == 0
    assert filled.page(f"created>={today - timedelta(days=1):%Y-%m-%d}").total == 3
