"""A package that ``fraexp new --package`` writes: installed in an environment of its own, found, tested."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from fraexp.cli.exits import ExitCode
from fraexp.cli.main import main
from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[2]


def run(*command: object, cwd: Path) -> str:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False,
        timeout=HANG_TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture
def python(tmp_path: Path) -> Path:
    """The interpreter of an environment that sees the packages of this one, fraexp among them."""
    folder = tmp_path / "environment"
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    place = {"base": str(folder), "platbase": str(folder)}
    here = sysconfig.get_path("purelib")
    paths = [here, str(ROOT), str(ROOT / "plugins")]
    (Path(sysconfig.get_path("purelib", "venv", place)) / "reused.pth").write_text("\n".join(paths) + "\n")
    return Path(sysconfig.get_path("scripts", "venv", place)) / Path(sys.executable).name


@pytest.mark.thorough
def test_a_new_package_is_installed_found_and_tested(
    python: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "friction", "my_law", "--package", "--workspace", str(tmp_path)]) == ExitCode.OK
    printed = capsys.readouterr().out
    package = tmp_path / "fraexp-my-law"
    assert f"python -m pip install --no-deps --no-build-isolation -e {package}" in printed
    assert f"python -m pytest {package}" in printed
    owner = sys.executable if (Path(sysconfig.get_path("purelib")) / "pip").is_dir() else sys._base_executable
    pip = (owner, "-m", "pip", "--python", python, "--disable-pip-version-check")
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation", "-e", package, cwd=tmp_path)
    assert '"my_law"' in run(python, "-m", "fraexp", "plugins", "--json", cwd=tmp_path)
    summary = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", package, cwd=tmp_path).splitlines()[-1]
    assert summary.startswith("23 passed")
