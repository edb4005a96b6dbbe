"""Numbers with their units, as ``show``, ``compare`` and the terminal UI print them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from fraexp.data import units
from fraexp.views.words import scale_values, value_text, with_unit


def text(value: object, unit: str) -> str:
    (scaled,), shown = scale_values([value], unit)
    return with_unit(value_text(scaled), shown)


def test_values_have_the_units_that_people_read() -> None:
    assert text(0.132, "m/(N s^2)") == "0.132 m/(N s²)"
    assert text(45.36e-6, "m") == "45.36 µm"
    assert text([1e-4, 2e-3], "m") == "[0.1, 2] mm"
    assert text(0.2, "1") == "0.2"
    assert text([], "N") == "[]"
    assert text("linear", "") == "linear"
    assert text(True, "") == "true"


def test_values_of_several_sweeps_share_a_unit() -> None:
    assert scale_values([1e-6, None, 2e-3], "m") == ([1e-3, None, 2.0], "mm")
    assert scale_values([[1e-6], "absent"], "rad") == ([[1.0], "absent"], "µrad")


@given(st.floats(1e-12, 1e6))
def test_what_is_printed_is_read_back_as_the_same_number(value: float) -> None:
    assert np.isclose(units.number(text(value, "m"), "m"), value, rtol=1e-9, atol=0)
