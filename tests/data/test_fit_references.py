"""A parameter that another sweep of the study identifies."""

from pathlib import Path

import pytest

from fraexp.cli.main import main
from fraexp.data import fit_references
from fraexp.data.sweep import Sweep
from fraexp.errors import StudyError
from fraexp.store import Store
from tests.refusals import refused

STUDY = """
title = "Identified, then used"
machine = "linear_motor_table"

[excitation]
name = "stepped_sine"
amplitude = 75.0
min_frequency = 5.0
points = 30

[[case]]
label = "positioned"
estimator = { name = "positioning_metrics" }
[case.excitation]
name = "point_to_point"
targets = [1.5e-3]
duration = 0.04
plant = { fit = "plant", case = "identified" }

[[case]]
label = "identified"
estimator = { name = "modal_fit", modes = MODES, method = { name = "effective_input" } }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(folder: Path, **changes: str) -> str:
    text = STUDY.replace("MODES", changes.pop("modes", "2"))
    for old, new in changes.items():
        text = text.replace(old, new)
    (folder / "chain.toml").write_text(text, encoding="utf-8")
    return str(folder / "chain.toml")


def test_a_fit_is_used_by_a_later_sweep_whatever_their_order_in_the_file(folder: Path) -> None:
    assert main(["run", written(folder), "--executor", "serial"]) == 0
    with Store.open("results.db", read_only=True) as store:
        positioned, identified = store.sweeps(1)
        assert positioned.experiment["excitation"]["plant"] == {"fit": "plant", "of": identified.key}
        moved = {metric.name: metric.value for metric in store.result(positioned.key).metrics}
    assert moved["overshoot"] < 4e-6  # with P_d = P it stays within the band

    assert main(["run", "chain.toml"]) == 0  # and both are reused
    with Store.open("results.db", read_only=True) as store:
        assert store.run(2).reused == 2


def test_a_fit_that_failed_fails_what_needs_it_with_the_reason(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # five points are too few for two modes
    assert main(["run", written(folder, **{"points = 30": "points = 5"}), "--executor", "serial"]) == 1
    said = capsys.readouterr().err
    assert "it needs the plant that sweep" in said
    with Store.open("results.db", read_only=True) as store:
        assert [sweep.state for sweep in store.sweeps(1)] == ["failed", "failed"]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('case = "identified" }', 'case = "identifed" }', "did you mean 'identified'?"),
        ('fit = "plant"', 'fit = "plants"', "fit is 'plants'; expected a kind of component"),
        ('case = "identified" }', 'cas = "identified" }', "a fit has no 'cas'; did you mean 'case'?"),
        ('case = "identified" }', 'case = "positioned" }', "there is no 'positioned'"),
    ],
)
def test_a_reference_that_leads_nowhere_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, complaint: str
) -> None:
    assert main(["run", written(folder, **{old: new})]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert complaint in said[0]
    assert not (folder / "results.db").exists()


def test_sweeps_take_turns_after_what_they_need() -> None:
    first = Sweep({"source": "loop"}, {"name": "a"})
    second = Sweep({"source": "loop", "excitation": {"plant": {"fit": "plant", "of": first.key}}}, {"name": "b"})
    third = Sweep({"source": "loop"}, {"name": "c", "friction": {"fit": "friction", "of": second.key}})
    assert list(fit_references.topological_batches([third, second, first])) == [[first], [second], [third]]
    assert list(fit_references.topological_batches([third])) == [[third]]  # what it needs is stored already


def test_of_several_sweeps_of_a_case_the_one_at_the_same_point_is_meant() -> None:
    sweeps = [
        Sweep({"source": "loop"}, {"name": "a", "x": x}, {"case": "identified", "excitation.amplitude": x})
        for x in (12, 75)
    ]
    reference = {"fit": "plant", "case": "identified"}
    found = fit_references.resolve_reference(
        reference, {"case": "used", "excitation.amplitude": 75}, {"identified": sweeps}, "here"
    )
    assert found == {"fit": "plant", "of": sweeps[1].key}
    with refused(StudyError, "2 sweeps"):
        fit_references.resolve_reference(reference, {"case": "used"}, {"identified": sweeps}, "here")


RANDOM = """
machine = "linear_motor_table"
excitation = { name = "point_to_point" }
[[case]]
label = "identified"
estimator = { name = "friction_identification" }
[[case]]
label = "moved"
excitation = { friction = { fit = "friction", case = "identified" } }
estimator = { name = "positioning_metrics" }
[monte_carlo]
count = 2
draw = [{ paths = "excitation.PATH", relative = 0.01 }]
"""


def test_within_what_is_identified_nothing_is_drawn(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("drawn.toml").write_text(RANDOM.replace("PATH", "friction.curve.coulomb_force"), encoding="utf-8")
    assert main(["run", "drawn.toml", "--dry-run"]) == 2
    said = capsys.readouterr().err.strip()
    assert (
        "case 'moved', [monte_carlo]: 'excitation.friction.curve.coulomb_force' lies in what { fit = 'friction' }"
        in said
    )
    assert "\n" not in said
    Path("drawn.toml").write_text(RANDOM.replace("PATH", "targets.0"), encoding="utf-8")
    assert main(["run", "drawn.toml", "--dry-run"]) == 0
