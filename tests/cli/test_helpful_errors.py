"""What people write by mistake, and the line that helps them on."""

from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Section, Sweep
from fraexp.store import Store
from fraexp.workspace.workspace_service import WorkspaceService

HEAD = 'machine = "linear_motor_table"\n[excitation]\nname = "stepped_sine"\n'
ESTIMATOR = '[estimator]\nname = "conventional"\n'


def error_of(text: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    (folder / "studies").mkdir(exist_ok=True)
    (folder / "studies" / "s.toml").write_text(text)
    assert main(["run", "s", "--dry-run", "--workspace", str(folder)]) == ExitCode.USAGE
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the study is empty; expected [excitation] and [estimator] at least, as in "),
        ('title = "x"', "the study has no sections; expected [excitation]"),
        (
            f"{HEAD}sample_time = 0.001\n{ESTIMATOR}",
            "[excitation]: stepped_sine has no parameter 'sample_time'; it belongs into [loop]",
        ),
        (f"{HEAD}tolerance = 0.001\n{ESTIMATOR}", "no parameter 'tolerance'; did you mean 'settling_tolerance'?"),
        (f'{HEAD}[grid]\nestimator = ["conventional"]', "expected a table such as { name = 'conventional' }"),
        (
            f"{HEAD}{ESTIMATOR}[grid]\nexcitation.amplitude = [1, 2]",
            "'excitation' is a table; quote the path of an axis: \"excitation.amplitude\" = [...]",
        ),
        (
            f'{HEAD}{ESTIMATOR}[grid]\n"excitation.amplitude" = ["1 N", "2 mm"]',
            "not a unit of the same kind as 'N'; [grid] sets excitation.amplitude = '2 mm'",
        ),
        (f"{HEAD}amplitude = [30, 40]\n{ESTIMATOR}", "stepped_sine.amplitude is [30, 40] (amplitude A, N)"),
        (f"{HEAD}amplitude = true\n{ESTIMATOR}", "amplitude is true; expected a number"),
    ],
)
def test_a_mistake_in_a_study_is_answered_in_the_users_words(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said in error_of(text, tmp_path, capsys)


def test_runs_are_sorted_by_a_column_or_not_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        for study in ("b", "a", "c"):
            store.end_run(store.begin_run(study, f"{study}.toml", f"fraexp run {study}", {}, []), "complete")
    options = ["--workspace", str(tmp_path)]
    for order, expected in (("study", "abc"), ("-study", "cba"), ("-stu", "cba"), ("run", "bac"), ("", "cab")):
        assert main(["list", *options, f"--sort={order}"]) == ExitCode.OK
        rows = capsys.readouterr().out.splitlines()[1:]
        assert "".join(row.split()[1] for row in rows) == expected
    assert main(["list", *options, "--sort", "studdy"]) == ExitCode.USAGE
    assert "there is no 'studdy' to sort by; did you mean 'study'?" in capsys.readouterr().err
    assert main(["list", *options, "--studies", "--sort", "study"]) == ExitCode.USAGE


def test_doctor_names_a_cache_that_cannot_be_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("FRAEXP_CACHE_DIR", str(tmp_path / "file" / "cache"))
    main(["doctor", "--workspace", str(tmp_path)])
    assert f"cache: {tmp_path}/file/cache cannot be written (Not a directory)" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_run_says_why_nothing_is_reused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["excitation.points=2", "excitation.min_frequency=20"]
    workspace = WorkspaceService.open(tmp_path)
    (study,) = workspace.studies(["quick"], settings)
    aged = [replace_version(sweep) for sweep in study.sweeps]
    with workspace.open_store("create") as store:
        number = store.begin_run("quick", "quick.toml", "fraexp run quick", {}, aged)
        store.save(number, [(sweep, Result(Outcome.OK), {}) for sweep in aged])
        store.end_run(number, "complete")
    line = ["run", "quick", *(f"--set={text}" for text in settings), "--workspace", str(tmp_path), "--executor=serial"]
    for expected in (True, False):
        assert main(line) == ExitCode.OK
        told = capsys.readouterr().err
        assert ("nothing is reused, because components have changed: 4 of 4: " in told) == expected
        assert ("excitation.version = 1, stored 0" in told) == expected


def replace_version(sweep: Sweep) -> Sweep:
    """Return a sweep as an earlier version of its excitation would have computed it."""
    excitation = Section({**sweep.experiment["excitation"], "version": 0})
    return Sweep({**sweep.experiment, "excitation": excitation}, sweep.estimator, sweep.labels)
