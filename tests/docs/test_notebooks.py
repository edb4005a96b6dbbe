"""The notebooks are executed as they stand, and what they find is right by number."""

import json
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOTEBOOKS = {path.stem: path for path in (ROOT / "docs/notebooks").glob("*.ipynb")}
CHECKS = {
    "paper": """
assert abs(float(difference.sel(estimator="effective_input").sel(frequency=10, method="nearest"))) < 0.05
assert float(difference.sel(estimator="conventional").sel(frequency=10, method="nearest")) < -10
assert (moves.to_pandas()["settling time"].dropna() < 0.05).all()
""",
    "friction_law": """
assert largest_error < 1e-5
assert np.median(error_in_db(effective_input)) < 0.1 < 5 < np.median(error_in_db(conventional))
""",
    "measured_record": """
assert abs(fitted.models["plant"]["rigid_body_gain"] / 0.132 - 1) < 3e-3
assert abs(fitted.models["plant"]["frequencies"][0] / 38.8 - 1) < 1e-3
assert 10 < phase_margin < 80
assert run[0].outcome == "ok"
""",
    "methods": """
found = {name: row["error [dB]"] for name, row in table.items()}
assert found["conventional"] > 10
assert found["effective input"] < 0.5 < found["effective input, force 10 % too large"]
assert found["maximum likelihood, force 10 % too large"] < 0.2
assert abs(likelihood.metrics["force_scale"] * 1.1 - 1) < 1e-3
""",
    "monte_carlo": """
assert set(near.groupby("estimator").size()) == {24}
assert drawn.astype(float).corr().magnitude_dB["coulomb_force"] < -0.5
""",
}
"""What holds at the end of each notebook."""
FEWER = {"monte_carlo": {'\\"count\\": 200': '\\"count\\": 24', '\\"points\\": 16': '\\"points\\": 6'}}
"""Parts of the file of a notebook that takes long, and what stands in their place."""


def test_each_notebook_is_checked() -> None:
    assert NOTEBOOKS.keys() == CHECKS.keys()


@pytest.mark.parametrize("name", CHECKS)
def test_each_code_cell_that_shows_something_shows_it_on_its_page(name: str) -> None:
    notebook = json.loads(NOTEBOOKS[name].read_text("utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["execution_count"] for cell in cells), "run: .venv/bin/python docs/run_notebooks.py"
    assert sum(bool(cell["outputs"]) for cell in cells) > len(cells) / 2
    assert not any(output["output_type"] == "error" for cell in cells for output in cell["outputs"])


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.filterwarnings("ignore")  # of the messaging between the kernel and the test
def test_a_notebook_holds_what_it_says(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    text = NOTEBOOKS[name].read_text("utf-8")
    for long, short in FEWER.get(name, {}).items():
        assert long in text
        text = text.replace(long, short)
    (tmp_path / "shorter.ipynb").write_text(text, "utf-8")
    runpy.run_path(str(ROOT / "docs/run_notebooks.py"))["execute"](tmp_path / "shorter.ipynb", CHECKS[name])
