"""Sorting takes the headings that a listing shows, and completes them."""

import pytest

from fraexp.errors import FraexpError
from fraexp.views.listing import complete_field

FIELDS = ["key", "state", "estimator", "elapsed", "excitation.amplitude", "excitation.points", "friction.static_force"]


@pytest.mark.parametrize(
    ("typed", "field"),
    [
        ("sweep", "key"), ("-took", "-elapsed"), ("amplitude", "excitation.amplitude"),
        ("-amp", "-excitation.amplitude"),
        ("stat", "state"), ("excitation.p", "excitation.points"), ("elapsed", "elapsed"), ("to", "elapsed"),
    ],
)  # fmt: skip
def test_a_heading_or_the_beginning_of_one_is_enough(typed: str, field: str) -> None:
    assert complete_field(typed, FIELDS) == field


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        ("excitation", "ambiguous; expected one of: excitation.amplitude, excit"),
        ("estimatr", "did you mean 'estimator'"),
        ("-", "there is no ''"),
    ],
)
def test_any_other_name_is_an_error(typed: str, told: str) -> None:
    with pytest.raises(FraexpError, match=told):
        complete_field(typed, FIELDS)
