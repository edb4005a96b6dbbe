"""Separators of thousands are no decimal separators: 1.234 nm in place of 1234 nm would be a wrong response."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.kinds import RecordReader
from fraexp.components.registry import Registry, create
from fraexp.errors import RecordError

VALUES = np.round(3000 * np.sin(np.arange(60.0)))


def read(tmp_path: Path, registry: Registry, rows: list[str], header: str = "t [s];F [N];x [nm]") -> np.ndarray:
    (tmp_path / "a.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    table = create(registry, RecordReader, {"name": "csv"}, place="here").read(tmp_path / "a.csv", ["x [nm]"])
    return np.asarray(table.columns["x [nm]"])


@pytest.mark.parametrize(
    ("time", "separator"),
    [("{:.3f}", ","), ("{:.3f}", "."), ("{:d}", ",")],
    ids=["commas beside decimal points", "points beside decimal commas", "commas beside whole numbers"],
)
def test_separators_of_thousands_are_refused(tmp_path: Path, registry: Registry, time: str, separator: str) -> None:
    decimal = "," if separator == "." else "."
    stamps = [time.format(k if "d" in time else k / 1000).replace(".", decimal) for k in range(VALUES.size)]
    grouped = [f"{int(value):,}".replace(",", separator) for value in VALUES]
    rows = [f"{t};1{decimal if '.' in time or 'f' in time else ''}5;{x}" for t, x in zip(stamps, grouped, strict=True)]
    with pytest.raises(
        RecordError, match=r"line \d+: '-?\d\W\d{3}' in column 'x \[nm\]' may be -?\d{4} or -?\d\.\d{3}"
    ):
        read(tmp_path, registry, rows)


def test_three_decimals_behind_a_comma_are_decimals(tmp_path: Path, registry: Registry) -> None:
    rows = [f"{k / 1000:.3f};1,5;{value / 1000:.3f}".replace(".", ",") for k, value in enumerate(VALUES)]
    assert np.allclose(read(tmp_path, registry, rows), VALUES / 1000)


def test_a_column_of_time_with_points_beside_decimal_commas_is_read(tmp_path: Path, registry: Registry) -> None:
    rows = [f"{k / 1000:.3f};1,5;" + f"{value / 1000:.6f}".replace(".", ",") for k, value in enumerate(VALUES)]
    assert np.allclose(read(tmp_path, registry, rows), VALUES / 1000)


def test_a_clock_in_an_unknown_unit_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{k},{np.sin(k)},{k},{np.cos(k)}" for k in range(60))
    (tmp_path / "a.csv").write_text(f"time [fortnight],F [N],time [fortnight],x [m]\n{rows}\n", encoding="utf-8")
    words = ["import", str(tmp_path / "a.csv"), "--channel", "u=F", "--channel", "y=x", "--samples-per-period", "20"]
    assert main([*words, "--workspace", str(tmp_path)]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "a column of time is in 'fortnight'; expected one of s, ms" in said
    assert said.count("\n") == 1
