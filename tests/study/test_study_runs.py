"""The studies of the methods, noise included, run as a user would."""

from pathlib import Path

import pytest

from fraexp.cli.main import main
from fraexp.data.results import Outcome
from fraexp.store import Store
from fraexp.study.study_file import packaged_studies
from tests.examples import some

STUDIES = sorted(path.stem for path in (packaged_studies() / "methods").glob("*.toml"))
FEWER = {
    "amplitude_map": ["excitation.points=12"],
    "feedback_compensated": ["excitation.points=8"],
    "friction_band": ["excitation.points=12"],
    "higher_order": ["excitation.points=12"],
    "response_controlled": ["excitation.points=12"],
}
"""What makes a study smaller where it takes long."""


@pytest.mark.parametrize("name", some(STUDIES, "higher_order"))
def test_a_study_of_a_method_runs_and_is_drawn(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    changes = [f"--set={text}" for text in FEWER.get(name, [])]
    assert main(["run", f"methods/{name}", "--executor", "serial", *changes]) == 0
    with Store.open("results.db", read_only=True) as store:
        sweeps = store.sweeps(1)
    assert sweeps
    assert {sweep.outcome for sweep in sweeps} <= {Outcome.OK, Outcome.NOT_SETTLED, Outcome.INACCURATE}
    figures = (tmp_path / "figures" / "methods").glob(f"{name}*.png")
    assert [figure for figure in figures if figure.stat().st_size > 10_000]
