"""Units that German drives write, and remarks in the first row of LabVIEW's files."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.components.registry import Registry
from fraexp.data.units import si
from fraexp.errors import ParameterError
from fraexp.records.contents import list_contents
from fraexp.records.proposals import propose_import
from fraexp.records.quantities import si_unit

COUNT, RATE = 2000, 1000.0
WAVE = np.tile(np.random.default_rng(0).normal(size=200), COUNT // 200)


@pytest.mark.parametrize(
    ("written", "factor", "unit"),
    [
        ("Nm", 1.0, "N*m"),
        ("kNm", 1e3, "N*m"),
        ("Ncm", 0.01, "N*m"),
        ("Nmm", 1e-3, "N*m"),
        ("µNm", 1e-6, "N*m"),
        ("U/min", np.pi / 30, "rad/s"),
        ("nm", 1e-9, "m"),
        ("mN", 1e-3, "N"),
        ("Arms", 1.0, "A"),
        ("mArms", 1e-3, "A"),
        ("A(p)", 1.0, "A"),
        ("Vpk", 1.0, "V"),
        ("Amps", 1.0, "A"),
        ("Volts", 1.0, "V"),
        ("Sec", 1.0, "s"),
        ("Degrees", np.pi / 180, "rad"),
    ],
)
def test_what_drives_write_is_not_yarn_enzymes_and_speeds(written: str, factor: float, unit: str) -> None:
    assert si(written) == (pytest.approx(factor), unit)


@pytest.mark.parametrize("written", ["grad", "Grad", "grad/s", "GRAD"])
def test_grad_is_asked_for_because_it_means_two_angles(written: str) -> None:
    with pytest.raises(ParameterError, match=r"may be degrees, as in German, or gradians; give unit = deg or gon"):
        si_unit(written, "a.csv, channel 'y'")
    assert si_unit("gon", "")[0] == pytest.approx(np.pi / 200)


def test_a_german_drive_is_listed_with_the_unit_of_its_angle_open(tmp_path: Path, registry: Registry) -> None:
    rows = [f"{1000 * k / RATE:.1f};RUN;{2 * u:.5f};{u:.7f};".replace(".", ",") for k, u in enumerate(WAVE)]
    head = ["Antriebsmessung;;;;", "Gerät:;AX5206;;;", "", "Zeit;Status;Drehmoment[0];Lageistwert;", "ms;;kNm;grad;"]
    file = tmp_path / "antrieb.csv"
    file.write_text("\r\n".join([*head, *rows]) + "\r\n", encoding="latin-1")
    command = propose_import(file, list_contents(file, registry), registry).command
    assert "--channel 'u=Drehmoment[0]'" in command
    assert "--channel 'y=Lageistwert [UNIT]'" in command
    assert command.endswith("--time Zeit --samples-per-period 200")


def test_the_remark_in_the_first_row_of_labview_is_no_fault(tmp_path: Path, registry: Registry) -> None:
    head = [
        "LabVIEW Measurement",
        "Separator\tTab",
        "Multi_Headings\tNo",
        "X_Columns\tMulti",
        "***End_of_Header***",
        "",
    ]
    head += ["Channels\t2", "***End_of_Header***", "X_Value\tMotor torque\tX_Value\tEncoder\tComment"]
    rows = [f"{k / RATE:.6f}\t{u:.6f}\t{k / RATE:.6f}\t{2 * u:.6f}" for k, u in enumerate(WAVE)]
    rows[0] += "\tstart"
    file = tmp_path / "bench.lvm"
    file.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    found = list_contents(file, registry)
    assert [(one.name, one.shape, one.guess) for one in found] == [
        ("X_Value #1", (COUNT,), "time"), ("Motor torque", (COUNT,), "u"),
        ("X_Value #2", (COUNT,), "time"), ("Encoder", (COUNT,), "y"),
    ]  # fmt: skip
    command = propose_import(file, found, registry).command
    assert "--channel 'u=Motor torque [UNIT]' --channel 'y=Encoder [UNIT]'" in command
    assert command.endswith("--samples-per-period 200")
