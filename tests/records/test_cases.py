"""Files as strangers have them, in a folder beside the repository that is not always there."""

import json
import shutil
from pathlib import Path

import pytest

from fraexp.cli.main import main
from tests.examples import thorough

CASES = Path(__file__).parents[3] / "shared/cases"
EXPECTED = {
    "unit-1e-3mm": (2, "'1e-3 mm'"), "unit-cts": (2, "'cts'"), "unit-G": (2, "'G'"), "unit-kg-cm": (2, "'kg cm'"),
    "unit-lb": (2, "lbf"), "unit-pu": (2, "factor"), "unit-RPM": (0, "ok  "), "unit-Deg": (0, "ok  "),
    "time-us": (0, "sample time 1000 s"), "time-ns-remedy": (2, "time [ns]"), "time-TimeUS-remedy": (2, "TimeUS [us]"),
    "time-excel": (2, "day"), "stale-position-4": (0, "every so many samples"), "suffix-pos_mm": (2, "mm"),
    "phase-rad-no-unit": (2, "[rad]"), "fft-mirrored": (2, "conjugate"), "lfs-csv": (2, "Git LFS"),
    "lfs-mat": (2, "Git LFS"), "last-line-cut": (2, "last line"), "drift-of-input": (0, "each period 1.2 N"),
    "uff-cut": (2, "30 points, and its header states 40"), "uff-164-mm": (2, "mm/N is stated"),
    "mat-object": (0, "a MATLAB object (timeseries)"), "npz-objects": (2, "'u' contains objects"),
    "comsol": (0, "--channel real=u.real --channel imaginary=u.imaginary"), "excel-complex-comma": (0, "-25.86"),
    "servo-trace-speed": (0, "u=Torque [UNIT]' --channel 'y=Servo motor speed [UNIT]' --time Time"),
    "friction-from-speed": (0, "0.080021"), "fit-grounded-stage": (0, "2999.99988 ± 0.00047"),
    "fit-viscous-not-named": (0, "24.9 ± 3.4"),
}  # fmt: skip
"""Exit code of the import, or of the fit behind it, and what they say."""
SLIDING = (
    "friction_identification",
    'estimator.laws=["coulomb"]',
    "estimator.max_frequency=50",
    "estimator.zero_order_hold=false",
)
"""What the estimator that one of the cases names is today, with the settings that its messages ask for."""


@pytest.mark.skipif(not CASES.is_dir(), reason="the folder of cases is not there")
@pytest.mark.parametrize("name", [thorough(name) if name.startswith("fit") else name for name in EXPECTED])
def test_a_stranger_is_understood_or_told_why_not(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (case,) = (of for of in json.loads((CASES / "index.json").read_text("utf-8")) if of["id"] == name)
    shutil.copytree(CASES / name, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    code, words = EXPECTED[name]
    if "sliding_identification" in case["args"]:
        case["args"][-1:] = [SLIDING[0], *(word for setting in SLIDING[1:] for word in ("--set", setting))]
    found = main(["import", *case["args"]])
    assert (main(case["extra"].split()[1:]) if case["extra"] else found) == code
    assert words in "".join(capsys.readouterr())
