"""The arrays of a real Sinumerik file, decoded by the standard library's base 85 and checked by physics."""

import re
from base64 import b85decode
from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.readers.sinumerik import Sinumerik

from tests.records.corpus_writers import TO_STANDARD

FILE = Path(__file__).parents[3] / "shared" / "data" / "traces" / "sinumerik_frequency_response.xml"

pytestmark = pytest.mark.skipif(not FILE.exists(), reason="the file is not beside this checkout")


def test_the_time_series_are_those_of_another_decoder() -> None:
    """Each series is one of the file's arrays, whatever element contains it."""
    reader = Sinumerik()
    names = [name for name in reader.contents(FILE) if ".series" in name]
    columns = reader.read(FILE, names).columns
    text = FILE.read_text(encoding="utf-8", errors="replace")
    found = []
    for content in re.findall(r"<raw[^>]*><!\[CDATA\[([^<>]{1000,})\]\]>", text):
        characters = "".join(content.split()).replace(".", "00000").translate(TO_STANDARD)
        found.append(np.frombuffer(b85decode(characters), ">f8"))
    assert names
    for name in names:
        assert any(np.array_equal(values, columns[name]) for values in found), name
