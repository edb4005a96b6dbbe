"""Every command of the table in docs/records.md gives the response of a file of its kind."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.records.corpus import LAYOUTS, plant
from tests.records.strangers_files import results

PAGE = Path(__file__).parents[2] / "docs/records.md"
ROW = re.compile(r"^\| (?P<kind>[^|]+) \| `(?P<command>fraexp import [^`]+)` \|$", re.MULTILINE)
SECTION = PAGE.read_text(encoding="utf-8").partition("## Which command for which file")[2].partition("\n## ")[0]
COMMANDS = {row["kind"]: shlex.split(row["command"]) for row in ROW.finditer(SECTION)}
KINDS = {
    "CSV with time and units": "comma",
    "CSV without a header": "padded columns",
    "CSV without a time column": "rate once in a column",
    "CSV with uneven time stamps": "jitter",
    "CSV with several clocks side by side": "two clocks side by side",
    "channels in two files": "two files",
    "LabVIEW text (.lvm)": "LabVIEW text",
    "TwinCAT Scope": "TwinCAT, tab",
    "Sinumerik trace": "Sinumerik trace",
    "Sinumerik frequency measurement": "Sinumerik measurement",
    "oscilloscope whose settings stand beside the samples": "settings beside the samples",
    "oscilloscope with channels called by numbers": "channels called by numbers",
    "headings such as `F/kN`": "quotients as headings",
    "servo drive with a current in Arms": "currents counted",
    "table whose first column contains labels": "labelled rows",
    "columns whose names contain signs, dates with AM and PM": "American dates",
    "MATLAB": "MATLAB 5",
    "HDF5": "HDF5 with attributes",
    "NumPy": "npz",
    "universal file 58 over time": "UFF 58 over time",
    "universal file 58 with a response": "UFF 58 response",
    "TDMS": "TDMS",
    "MDF 4 with several rates": "MDF 4, two rates",
    "MCAP": "MCAP",
    "Parquet": "Parquet",
    "Bode table in dB and degrees": "Bode in dB and degrees",
    "response of python-control as arrays": "response in NumPy",
    "response of python-control as complex numbers": "frd in python-control",
    "response of MATLAB as complex numbers": "frd in MATLAB",
    "response as text with complex numbers": "complex numbers of Python",
    "network analyser with names of traces": "names of traces",
}
"""Layout of the corpus by the kind of file that the page names."""


def test_the_table_is_complete() -> None:
    assert COMMANDS.keys() == KINDS.keys()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_a_command_of_the_table_gives_the_response(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout, command = LAYOUTS[KINDS[kind]], COMMANDS[kind]
    if layout.extra:
        pytest.importorskip(layout.extra)
    monkeypatch.chdir(tmp_path)
    layout.write(tmp_path)
    files = command[2 : 2 + len(layout.files)]
    for own, named in zip(layout.files, files, strict=True):
        (tmp_path / own).rename(tmp_path / named)
    assert main(command[1:]) == ExitCode.OK
    (result,) = results(tmp_path, Path(files[0]).stem)
    assert result.response is not None
    assert np.abs(result.response.response / plant(result.response.frequency) - 1).max() < layout.tolerance
