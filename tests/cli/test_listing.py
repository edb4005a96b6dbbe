"""Lists of studies and sweeps, tags and deletion on the command line."""

import json
import os
import pty
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import Store, StoredSweep
from fraexp.views.listing import fit_columns, listing_columns
from fraexp.workspace.workspace_service import WorkspaceService
from tests.cli.conftest import ROOT
from tests.waiting import HANG_TIMEOUT_S


@pytest.fixture
def folder(workspace, tmp_path, monkeypatch) -> Path:
    """A copy of the workspace, in which the tests are."""
    shutil.copy(workspace / "results.db", tmp_path / "results.db")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(capsys, *arguments: str, code: int = ExitCode.OK) -> tuple[str, str]:
    """Run a command and return what it printed on stdout and stderr."""
    assert main(arguments) == code
    told = capsys.readouterr()
    return told.out, told.err


def test_sweeps_are_listed_that_a_filter_finds(folder, capsys):
    out, _ = said(capsys, "list", "friction=dahl", "outcome=ok")
    assert "hysteresis" in out
    assert len(out.splitlines()) == 2
    assert "dahl" in out


def test_all_sweeps_are_listed_in_parts_and_what_is_left_out_is_told(folder, capsys):
    out, err = said(capsys, "list", "--sweeps", "--limit", "2")
    assert len(out.splitlines()) == 3
    assert "3 more sweeps of 5" in err


def test_sweeps_are_sorted(folder, capsys):
    rising = json.loads(said(capsys, "list", "--sweeps", "--sort", "key", "--json")[0])["sweeps"]
    falling = json.loads(said(capsys, "list", "--sweeps", "--sort", "-key", "--json")[0])["sweeps"]
    keys = [sweep["key"] for sweep in rising]
    assert keys == sorted(keys)
    assert [sweep["key"] for sweep in falling] == keys[::-1]


def test_a_list_of_sweeps_as_json_says_how_many_there_are(folder, capsys):
    document = json.loads(said(capsys, "list", "estimator=h1", "--limit", "1", "--json")[0])
    assert document["total"] == 2
    assert len(document["sweeps"]) == 1
    assert {"key", "labels", "state", "outcome", "tags", "run", "study"} <= set(document["sweeps"][0])


def test_a_filter_that_finds_nothing_says_so(folder, capsys):
    assert said(capsys, "list", "estimator:nobody") == ("", "no sweep matches estimator:nobody\n")


@pytest.mark.thorough
def test_compare_and_plot_take_a_filter_of_a_run_or_of_all_sweeps(folder, capsys):
    listed = json.loads(said(capsys, "list", "estimator=h1", "--json")[0])["sweeps"]
    for named in (["1", "--filter", "estimator=h1"], ["--filter", "estimator=h1"]):
        compared = json.loads(said(capsys, "compare", *named, "--json")[0])["sweeps"]
        assert {of["key"] for of in compared} == {of["key"] for of in listed}
    assert len(compared) == 2
    said(capsys, "plot", "1", "--filter", "estimator=h1", "-o", "some.svg")
    assert (folder / "some.svg").is_file()
    said(capsys, "compare", "1", "--filter", "estimator=nobody", code=ExitCode.USAGE)
    _, err = said(capsys, "plot", "-o", "none.svg", code=ExitCode.USAGE)
    assert "no sweeps are named" in err
    assert not (folder / "none.svg").exists()


