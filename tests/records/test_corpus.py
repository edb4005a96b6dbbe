"""Every file of the corpus, and every row of the table in docs/records.md, gives its response by one command."""

import json
import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.records.corpus import LAYOUTS
from tests.records.corpus_writers import Layout, plant
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
OTHERS = [name for name, layout in LAYOUTS.items() if not (layout.options and name in KINDS.values())]
"""Layouts that are not imported by a command of the page alone."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(layout: Layout, folder: Path) -> None:
    if layout.extra and find_spec(layout.extra) is None:
        pytest.skip(f"{layout.extra} is not installed")
    layout.write(folder)


def check_response(layout: Layout, folder: Path, study: str) -> None:
    (result,) = results(folder, study)
    assert result.response is not None
    assert result.response.frequency.size >= 15
    error = result.response.response / plant(result.response.frequency) - 1
    assert np.abs(error).max() < layout.tolerance


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_the_listing_proposes_rightly_or_says_what_it_lacks(
    folder: Path, layout: Layout, capsys: pytest.CaptureFixture[str]
) -> None:
    written(layout, folder)
    assert main(["import", *layout.files, "--json"]) == ExitCode.OK
    document = json.loads(capsys.readouterr().out)
    for part in layout.proposed:
        assert part in document["proposal"]
    needs = "; ".join(document["needs"])
    assert layout.needs in needs
    assert bool(layout.needs) == bool(needs)


@pytest.mark.thorough
@pytest.mark.parametrize("name", OTHERS)
def test_the_proposal_or_one_command_gives_the_response(
    folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    layout = LAYOUTS[name]
    written(layout, folder)
    command = ["import", *layout.files, *layout.options]
    if not layout.options:
        assert main(["import", *layout.files, "--json"]) == ExitCode.OK
        command = shlex.split(json.loads(capsys.readouterr().out)["proposal"])[1:]
    assert main(command) == ExitCode.OK
    check_response(layout, folder, Path(layout.files[0]).stem)


def test_the_table_is_complete() -> None:
    assert COMMANDS.keys() == KINDS.keys()


@pytest.mark.thorough
@pytest.mark.parametrize("kind", KINDS)
def test_a_command_of_the_table_gives_the_response(folder: Path, kind: str) -> None:
    layout, command = LAYOUTS[KINDS[kind]], COMMANDS[kind]
    written(layout, folder)
    files = command[2 : 2 + len(layout.files)]
    for own, stated in zip(layout.files, files, strict=True):
        (folder / own).rename(folder / stated)
    assert main(command[1:]) == ExitCode.OK
    check_response(layout, folder, Path(files[0]).stem)
