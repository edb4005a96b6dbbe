"""Numbers with units, as people write them."""

import math

import pytest

from fraexp.data.units import number, si
from fraexp.errors import ParameterError
from fraexp.records.channels import si_unit
from tests.refusals import refused


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
        ("3 dB", "dB", 3.0),
        ("5°", "rad", math.radians(5)),
        ("1e-3", "1", 1e-3),
    ],
)
def test_a_blank_before_the_unit_may_be_left_out(text, unit, value):
    assert number(text, unit) == pytest.approx(value)


@pytest.mark.parametrize("text", ["mm", "1..5 mm", "1,5 mm", "10 mmm", "10kg", "1e N", "0x10 mm"])
def test_what_is_no_number_with_such_a_unit_is_refused(text):
    with pytest.raises(ParameterError):
        number(text, "m")


def test_a_level_is_no_unit_of_a_column_or_of_another_parameter():
    for read in (lambda: si("dB"), lambda: number("3 dB", "1"), lambda: number("3 mm", "dB")):
        with pytest.raises(ParameterError):
            read()


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("rev", 2 * math.pi, "rad"),
        ("rev/s", 2 * math.pi, "rad/s"),
        ("rev/min", math.pi / 30, "rad/s"),
        ("r/min", math.pi / 30, "rad/s"),
        ("rad/s2", 1.0, "rad/s**2"),
        ("N-m", 1.0, "N m"),
        ("cNm", 0.01, "N m"),
        ("in lb", 4.4482216152605 * 0.0254, "N m"),
        ("lb-in", 4.4482216152605 * 0.0254, "N m"),
        ("ft lb", 4.4482216152605 * 0.3048, "N m"),
        ("oz-in", 4.4482216152605 / 16 * 0.0254, "N m"),
        ("Nm", 1.0, "N m"),
        ("kNm", 1e3, "N m"),
        ("Ncm", 0.01, "N m"),
        ("Nmm", 1e-3, "N m"),
        ("µNm", 1e-6, "N m"),
        ("U/min", math.pi / 30, "rad/s"),
        ("nm", 1e-9, "m"),
        ("mN", 1e-3, "N"),
        ("Arms", 1.0, "A"),
        ("mArms", 1e-3, "A"),
        ("A(p)", 1.0, "A"),
        ("Vpk", 1.0, "V"),
        ("Amps", 1.0, "A"),
        ("Volts", 1.0, "V"),
        ("Sec", 1.0, "s"),
        ("Degrees", math.pi / 180, "rad"),
    ],
)
def test_units_are_read_as_drives_write_them(unit, value, expected):
    factor, short = si(unit)
    assert short == expected
    assert factor == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("written", ["1/min", "min-1", "min^-1", "rpm", "U/min"])
def test_a_number_per_minute_is_a_rotary_speed(written):
    assert si_unit(written, "") == (pytest.approx(math.pi / 30), "rad/s")


@pytest.mark.parametrize("written", ["grad", "Grad", "grad/s", "GRAD"])
def test_grad_is_asked_for_because_it_means_two_angles(written):
    with refused(ParameterError, "a.csv", "channel 'y'", "deg", "gon"):
        si_unit(written, "a.csv, channel 'y'")
    assert si_unit("gon", "")[0] == pytest.approx(math.pi / 200)