def test_a_run_of_which_nothing_can_be_used_is_not_called_complete(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    sweeps = [Sweep({"source": "loop", "n": n}, {"name": "conventional"}) for n in range(2)]
    with Store.open("results.db", create=True) as store:
        for outcome in (Outcome.OK, Outcome.DIVERGED):
            run = store.begin_run("bench", "bench.toml", "fraexp run bench", {}, sweeps)
            store.save(run, [(sweeps[0], Result(outcome), {}), (sweeps[1], Result(Outcome.DIVERGED), {})])
            store.end_run(run, "complete")
    runs = json.loads(said(capsys, "list", "--json")[0])["runs"]
    assert [of["unusable"] for of in runs] == [2, 2]
    assert said(capsys, "list")[0].count("no usable result") == 2
    assert "2 computed, 0 reused, 0 failed, 2 without a usable result" in said(capsys, "show", "2")[0]
    with Store.open("results.db") as store:
        store.save(2, [(sweeps[0], Result(Outcome.OK), {})])
    assert said(capsys, "list")[0].count("complete") == 2


def test_headings_have_the_units_of_parameters_in_groups_and_lists():
    labels = {
        "excitation.amplitude": 12.0,
        "friction.curve.characteristic_displacement": 4e-5,
        "plant.frequencies.0": 39,
    }
    curve, frequencies = {"coulomb_force": 17.5, "characteristic_displacement": 4e-5}, [39.0]
    experiment = {
        "friction": {"name": "rolling", "curve": curve},
        "plant": {"name": "modal", "frequencies": frequencies},
        "excitation": {"name": "stepped_sine", "amplitude": 12.0},
    }
    row = StoredSweep(
        "fx2-0123456789abcdef", experiment, {"name": "conventional"}, labels, Outcome.OK, (), 0.5, None, "computed",
        run=7, study="bench",
    )  # fmt: skip
    registry = WorkspaceService.open(ROOT, None).registry
    columns = {of.title: of.cells for of in listing_columns([row], one_run=True, running={}, registry=registry)}
    wanted = {"amplitude [N]": ("12",), "characteristic_displacement [µm]": ("40",), "frequencies.0 [Hz]": ("39",)}
    assert columns.items() >= wanted.items()
    merged = fit_columns(list(listing_columns([row] * 2, one_run=True, running={}, registry=registry)), 60)
    texts = {column.title: column.cells[0] for column, _ in merged}
    assert texts["labels"] == "12 N, 40 µm, 39 Hz, conventional"
    drawn = replace(row, labels={"excitation.amplitude": 12.0, "draw": 3, "friction.curve.coulomb_force": 17.5})
    merged = fit_columns(list(listing_columns([drawn], one_run=True, running={}, registry=registry)), 72)
    texts = {column.title: column.cells[0] for column, _ in merged}
    assert texts["labels"] == "amplitude 12 N, conventional, draw 3, coulomb_force 17.5 N"


def test_a_study_whose_stored_sweeps_have_all_diverged_is_not_called_complete(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "studies").mkdir()
    text = """
        machine = "linear_motor_table"
        excitation = { name = "stepped_sine", points = 2, amplitude = 75 }
        estimator = { name = "conventional" }
        [grid]
        "controller.proportional" = [PROPORTIONAL]
    """
    for name, gains in (("all", "300000, 600000"), ("some", "6000, 300000")):
        (tmp_path / "studies" / f"{name}.toml").write_text(text.replace("PROPORTIONAL", gains), encoding="utf-8")
        main(["run", name, "--executor=serial"])
    capsys.readouterr()
    states = {line.split()[0]: line for line in said(capsys, "list", "--studies")[0].splitlines()}
    assert "unusable" in states["all"].split()
    assert "complete" in states["some"].split()


@pytest.mark.parametrize(
    ("arguments", "told", "code"),
    [
        (["estimatr=h1"], "did you mean 'estimator'", ExitCode.USAGE),
        (["--sweeps", "--sort", "estimatr"], "did you mean 'estimator'", ExitCode.USAGE),
        (["--sweeps", "--limit", "-1"], "expected 0 or more", ExitCode.USAGE),
        (["--studies", "estimator=h1"], "give only one of them", ExitCode.USAGE),
        (["--sweeps", "--limit", "many"], "many", ExitCode.USAGE),
    ],
)
def test_what_is_wrong_is_told_in_one_line(folder, capsys, arguments, told, code):
    out, err = said(capsys, "list", *arguments, code=code)
    assert not out
    assert err.count("\n") == 1
    assert told in err


@pytest.mark.thorough
def test_studies_are_listed_with_their_state(folder, capsys):
    (folder / "studies").mkdir()
    (folder / "studies" / "broken.toml").write_text("title = 1 2", encoding="utf-8")
    out, err = said(capsys, "list", "--studies")
    assert out.splitlines()[0].split() == ["study", "title", "state", "sweeps"]
    assert any(line.startswith("quick") and " new " in line for line in out.splitlines())
    assert any(line.startswith("broken") and " broken " in line for line in out.splitlines())
    assert "broken: " in err
    studies = json.loads(said(capsys, "list", "--studies", "--json")[0])["studies"]
    quick = next(study for study in studies if study["study"] == "quick")
    assert (quick["state"], quick["total"], quick["missing"], quick["last_run"]) == ("new", 4, 4, None)


def test_sweeps_are_tagged_and_found_by_their_tag(folder, sweeps, capsys):
    _, err = said(capsys, "tag", sweeps[0].key, sweeps[1].key[4:12], "good")
    assert "2 sweeps tagged good" in err
    assert len(said(capsys, "list", "tag:good")[0].splitlines()) == 3
    assert "good" in said(capsys, "show", sweeps[0].key)[0]
    said(capsys, "tag", "--remove", sweeps[0].key, "good")
    assert len(said(capsys, "list", "tag:good")[0].splitlines()) == 2
    assert "5 sweeps tagged all" in said(capsys, "tag", "1", "all")[1]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["1", "two words"], "is not a tag"),
        (["ffffffff", "good"], "no sweep's key starts with 'ffffffff'"),
        (["1", "good", "--remove"], "no sweep has the tag 'good'"),
    ],
)
def test_a_tag_that_cannot_be_given_is_told_in_one_line(folder, capsys, arguments, told):
    _, err = said(capsys, "tag", *arguments, code=ExitCode.STORE)
    assert err.count("\n") == 1
    assert told in err


