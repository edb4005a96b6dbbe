"""The measured friction loops of a tribometer, from a study on its file by the command line."""

import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.store import Store
from tests.identification.friction_records import values

RECORD = Path(__file__).parents[3] / "shared" / "data" / "tribometer" / "test_data_2.txt"
STUDY = """
[record]
file = "{file}"
sample_rate = 199.164
steps = [{{ start = 9.94, stop = 210.0, frequency = 0.248955 }}]

[record.channels]
displacement = "Position"
friction = {{ column = "Friction", unit = "uN", scale = -1 }}

[grid]
"estimator" = [
    {{ name = "friction_identification" }},
    {{ name = "friction_identification", back_propagation = true, elements = 1 }},
]
"""

pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not RECORD.exists(), reason="the measured record is not beside this checkout"),
]


def run(folder, *arguments):
    command = [sys.executable, "-m", "fraexp", "--workspace", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The stored result of each way to find the elements."""
    folder = tmp_path_factory.mktemp("tribometer")
    (folder / "studies").mkdir()
    (folder / "studies" / "tribometer.toml").write_text(STUDY.format(file=RECORD.as_posix()))
    run(folder, "run", "tribometer")
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        sweeps = store.sweeps(1)
        names = ["back-propagation" if sweep.estimator["back_propagation"] else "grid" for sweep in sweeps]
        return {name: store.result(sweep.key) for name, sweep in zip(names, sweeps, strict=True)}


@pytest.mark.parametrize("name", ["grid", "back-propagation"])
def test_the_tribometers_loops_give_force_width_and_energy(results, name):
    found = values(results[name])
    assert found["Coulomb force"] == pytest.approx(2.33, abs=0.05)
    assert found["presliding deflection"] == pytest.approx(58e-6, abs=3e-6)
    assert found["rms error, held-out cycles"] < 0.12
    assert "all sliding is at one speed" in results[name].message


def test_the_fit_is_stored_with_its_covariance(results):
    (fit,) = results["back-propagation"].fits
    assert fit.component["name"] == "rolling"
    assert fit.parameters == ("stiffness.0", "limit_force.0")
    assert fit.component["stiffness"] == pytest.approx([40.2e3], rel=0.03)
    assert (fit.standard_deviation > 0).all()
