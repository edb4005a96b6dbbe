"""Suggestions: a misspelt name finds its own, another name finds none."""

import pytest

from fraexp.errors import did_you_mean


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("sample_rat", "sample_rate"), ("unt", "unit"), ("cvs", "csv"), ("canudas", "canudas_de_wit_1995")],
)
def test_a_misspelt_name_is_recognised(wrong: str, right: str) -> None:
    assert did_you_mean(wrong, ["amplitude", right, "zeta"]) == f"; did you mean '{right}'?"


def test_a_name_that_is_only_somewhat_alike_is_not_suggested() -> None:
    known = ["force_scale", "friction", "method"]
    assert did_you_mean("reference_channel", known) == "; known: force_scale, friction, method"
