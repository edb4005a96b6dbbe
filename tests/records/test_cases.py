"""Files as strangers have them, in a folder beside the repository that is not always there."""

import json
import shutil
from pathlib import Path

import pytest

from fraexp.cli.main import main

CASES = Path(__file__).parents[3] / "shared/cases"
EXPECTED = {
    "unit-1e-3mm": (2, "'1e-3 mm'"), "unit-cts": (2, "'cts'"), "unit-G": (2, "'G'"), "unit-kg-cm": (2, "'kg cm'"),
    "unit-lb": (2, "lbf"), "unit-pu": (2, "factor"), "unit-RPM": (0, "ok  "), "unit-Deg": (0, "ok  "),
    "time-us": (0, "sample time 1000 s"), "time-ns-remedy": (2, "time [ns]"), "time-TimeUS-remedy": (2, "TimeUS [us]"),
    "time-excel": (2, "day"), "stale-position-4": (0, "every so many samples"), "suffix-pos_mm": (2, "mm"),
    "phase-rad-no-unit": (2, "[rad]"), "fft-mirrored": (2, "conjugate"), "lfs-csv": (2, "Git LFS"),
    "lfs-mat": (2, "Git LFS"), "last-line-cut": (2, "last line"),
}  # fmt: skip
"""Exit code of the import, and what it says."""


@pytest.mark.skipif(not CASES.is_dir(), reason="the folder of cases is not there")
@pytest.mark.parametrize("name", EXPECTED)
def test_a_stranger_is_understood_or_told_why_not(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (case,) = (of for of in json.loads((CASES / "index.json").read_text("utf-8")) if of["id"] == name)
    shutil.copytree(CASES / name, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    code, words = EXPECTED[name]
    assert main(["import", *case["args"]]) == code
    assert words in "".join(capsys.readouterr())
