"""Numbers with units, as people write them."""

import pytest

from fraexp.data.units import number
from fraexp.errors import ParameterError


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("10 mm", "m", 0.01),
        ("10mm", "m", 0.01),
        ("2.5e3N", "N", 2500.0),
        ("-4e-3m", "m", -0.004),
        (".1um", "m", 1e-7),
        ("5 N s/m", "N s/m", 5.0),
        ("3", "m", 3.0),
        ("1e-3", "1", 1e-3),
    ],
)
def test_a_blank_before_the_unit_may_be_left_out(text, unit, value):
    assert number(text, unit) == pytest.approx(value)


@pytest.mark.parametrize("text", ["mm", "1..5 mm", "1,5 mm", "10 mmm", "10kg", "1e N", "0x10 mm"])
def test_what_is_no_number_with_such_a_unit_is_refused(text):
    with pytest.raises(ParameterError):
        number(text, "m")
