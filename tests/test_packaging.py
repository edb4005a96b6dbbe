"""What a user gets: the wheel, made from the source archive, installed and used outside the checkout."""

import json
import os
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tests.waiting import HANG_TIMEOUT_S

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
DECLARED = {("console_scripts", name, value) for name, value in PROJECT["scripts"].items()} | {
    (group, name, value) for group, entries in PROJECT["entry-points"].items() for name, value in entries.items()
}


def run(*command: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_TIMEOUT_S,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done


def hatch(target: str, source: Path, folder: Path) -> Path:
    run(sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", folder, cwd=source)
    (made,) = folder.iterdir()
    return made


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel made from the source archive, as other people's tools make it."""
    folder = tmp_path_factory.mktemp("build")
    with tarfile.open(hatch("sdist", ROOT, folder / "sdist")) as archive:
        archive.extractall(folder, filter="data")
    (source,) = folder.glob("fraexp-*")
    return hatch("wheel", source, folder / "wheel")


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel and, by a path file, the packages that it needs; nothing is downloaded."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    place = {"base": str(folder), "platbase": str(folder)}
    python = Path(sysconfig.get_path("scripts", "venv", place)) / Path(sys.executable).name
    owner = sys.executable if (Path(sysconfig.get_path("purelib")) / "pip").is_dir() else sys._base_executable
    pip = (owner, "-m", "pip", "--python", python, "--disable-pip-version-check")
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", wheel, cwd=folder)
    site = Path(sysconfig.get_path("purelib", "venv", place))
    (site / "needs.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python.with_name("fraexp")


def test_what_is_installed_here_is_what_pyproject_declares() -> None:
    metadata = distribution("fraexp")
    found = {(entry.group, entry.name, entry.value) for entry in metadata.entry_points}
    assert (metadata.version, found) == (PROJECT["version"], DECLARED), "installed before a change: run make clean test"


@pytest.mark.thorough
def test_the_wheel_holds_the_code_the_plugins_and_the_studies_and_nothing_else(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {path.relative_to(ROOT) for name in ("fraexp", "studies") for path in (ROOT / name).rglob("*.*")}
    wanted |= {path.relative_to(ROOT / "plugins") for path in (ROOT / "plugins").rglob("*.py")}
    expected = {f"fraexp/{path}" if path.parts[0] == "studies" else str(path) for path in wanted if path.suffix}
    shipped = {name for name in names if ".dist-info/" not in name}
    assert {name for name in expected if "__pycache__" not in name} == shipped


@pytest.mark.thorough
def test_the_installed_wheel_declares_what_pyproject_declares(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        text = archive.read(name).decode()
    for _, name, value in DECLARED:
        assert f"{name} = {value}" in text


@pytest.mark.thorough
def test_the_installed_command_explains_itself(installed: Path, tmp_path: Path) -> None:
    assert "run" in run(installed, "--help", cwd=tmp_path).stdout


@pytest.mark.thorough
def test_the_installed_command_finds_the_plugins_of_the_wheel(installed: Path, tmp_path: Path) -> None:
    text = run(installed, "plugins", "--json", cwd=tmp_path).stdout
    assert json.loads(text)
    assert '"rolling"' in text
    assert str(ROOT) not in text


@pytest.mark.thorough
def test_the_installed_command_finds_the_studies_of_the_wheel(installed: Path, tmp_path: Path) -> None:
    done = run(installed, "run", "quick", "--dry-run", cwd=tmp_path)
    assert "sweep" in done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []  # a dry run writes nothing
