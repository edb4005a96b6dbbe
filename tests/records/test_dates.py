"""Dates with times of day as time stamps of text files."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from fraexp_plugins.readers.csv_reader import CsvReader

from fraexp.errors import RecordError

START = datetime(2026, 12, 31, 23, 59, 59, 500_000)  # passes midnight, and the end of a year
COUNT, STEP_US = 2000, 500
LAYOUTS = {
    "iso": ("%Y-%m-%dT%H:%M:%S.%f", ","),
    "blank": ("%Y-%m-%d %H:%M:%S.%f", "\t"),
    "zone": ("%Y-%m-%dT%H:%M:%S.%f+01:00", ";"),
    "day first": ("%d.%m.%Y %H:%M:%S,%f", ";"),
}


def write(path: Path, form: str, delimiter: str) -> None:
    moments = (START + timedelta(microseconds=STEP_US * number) for number in range(COUNT))
    rows = [delimiter.join((moment.strftime(form), f"{n % 7}.25")) for n, moment in enumerate(moments)]
    path.write_text("\n".join([delimiter.join(("When", "Force [N]")), *rows]) + "\n")


@pytest.mark.parametrize("name", LAYOUTS)
def test_dates_are_seconds(tmp_path: Path, name: str) -> None:
    write(tmp_path / "log.csv", *LAYOUTS[name])
    reader = CsvReader()
    assert reader.contents(tmp_path / "log.csv") == {"When": ((COUNT,), "s"), "Force": ((COUNT,), "N")}
    table = reader.read(tmp_path / "log.csv", ["When", "Force"])
    seconds = 86399.5 + STEP_US * 1e-6 * np.arange(COUNT)
    np.testing.assert_allclose(table.columns["When"], seconds, rtol=0, atol=1e-9)
    assert table.columns["Force"][:3].tolist() == [0.25, 1.25, 2.25]


@pytest.mark.parametrize("cell", ["2026-13-01T00:00:00", "yesterday", "2026-12-31"])
def test_a_cell_that_is_no_date_is_named(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "log.csv"
    write(path, *LAYOUTS["iso"])
    lines = path.read_text().splitlines()
    lines[1500] = f"{cell},1.0"
    path.write_text("\n".join(lines))
    with pytest.raises(RecordError, match=rf"log\.csv, line 1501: '{cell}' in column 'When' is not a finite number"):
        CsvReader().read(path, ["When", "Force"])
