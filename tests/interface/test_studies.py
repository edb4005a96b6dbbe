"""A study in Python is the study in TOML: the same keys, the same sweeps, the same reuse, convertible both ways."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fraexp
from fraexp.data import toml
from fraexp.interface.study_source import resolve_study
from fraexp.study.catalogue import catalogue
from fraexp.workspace.workspace_service import WorkspaceService
from tests.examples import some
from tests.interface.conftest import POINTS
from tests.refusals import refused

EXAMPLES = {entry.name: entry.file for entry in catalogue(Path())}
TEXTS = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=8)
PLAIN = st.recursive(
    st.one_of(TEXTS, st.booleans(), st.integers(-(2**60), 2**60), st.floats(allow_nan=False)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS.filter(bool), inner, max_size=3),
    max_leaves=8,
)


def test_the_same_study_is_not_computed_again(workspace: fraexp.Workspace) -> None:
    study = fraexp.Study(
        "written_in_python",
        machine="linear_motor_table",
        excitation={"name": "stepped_sine", "points": np.int64(POINTS)},
        grid={
            "excitation.amplitude": np.array([12.0, 75.0]),
            "estimator": [{"name": "conventional", "refer_to_plant": True}, "effective_input"],
        },
    )
    assert workspace.plan(study)["missing"] == 0
    run = workspace.run(study, progress=False)
    assert [of.key for of in run] == [of.key for of in workspace.open_run(1)]


def test_a_value_that_is_given_twice_is_said_to_be_one_sweep(
    workspace: fraexp.Workspace, capfd: pytest.CaptureFixture[str]
) -> None:
    study = fraexp.Study(
        "twice",
        machine="linear_motor_table",
        excitation={"name": "stepped_sine", "points": POINTS},
        estimator={"name": "conventional", "refer_to_plant": True},
        grid={"excitation.amplitude": [75, 75.0, "75 N"]},
    )
    assert len(workspace.run(study)) == 1
    assert "2 of 3 points of the grid repeat another one, and are one sweep with it" in capfd.readouterr().err


@pytest.mark.parametrize("name", some(EXAMPLES, *list(EXAMPLES)[::8]))
def test_every_example_means_the_same_in_python(name: str, tmp_path: Path) -> None:
    service = WorkspaceService.open(tmp_path)
    study = fraexp.Study.from_file(EXAMPLES[name])
    again = fraexp.Study.from_toml(study.to_toml(), study.name, EXAMPLES[name].parent)
    assert again == study
    (file,) = service.studies([name])
    written = resolve_study(again, tmp_path, service.registry)
    assert [sweep.key for sweep in written.sweeps] == [sweep.key for sweep in file.sweeps]
    assert [sweep.labels for sweep in written.sweeps] == [sweep.labels for sweep in file.sweeps]


def test_a_saved_study_finds_its_records(tmp_path: Path) -> None:
    rows = np.column_stack([np.sin(np.arange(4000) * np.pi / 50), np.cos(np.arange(4000) * np.pi / 50)])
    np.savetxt(tmp_path / "bench.csv", rows, delimiter=",", header="u,y", comments="")
    record = {"file": "bench.csv", "sample_rate": 1000.0, "samples_per_period": 100}
    channels = {"u": {"column": "u", "unit": "N"}, "y": {"column": "y", "unit": "m"}}
    study = fraexp.Study("bench", tmp_path, record={**record, "channels": channels}, estimator="conventional")
    study.save(tmp_path / "studies" / "bench.toml")
    workspace = fraexp.Workspace(tmp_path)
    first = workspace.run(study, progress=False)
    assert workspace.plan("bench") == {"total": 1, "reused": 1, "missing": 0, "seconds": 0.0, "like": 0, "unlike": 0}
    assert abs(first[0].response[0]) == pytest.approx(1.0)
    with refused(fraexp.FraexpError, "bench.toml", "force=True"):
        study.save(tmp_path / "studies" / "bench.toml")


@pytest.mark.thorough
def test_changes_are_those_of_the_command_line(tmp_path: Path) -> None:
    workspace = fraexp.Workspace(tmp_path)
    changes = {"excitation.points": POINTS, "grid.excitation.amplitude": [75.0], "excitation.max_frequency": "150 Hz"}
    run = workspace.run("quick", changes, progress=False)
    assert len(run) == 2
    assert run[0].frequency.max() == pytest.approx(150, rel=0.05)


@given(PLAIN)
def test_any_value_reads_back_from_its_text(value: object) -> None:
    assert toml.value(toml.dumps(value)) == value


@pytest.mark.parametrize(
    ("keys", "names"),
    [
        ({"excitation": object()}, ["<object object"]),
        ({"excitaton": "stepped_sine"}, ["'excitaton'", "'excitation'"]),
        ({"machine": "linear_motor", "excitation": "chirp", "estimator": "conventional"}, ["'linear_motor_table'"]),
        ({}, ["[excitation]", "[estimator]"]),
    ],
)
def test_what_does_not_fit_is_named(keys: dict[str, object], names: list[str], workspace: fraexp.Workspace) -> None:
    with refused(fraexp.FraexpError, *names):
        workspace.run(fraexp.Study("wrong", **keys))


@pytest.mark.parametrize("name", ["", "../up", "a b", "/root", "-x", "a/../b"])
def test_a_name_that_is_no_file_name_is_refused(name: str) -> None:
    with refused(fraexp.FraexpError, "study name", repr(name)):
        fraexp.Study(name)


def test_no_toml_is_refused() -> None:
    with refused(fraexp.FraexpError, "study", "TOML"):
        fraexp.Study.from_toml("a = ")


@pytest.mark.parametrize(
    ("path", "names"),
    [
        ("/proc/abc.toml", ["/proc/abc.toml"]),
        ("/dev/null/abc", ["/dev/null/abc.toml"]),
        ("a" * 300, ["a" * 300]),
        ("abc.txt", ["abc.txt", "'.txt'", "abc.toml"]),
        ("", ["'.'", "studies/x.toml"]),
        ("a\0b", ["path", r"'a\x00b'"]),
    ],
)
def test_a_place_that_cannot_be_written_is_one_line(path: str, names: list[str]) -> None:
    with refused(fraexp.FraexpError, *names):
        fraexp.Study("x").save(path)


def test_a_saved_study_gets_its_ending(tmp_path: Path) -> None:
    file = fraexp.Study("x", machine="linear_motor_table").save(tmp_path / "studies" / "abc")
    assert file == tmp_path / "studies" / "abc.toml"
    with refused(fraexp.FraexpError, file, "force=True"):
        fraexp.Study("x").save(tmp_path / "studies" / "abc")


def test_a_long_name_is_refused_before_a_file_system_does() -> None:
    with refused(fraexp.FraexpError, "300 letters", 100):
        fraexp.Study("a" * 300)
    with refused(fraexp.FraexpError, f"'{'a' * 60}'"):
        fraexp.Workspace().run("a" * 300)
    with refused(fraexp.FraexpError, "a" * 300):
        fraexp.Workspace("a" * 300)
    with refused(fraexp.FraexpError, __file__, Path(__file__).parent):
        fraexp.Workspace(__file__)
