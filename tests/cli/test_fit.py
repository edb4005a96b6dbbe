"""``fraexp fit``: from stored responses to a plant model, and out to other programs."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import freqs

from fraexp.cli.exits import ExitCode
from fraexp.cli.fit import report_inherited
from fraexp.cli.main import main
from fraexp.components.registry import Registry
from fraexp.data.results import Outcome
from fraexp.store import Store, StoredSweep
from fraexp.workspace.fit_specs import fit_estimator
from tests.examples import thorough

STUDY = """
title = "As"
machine = "linear_motor_table"

[excitation]
name = "stepped_sine"
amplitude = 75.0
points = 40

[estimator]
name = "effective_input"
"""


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which run 1 has computed the study."""
    folder = tmp_path_factory.mktemp("table")
    (folder / "studies").mkdir()
    (folder / "studies" / "table.toml").write_text(STUDY, encoding="utf-8")
    assert main(["run", "table", "--executor=serial", "--workspace", str(folder)]) == 0
    return folder


@pytest.fixture
def computed(table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, in which a test is."""
    shutil.copytree(table, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_stored_response_is_fitted_shown_and_exported(
    computed: Path, capsys: pytest.CaptureFixture[str], registry: Registry
) -> None:
    assert main(["fit", "table", "--set", "modes=2"]) == 0
    assert "k0 [m/(N s²)]" in capsys.readouterr().out
    with Store.open(str(computed / "results.db"), read_only=True) as store:
        sweep = store.sweeps(2)[0]
        fit = store.result(sweep.key).fits[0]
    found = dict(zip(fit.parameters, fit.values, strict=True))
    assert found["rigid_body_gain"] == pytest.approx(0.132, rel=1e-3)
    assert found["frequencies.0"] == pytest.approx(38.8, abs=0.02)
    assert main(["show", sweep.key]) == 0
    shown = capsys.readouterr().out
    assert "fit of the plant" in shown
    assert '[plant]\nname = "modal"\nrigid_body_gain = 0.13' in shown
    assert main(["show", sweep.key, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fits"][0]["kind"] == "plant"

    for suffix in ("mat", "h5", "json"):
        assert main(["export", sweep.key, "-o", f"fit.{suffix}"]) == 0
    model = loadmat("fit.mat", simplify_cells=True)["fraexp"]["models"]["plant"]
    omega = 2 * np.pi * np.array([3.0, 38.8, 120.0])
    truth = registry.create("plant", fit.component).response(omega)  # type: ignore[attr-defined]
    _, response = freqs(model["numerator"], model["denominator"], omega)
    assert response == pytest.approx(truth, rel=1e-6)
    state = [model["c"] @ np.linalg.solve(1j * w * np.eye(len(model["a"])) - model["a"], model["b"]) for w in omega]
    assert np.array(state).ravel() == pytest.approx(truth, rel=1e-9)
    with h5py.File("fit.h5") as file:
        assert file["models/plant/a"].shape == (6, 6)
        assert file["fits/plant/values"][0] == pytest.approx(0.132, rel=1e-3)
    assert json.loads(Path("fit.json").read_text())["models"]["plant"]["dead_time"] == pytest.approx(0, abs=1e-5)


@pytest.mark.thorough
def test_a_fit_is_a_sweep_that_is_reused_and_fitted_anew_with_other_settings(
    computed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "1", "--set", "modes=2"]) == 0
    assert main(["fit", "1", "--set", "modes=2"]) == 0
    assert "1 reused, 0 to compute" in capsys.readouterr().err
    assert main(["fit", "table-fit", "--set", "modes=1"]) == 0  # of the response itself, not of the fit
    with Store.open(str(computed / "results.db"), read_only=True) as store:
        last = store.sweeps(4)[0].estimator
    assert last["modes"] == 1
    assert last["method"]["name"] == "effective_input"


@pytest.mark.thorough
def test_a_fit_of_a_fit_keeps_its_band_and_says_so(computed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", "1", "--set", "modes=2", "--set", "min_frequency=20", "--set", "max_frequency=150"]) == 0
    assert "own fit" not in capsys.readouterr().err
    assert main(["fit", "table-fit", "--set", "max_frequency=120", "--set", "modes="]) == 0
    told = capsys.readouterr().err
    assert "settings of the study's own fit are kept: min_frequency=20.0; reset one by --set min_frequency=" in told
    with Store.open(str(computed / "results.db"), read_only=True) as store:
        last = store.sweeps(3)[0].estimator
    assert (last["min_frequency"], last["max_frequency"], last["modes"]) == (20, 120, None)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["1", "--set", "mode=2"], "has no parameter 'mode'; did you mean 'modes'?"),
        thorough(["1", "--set", "modes"], "expected PARAMETER=VALUE"),
        thorough(["1", "--estimator", "modal_fits"], "did you mean 'modal_fit'?"),
        thorough(["9"], "there is no run 9"),
    ],
)
def test_a_wrong_wish_is_one_line(
    computed: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    assert main(["fit", *arguments]) in (ExitCode.USAGE, ExitCode.STORE)
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert complaint in said


def test_settings_that_are_kept_are_written_as_in_a_study(
    registry: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    name = fit_estimator(registry, kind="controller")
    spec = {"name": name, "method": {"name": "conventional"}, "integral_action": False}
    sweep = StoredSweep("fx2-0123456789", {}, spec, {}, Outcome.OK, (), 0.0, None, "computed")
    report_inherited([sweep], name, [], registry)
    assert "are kept: integral_action=false; reset one by --set integral_action=" in capsys.readouterr().err
