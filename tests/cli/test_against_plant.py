"""Cases of one plant: their errors after a run, as a table, as JSON and as a figure."""

import json
from pathlib import Path

import numpy as np
import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.components.registry import Registry, discover
from fraexp.simulation.machine import reference_response

STUDY = """
machine = "linear_motor_table"
figure = "errors"
[excitation]
name = "stepped_sine"
amplitude = 75
frequencies = [20, 40, 80]
settling_timeout = 2
[[case]]
label = "as measured"
estimator = { name = "conventional", refer_to_plant = true }
[[case]]
label = "friction taken off"
estimator = { name = "effective_input" }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which run 1 has computed both cases."""
    folder = tmp_path_factory.mktemp("cases")
    (folder / "studies").mkdir()
    (folder / "studies/cases.toml").write_text(STUDY)
    assert main(["run", "cases", "--executor", "serial", "--workspace", str(folder)]) == ExitCode.OK
    return folder


def printed(folder: Path, capsys: pytest.CaptureFixture[str], *line: str) -> tuple[str, str]:
    assert main([*line, "--workspace", str(folder)]) == ExitCode.OK
    output = capsys.readouterr()
    return output.out, output.err


def test_a_run_of_cases_ends_with_their_errors(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, err = printed(folder, capsys, "run", "cases")
    table = out.partition("error against P(jω) in dB\n")[2].splitlines()
    assert table[0].split()[:8] == ["sweep", "name", "20", "Hz", "39", "Hz", "80", "Hz"]
    assert "stroke [mm]  peak force [N]  measuring time [s]" in table[0]
    row = table[2].split()
    assert row[1:4] == ["friction", "taken", "off"]
    assert max(abs(float(cell)) for cell in row[4:7]) < 0.01
    assert "error against P(jω) in degrees" in out
    assert "errors are those at the nearest settled frequency, up to 2.6 % away" in err
    assert "as measured" in out.splitlines()[2], "the case is a column of the table of sweeps"


def test_the_errors_as_json_are_those_of_the_response(
    folder: Path, registry: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["compare", "1", "--against", "plant", "--frequencies", "20,39,60", "--json"]
    document = json.loads(printed(folder, capsys, *line)[0])
    first, second = document["sweeps"]
    assert (first["name"], second["labels"]) == ("as measured", {"case": "friction taken off"})
    near, far = first["errors"][0], first["errors"][2]
    assert (near["at"], far) == (20, {"at": 60, "frequency": None, "magnitude_db": None, "phase_deg": None})
    shown = json.loads(printed(folder, capsys, "show", first["key"], "--json")[0])
    response = shown["response"]["real"][0] + 1j * shown["response"]["imaginary"][0]
    plant = reference_response(shown["experiment"], np.array([near["frequency"]]), discover(folder / "plugins"))[0]
    assert near["magnitude_db"] == pytest.approx(20 * np.log10(abs(response / plant)))
    assert near["phase_deg"] == pytest.approx(np.degrees(np.angle(response / plant)))
    assert [metric["name"] for metric in first["cost"]] == ["stroke", "peak force", "measuring time"]


def test_frequencies_that_nobody_has_are_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, err = printed(folder, capsys, "compare", "1", "--against", "plant", "--frequencies", "20,30,60")
    assert "20 Hz" in out
    assert "30 Hz" not in out
    assert "no response has a settled frequency within 5 % of 30, 60 Hz" in err


@pytest.mark.thorough
def test_the_study_names_its_figure_and_plot_may_ask_for_another(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (folder / "figures/cases.png").read_bytes().startswith(b"\x89PNG")
    target = folder / "one.svg"
    for kind in ("errors", "bode"):
        printed(folder, capsys, "plot", "1", "--kind", kind, "-o", str(target))
        assert ("Magnitude error [dB]" in target.read_text("utf-8")) == (kind == "errors")
    assert main(["plot", "1", "--kind", "amplitude_map", "-o", str(target), "--workspace", str(folder)])
    assert 'vary "excitation.amplitude" in [grid]' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("compare 1 --against plan", "unknown WHAT 'plan'; did you mean 'plant'?"),
        ("compare 1 --frequencies 20", "--frequencies needs --against plant"),
        ("compare 1 --against plant --frequencies 20,x", "'20,x' is invalid; expected frequencies [Hz] above 0"),
        ("compare 1 --against plant --frequencies -1", "is invalid; expected frequencies"),
        ("plot 1 --kind error -o x.png", "unknown KIND 'error'; did you mean 'errors'?"),
    ],
)
def test_what_is_wrong_is_one_line(folder: Path, line: str, sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*line.split(), "--workspace", str(folder)]) == ExitCode.USAGE
    err = capsys.readouterr().err
    assert sentence in err
    assert err.count("\n") == 1


def test_a_frequency_that_no_response_reaches_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, err = printed(folder, capsys, "compare", "1", "--against", "plant", "--frequencies", "40,9000")
    assert err.splitlines()[-1] == "no response reaches 9000 Hz"