def count(folder: Path) -> int:
    with Store.open(str(folder / "results.db"), read_only=True) as store:
        return store.page().total


def test_deleted_sweeps_are_counted_and_brought_back(folder, sweeps, capsys):
    keys = [sweep.key for sweep in sweeps]
    assert "4 sweeps deleted; 'fraexp undelete' brings this back" in said(capsys, "delete", "--yes", *keys[:4])[1]
    assert "no usable result, 4 deleted" in said(capsys, "list")[0]
    assert ", 4 deleted" in said(capsys, "show", "1")[0]
    assert "1 sweep deleted" in said(capsys, "delete", "--yes", keys[4])[1]
    assert (count(folder), ", 5 deleted" in said(capsys, "list")[0]) == (0, True)
    assert "1 sweep brought back" in said(capsys, "undelete", keys[0][4:])[1]
    assert "1 sweep brought back" in said(capsys, "undelete")[1]
    assert "is not in the trash, which has sweep " in said(capsys, "undelete", "ffff", code=ExitCode.USAGE)[1]
    assert count(folder) == 2
    assert "3 sweeps deleted for good" in said(capsys, "delete", "--purge", "--yes")[1]
    assert "the trash is empty" in said(capsys, "undelete", code=ExitCode.USAGE)[1]


def test_a_run_is_deleted_with_its_sweeps_and_comes_back(folder, sweeps, capsys):
    assert "1 run and 5 sweeps deleted" in said(capsys, "delete", "1", "--yes")[1]
    assert count(folder) == 0
    assert "1 run and 5 sweeps brought back" in said(capsys, "undelete", "1")[1]
    assert count(folder) == 5
    assert "expected runs or sweeps to delete, or --purge" in said(capsys, "delete", code=ExitCode.USAGE)[1]


def test_nothing_is_deleted_where_nobody_can_be_asked(folder, sweeps, capsys, monkeypatch):
    with open(os.devnull) as nobody:  # noqa: PTH123 (a device)
        monkeypatch.setattr(sys, "stdin", nobody)
        _, err = said(capsys, "delete", sweeps[0].key, code=ExitCode.USAGE)
    assert "will be deleted: 1 sweep with results" in err
    assert "--yes" in err
    assert count(folder) == 5


def test_a_study_is_no_name_of_what_to_delete(folder, capsys):
    _, err = said(capsys, "delete", "bench", "--yes", code=ExitCode.USAGE)
    assert "expected a run number, such as 1" in err
    assert count(folder) == 5


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs a terminal")
@pytest.mark.parametrize(("answer", "left"), [("y", 4), ("", 5)])
def test_on_a_terminal_deletion_is_asked_about(folder, sweeps, answer, left):
    controller, terminal = pty.openpty()
    command = [sys.executable, "-m", "fraexp", "delete", sweeps[0].key]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'plugins'}"}
    with subprocess.Popen(command, cwd=folder, env=environment, stdin=terminal, stderr=subprocess.PIPE) as process:
        os.write(controller, f"{answer}\n".encode())
        told = process.communicate(timeout=HANG_TIMEOUT_S)[1].decode()
    os.close(controller)
    os.close(terminal)
    assert process.returncode == ExitCode.OK
    assert "delete? [y/N]" in told
    assert count(folder) == left
