"""The study that an import writes: valid TOML that reads back the same, or a refusal in one line."""

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fraexp.errors import StudyError
from fraexp.records.study_writer import is_same_study, study_text

NAMES = st.text(st.characters(codec="utf-8"), max_size=6)
VALUES = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | NAMES
TABLES = st.dictionaries(
    NAMES,
    st.recursive(VALUES, lambda of: st.lists(of, max_size=3) | st.dictionaries(NAMES, of, max_size=3)),
    max_size=4,
)


@given(TABLES)
def test_what_is_written_is_read_back_the_same(data: dict[str, Any]) -> None:
    assert tomllib.loads(study_text(data)) == data


def test_numbers_that_json_does_not_have_are_those_of_toml() -> None:
    text = study_text({"limit": math.inf, "low": -math.inf, "unknown": math.nan})
    assert text.split() == ["limit", "=", "inf", "low", "=", "-inf", "unknown", "=", "nan"]


def test_a_table_in_a_list_does_not_swallow_what_follows_it() -> None:
    data = {"record": {"steps": [{"start": 0, "stop": 1}], "sample_rate": 1e3, "channels": {"u": "a [A]"}}}
    assert tomllib.loads(study_text(data)) == data


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (None, "the study cannot be written as TOML"),
        ([1, None], "the study cannot be written as TOML"),
        ("run\udce9.csv", r"a name contains '\\udce9', which is invalid Unicode; rename the file or channel"),
    ],
)
def test_what_toml_cannot_express_is_refused_in_one_line(value: object, complaint: str) -> None:
    with pytest.raises(StudyError, match=complaint) as error:
        study_text({"record": {"file": value}})
    assert "\n" not in str(error.value)


def test_a_file_with_the_same_data_is_the_same_study(tmp_path: Path) -> None:
    file, data = tmp_path / "study.toml", {"title": "a", "record": {"file": "a.csv"}}
    file.write_text('record.file = "a.csv"\ntitle = "a"\n', "utf-8")
    assert is_same_study(file, data)
    assert not is_same_study(file, {**data, "title": "b"})
    file.write_text("title = ", "utf-8")
    assert not is_same_study(file, data)
