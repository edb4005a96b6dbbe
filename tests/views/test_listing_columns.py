"""The columns of a list of sweeps."""

from datetime import UTC, datetime

import pytest

from fraexp.data.findings import remarks
from fraexp.data.results import Outcome
from fraexp.store import StoredSweep
from fraexp.views.listing import fit_columns, listing_columns


def listed(**changes) -> StoredSweep:
    values = {
        "key": "fx1-0123456789abcdef", "labels": {"excitation.amplitude": 12.0, "loop.delay": 1.0}, "state": "computed",
        "outcome": Outcome.NOT_SETTLED, "findings": remarks("1 of 30"), "estimator": {"name": "proposed"},
        "experiment": {"source": "loop", "friction": {"name": "rolling"}}, "elapsed": 0.5,
        "created": datetime(2026, 1, 31, 12, tzinfo=UTC), "run": 7, "study": "bench", "tags": ("good", "ours"),
    }  # fmt: skip
    return StoredSweep(**(values | changes))


def test_columns_tell_what_sweeps_are():
    columns = {of.title: of.cells for of in listing_columns([listed()], one_run=False, running={})}
    assert columns["sweep"] == ("01234567",)
    assert columns["study"] == ("bench 7",)
    assert columns["amplitude"] == ("12",)
    assert columns["outcome"] == ("not settled",)
    assert columns["tags"] == ("good ours",)
    assert columns["created"] == ("2026-01-31",)
    assert "study" not in [of.title for of in listing_columns([listed()], one_run=True, running={})]


@pytest.mark.parametrize(
    ("changes", "running", "text"),
    [
        ({"state": "failed"}, {}, "failed"),
        ({"state": "pending", "outcome": None}, {}, "pending"),
        ({"state": "pending", "outcome": None}, {"fx1-0123456789abcdef": 0.43}, "running 43 %"),
        ({"state": "reused", "outcome": Outcome.OK}, {}, "ok"),
    ],
)
def test_the_state_of_a_sweep_is_one_word(changes, running, text):
    columns = listing_columns([listed(**changes)], one_run=True, running=running)
    assert next(of for of in columns if of.title == "outcome").cells == (text,)


def test_estimators_of_one_name_are_told_apart_by_what_differs():
    rows = [
        listed(labels={"estimator": {"name": "local", "order": order}}, estimator={"name": "local"}) for order in (1, 2)
    ]
    columns = {of.title: of.cells for of in listing_columns(rows, one_run=True, running={})}
    assert columns["estimator"] == ("local (order 1)", "local (order 2)")


def test_a_number_with_its_unit_is_given_no_other():
    rows = [listed(labels={"loop.noise": value}) for value in (0.0, "10 nm")]
    column = next(of for of in listing_columns(rows, one_run=True, running={}) if of.title.startswith("noise"))
    assert column.cells[1] == "10 nm"
    assert column.unit == ""


@pytest.mark.parametrize("width", [200, 120, 100, 76, 60, 40])
def test_columns_fit_into_any_width_and_the_important_ones_stay(width):
    rows = [listed(labels={"a.name": "x" * 30, "b.c": 1.0, "d.e": 2, "f.g": "y" * 20}), listed()]
    found = fit_columns(listing_columns(rows, one_run=False, running={}), width)
    titles = [column.title for column, _ in found]
    assert sum(room + 2 for _, room in found) <= width
    assert {"sweep", "outcome"} <= set(titles)
    assert ("labels" in titles) == (width < 200)
