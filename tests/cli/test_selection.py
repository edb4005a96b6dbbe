"""From what is typed to runs and sweeps."""

from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.data.sweep import Sweep
from fraexp.store import Store
from fraexp.workspace.workspace_folder import WorkspaceFolder


@pytest.fixture
def digits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A database whose one sweep has a key that begins with four digits or more."""
    sweeps = (Sweep({"source": "loop", "n": n}, {"name": "effective_input"}) for n in range(10_000))
    sweep = next(of for of in sweeps if of.key[4:8].isdigit() and of.key[4] not in "01")
    with Store.open(str(tmp_path / "results.db"), create=True) as store:
        run = store.begin_run("bench", "bench.toml", "fraexp run bench", {}, [sweep])
        store.fail(run, sweep.key, "it broke off", "")
        store.end_run(run, "partial")
    monkeypatch.chdir(tmp_path)
    return sweep.key[4:8]


def test_digits_that_no_run_has_are_how_a_key_begins(digits: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", digits]) == ExitCode.OK
    assert f"fx2-{digits}" in capsys.readouterr().out
    assert main(["tag", digits, "baseline"]) == ExitCode.OK
    assert main(["show", "1"]) == ExitCode.OK
    assert "bench" in capsys.readouterr().out


def test_digits_that_nothing_has_are_a_run_or_a_key(digits: str, capsys: pytest.CaptureFixture[str]) -> None:
    for given, sentence in (
        ("77", "is no run 77"),
        ("99999999", "key starts with '9999"),
        ("-1", "key starts with '-1'"),
    ):
        if not digits.startswith(given):
            assert main(["show", given]) == ExitCode.STORE
            assert sentence in capsys.readouterr().err


def test_a_unit_of_another_kind_is_refused_in_a_filter(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sweep = Sweep({"source": "loop", "plant": {"name": "modal", "rigid_body_gain": 0.1}}, {"name": "effective_input"})
    database = str(tmp_path / "results.db")
    with Store.open(database, create=True) as store:
        store.begin_run("bench", "bench.toml", "fraexp run bench", {}, [sweep])
    assert main(["list", "plant.rigid_body_gain>1kg", "--db", database]) == ExitCode.USAGE
    assert "'plant.rigid_body_gain>1kg': 'kg' is not a unit of the same kind as 'm/(N s**2)'" in capsys.readouterr().err
    assert main(["list", "plant.rigid_body_gain>1mm/(N*s**2)", "--db", database]) == ExitCode.OK
    assert "1 sweep" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("workspace", "url", "told"),
    [
        (".", None, ""),
        (".", "other.db", " --db other.db"),
        ("my bench", None, " --workspace 'my bench'"),
        ("bench", "postgresql://me:secret@host/base", " --workspace bench --db postgresql://me@host/base"),
    ],
)
def test_commands_that_are_proposed_name_the_place_that_was_given(workspace: str, url: str | None, told: str) -> None:
    place = Path(workspace)
    assert WorkspaceFolder(place, url or str(place / "results.db")).shown_options() == told
