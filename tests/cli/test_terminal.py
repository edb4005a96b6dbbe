import pytest

from fraexp.cli.output import print_table
from fraexp.data.texts import printable
from fraexp.views.words import duration_text, flatten, value_text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("µm, 2 °, Ÿ", "µm, 2 °, Ÿ"),
        ("\x1b]0;title\x07", r"\x1b]0;title\x07"),
        ("\x9b31m", r"\x9b31m"),
        ("two\nlines\r", r"two\nlines\r"),
        ("a\u202eb\u2066", r"a\u202eb\u2066"),
    ],
)
def test_only_control_characters_are_written_out(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_numbers_stand_right_and_empty_columns_are_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(["name", "gain [dB]", "nothing"], [["a", "-3.1", ""], ["long", "12.5", ""]])
    assert capsys.readouterr().out == "name  gain [dB]\na          -3.1\nlong       12.5\n"


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.123, "0.12 s"), (42.4, "42 s"), (59.99, "60 s"), (185, "3 min 05 s"), (3725, "1 h 02 min")]
)
def test_durations(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_nested_data_is_flattened_by_path() -> None:
    data = {"a": {"b": 1.5}, "modes": [{"f": 38.8}, {"f": 80.0}], "list": [1, 2], "none": {}}
    assert flatten(data) == {"a.b": 1.5, "modes.0.f": 38.8, "modes.1.f": 80.0, "list": [1, 2], "none": {}}
    assert value_text([0.5, 1.0, 2.0, 4.0, 8.0]) == "[0.5, ..., 8] (5 values)"
