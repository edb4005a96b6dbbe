"""``fraexp new`` and ``fraexp check``, as they are typed."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from fraexp.cli.options import KINDS
from fraexp.components.kinds import KINDS as CLASSES
from fraexp.testing import checks_for
from tests.examples import thorough
from tests.testing.defects import Element
from tests.waiting import HANG_TIMEOUT_S

BROKEN = (
    '"""A law."""\nfrom fraexp.api import FrictionModel, param\n\n\n'
    'class Bad(FrictionModel, name="bad", version=1):\n    """Jenkins 1962, weaker in one direction."""\n\n'
    '    stiffness: float = param("N/m", "stiffness", 1e5, above=0)\n    states = ("force [N]",)\n\n'
    "    @staticmethod\n    def advance(z, dy, dt, z_next, stiffness):\n"
    "        z_next[0] = min(max(z[0] + stiffness * dy, -1.0), 2.0)\n        return z_next[0]\n"
)


def steps(printed: str) -> list[str]:
    """Return the commands that are printed after ``next:``."""
    return [line.partition("#")[0].strip() for line in printed.partition("next:\n")[2].splitlines()]


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, check=False,
        timeout=HANG_TIMEOUT_S,
    )  # fmt: skip


def test_the_command_line_knows_every_kind() -> None:
    assert set(KINDS) == {kind.kind for kind in CLASSES}


@pytest.mark.thorough
def test_a_new_friction_law_goes_to_a_checked_and_plotted_result_as_printed(tmp_path: Path) -> None:
    made = shell("fraexp new friction my_law", tmp_path)
    assert made.returncode == ExitCode.OK, made.stderr
    assert made.stdout.splitlines()[:2] == ["plugins/my_law.py", "studies/my_law.toml"]
    assert [step.split()[1] for step in steps(made.stdout)] == ["check", "run", "plot"]
    for step in steps(made.stdout):
        done = shell(step, tmp_path)
        assert done.returncode == ExitCode.OK, f"{step}\n{done.stdout}\n{done.stderr}"
    made_files = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*") if "__pycache__" not in str(path)}
    expected = {"plugins/my_law.py", "studies/my_law.toml", "figures/my_law.png", "my_law.pdf", "results.db"}
    assert made_files - {"results.db-shm", "results.db-wal"} == expected


def test_the_next_steps_are_true_whatever_was_run_and_written_before(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for kind, name in (("plant", "first"), ("controller", "second")):
        assert main(["new", kind, name]) == ExitCode.OK
        assert steps(capsys.readouterr().out)[-1] == f"fraexp plot {name} -o {name}.pdf"


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "friction"])
def test_a_new_plugin_of_any_kind_works_as_printed(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind, "my_own"]) == ExitCode.OK
    for step in steps(capsys.readouterr().out):
        assert main(shlex.split(step)[1:]) == ExitCode.OK, f"{step}\n{capsys.readouterr()}"


@pytest.mark.parametrize("kind", KINDS)
def test_what_new_writes_is_short_and_documented(kind: str, tmp_path: Path) -> None:
    assert main(["new", kind, "my_own", "--workspace", str(tmp_path)]) == ExitCode.OK
    text = (tmp_path / "plugins/my_own.py").read_text("utf-8")
    assert len(text.splitlines()) <= 50
    assert "class MyOwn(" in text
    assert "$" not in text


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("new friction my-law", "'my-law' is not a valid plugin name; expected lower-case letters, digits and _"),
        ("new friction class", "'class' is a word of Python, which the plugin would hide"),
        ("new friction os", "a Python module"),
        ("new friction print", "a name of Python"),
        ("new friction result", "a name of fraexp.api"),
        (f"new friction {'a' * 10_000}", "is too long"),
        ("new friction dahl", "friction 'dahl' already exists in "),
        ("new frictoin mine", "unknown KIND 'frictoin'; did you mean 'friction'?"),
        ("check dhal", "no component is called 'dhal'; did you mean 'dahl'?"),
        thorough("check dahl --kind plant", "no plant is called 'dahl'"),
        ("check nothing.py", "nothing.py: there is no such file"),
    ],
)
def test_a_wrong_name_is_one_line(
    line: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == ExitCode.USAGE
    printed = capsys.readouterr()
    assert sentence in printed.err
    assert printed.err.count("\n") == 1
    assert printed.out == ""
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "studies").mkdir()
    (tmp_path / "studies/my_law.toml").write_text("mine")
    assert main(["new", "friction", "my_law", "--workspace", str(tmp_path)]) == ExitCode.USAGE
    assert "already exists" in capsys.readouterr().err
    assert not (tmp_path / "plugins").exists()
    assert (tmp_path / "studies/my_law.toml").read_text() == "mine"


@pytest.mark.thorough
def test_check_reports_what_fails_with_the_smallest_example(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.py").write_text(BROKEN)
    assert main(["check", "bad.py"]) == ExitCode.INCOMPLETE
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    at = next(number for number, line in enumerate(lines) if line.startswith("  FAIL      odd "))
    assert "on the opposite path" in lines[at + 1]
    assert "with bad(stiffness=1e+05); from 0 m to " in lines[at + 2]
    assert printed.err.startswith("friction bad (bad.py, line ")
    assert "1 check failed: odd; odd: step " in printed.err
    assert sorted(path.name for path in tmp_path.iterdir() if path.name != "__pycache__") == ["bad.py"]


def test_a_file_that_cannot_be_loaded_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plugins").mkdir()
    (tmp_path / "plugins/mine.py").write_text("import nothing_of_this_name\n")
    for name in ("mine", str(tmp_path / "plugins/mine.py")):
        assert main(["check", name, "--workspace", str(tmp_path)]) == ExitCode.USAGE
        printed = capsys.readouterr().err
        assert "ModuleNotFoundError" in printed
        assert printed.count("\n") == 1


def test_every_check_has_its_own_name_and_a_sentence() -> None:
    checks = checks_for(Element)
    assert len({check.name for check in checks}) == len(checks) > 20
    assert [check.name for check in checks if not check.meaning.endswith(".")] == []
