"""Texts of channels: names of columns that contain signs are written in quotes."""

import numpy as np
import pytest
from fraexp_plugins.readers._shared.heading_rows import names_and_units, stated_sample_time

from fraexp.records.channels import Channel, column_text, parse_channel


@pytest.mark.parametrize("name", ["Amplitude - Force", "a * 2", "iq [0]", "(a + b) / 3", "a - b - c"])
def test_a_name_with_signs_is_written_in_quotes(name: str) -> None:
    assert column_text(name) == f'"{name}"'
    assert parse_channel(column_text(name), "") == Channel(column=name)
    assert parse_channel(f"{column_text(name)} / 4", "") == Channel(column=name, scale=0.25)
    assert parse_channel(f"{column_text(name)} * 2.5 + 1 [N]", "") == Channel(
        column=name, scale=2.5, offset=1, unit="N"
    )


@pytest.mark.parametrize("name", ["force", "Channel A", "r482[0]: Encoder 1", "iq[0]", "a-b"])
def test_another_name_is_written_as_it_is(name: str) -> None:
    assert column_text(name) == name


@pytest.mark.parametrize(
    ("headings", "found"),
    [
        (["t/s", "F/kN"], [("t", "s"), ("F", "kN")]),
        (["Zeit / s", "v / (mm/s)", "Status"], [("Zeit", "s"), ("v", "mm/s"), ("Status", None)]),
        (["Time, s", "Force, N"], [("Time", "s"), ("Force", "N")]),
        (["Frequency in Hz", "Phase in °"], [("Frequency", "Hz"), ("Phase", "°")]),
        (["m/s", "mm/s"], [("m/s", None), ("mm/s", None)]),
        (["time", "ratio/N"], [("time", None), ("ratio/N", None)]),
        (["/axis/effort/N", "/axis/position/m"], [("/axis/effort/N", None), ("/axis/position/m", None)]),
        (["t/s", "x [mm]"], [("t/s", None), ("x", "mm")]),
    ],
)
def test_quotients_are_units_where_all_headings_say_so(
    headings: list[str], found: list[tuple[str, str | None]]
) -> None:
    assert names_and_units(headings) == found


@pytest.mark.parametrize(
    ("line", "comma", "seconds"),
    [
        ("Abtastzeit [ms];0,5", True, 5e-4),
        ("Abtastrate;2,0 kHz", True, 5e-4),
        ("Sample time: 1,000 ms", True, 1e-3),
        ("Sample time: 1,000 ms", False, None),
        ('"Sample Period:","1 ms"', False, 1e-3),
        ("Sample interval (s), 4e-4", False, 4e-4),
        ("Sample rate [kHz]: 2.5", False, 4e-4),
        ("#Recording Frequency: 2000 Hz", False, 5e-4),
        ("Sample rate: 0", False, None),
        ("Abtastzeit: 400 µs", False, 4e-4),
        ("dt = 0.4 m\u017f", False, None),
        ("dt = 1.2.3 ms", False, None),
        ("fs" + " " * 100_000, False, None),
    ],
)
def test_a_sample_time_is_read_with_the_tables_decimal_sign(line: str, comma: bool, seconds: float | None) -> None:
    found = stated_sample_time([line], [], comma)
    assert found == (seconds if seconds is None else pytest.approx(seconds))


def test_a_rate_that_is_the_same_in_each_column_is_the_records() -> None:
    assert stated_sample_time([], [["SampleRate", "1000.0", "1000.0"]], False) == pytest.approx(1e-3)
    assert stated_sample_time([], [["SampleRate", "1000.0", "500.0"]], False) is None
    assert stated_sample_time([], [["X", "Increment"], ["Sequence", "1e-3"]], False) == pytest.approx(1e-3)
    assert np.isclose(stated_sample_time(["dt = 0.4 ms"], [], False) or 0.0, 4e-4)
