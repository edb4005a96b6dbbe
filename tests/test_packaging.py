"""What a user gets: the wheel, made from the source archive, installed and used outside the checkout."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from fraexp.figures.result_files import WRITERS
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


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The source archive, and a wheel made from it, as other people's tools make it."""

    def hatch(target: str, checkout: Path) -> Path:
        run(
            sys.executable, "-m", "hatchling", "build", "--target", target, "--directory", folder / target, cwd=checkout
        )
        (made,) = (folder / target).iterdir()
        return made

    folder = tmp_path_factory.mktemp("build")
    source = hatch("sdist", ROOT)
    with tarfile.open(source) as archive:
        archive.extractall(folder, filter="data")
    (checkout,) = folder.glob("fraexp-*")
    return source, hatch("wheel", checkout)


@pytest.fixture(scope="module")
def installed(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the wheel and, by a path file, the packages that it needs; nothing is downloaded."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    place = {"base": str(folder), "platbase": str(folder)}
    python = Path(sysconfig.get_path("scripts", "venv", place)) / Path(sys.executable).name
    owner = sys.executable if (Path(sysconfig.get_path("purelib")) / "pip").is_dir() else sys._base_executable
    pip = (owner, "-m", "pip", "--python", python, "--disable-pip-version-check")
    run(*pip, "install", "--quiet", "--no-index", "--no-deps", archives[1], cwd=folder)
    site = Path(sysconfig.get_path("purelib", "venv", place))
    (site / "needs.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python.with_name("fraexp")


def pinned(lock: str) -> set[str]:
    """The blocks of a lock: version, platforms and hashes of each package."""
    text = (ROOT / lock).read_text("utf-8").replace("\\\n", "")
    assert " --hash=" in text
    return set(text.splitlines())


def names_in(lock: str) -> set[str]:
    return {name_of(line) for line in pinned(lock)}


def name_of(requirement: str) -> str:
    found = re.match(r"[\w.-]+", requirement)
    assert found
    return re.sub(r"[-_.]+", "-", found.group()).lower()


def test_what_running_needs_is_a_part_of_what_developing_needs_in_the_same_versions() -> None:
    assert pinned("requirements.lock") < pinned("requirements-dev.lock")


def test_running_needs_what_is_declared_and_no_tool_of_development() -> None:
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    needed, tools = ({name_of(of) for of in wanted if isinstance(of, str)} for wanted in (
        [*PROJECT["dependencies"], *groups["build"]], groups["dev"],
    ))  # fmt: skip
    assert needed <= names_in("requirements.lock")
    assert not tools & names_in("requirements.lock")
    assert tools <= names_in("requirements-dev.lock")


@pytest.fixture(scope="module")
def lean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of an environment with this checkout and the packages that running needs: links, nothing is downloaded."""
    folder = tmp_path_factory.mktemp("lean")
    venv.create(folder, with_pip=False, symlinks=os.name != "nt")
    place = {"base": str(folder), "platbase": str(folder)}
    site = Path(sysconfig.get_path("purelib", "venv", place))
    for name in ("fraexp", *names_in("requirements.lock")):
        try:
            files = distribution(name).files or []
        except PackageNotFoundError:  # of another platform
            continue
        for top in {file.parts[0] for file in files} - {"..", "__pycache__"}:
            (site / top).symlink_to(Path(sysconfig.get_path("purelib")) / top)
    return Path(sysconfig.get_path("scripts", "venv", place)) / Path(sys.executable).name


@pytest.mark.thorough
def test_with_what_running_needs_everything_runs_without_a_warning(lean: Path, tmp_path: Path) -> None:
    fraexp = (lean, "-W", "error", "-m", "fraexp")
    run(*fraexp, "run", "quick", cwd=tmp_path)
    assert list(tmp_path.glob("figures/**/*.png"))
    (key, *_) = (
        sweep["key"] for sweep in json.loads(run(*fraexp, "list", "--sweeps", "--json", cwd=tmp_path).stdout)["sweeps"]
    )
    for suffix in WRITERS:
        run(*fraexp, "export", key, "-o", f"result{suffix}", cwd=tmp_path)
    run(*fraexp, "report", "1", "-o", "report.html", cwd=tmp_path)
    run(*fraexp, "doctor", cwd=tmp_path)
    run(
        lean,
        "-W",
        "error",
        "-c",
        "import fraexp.testing.check_report, fraexp.tui.app, fraexp.tui.services.browser_server",
        cwd=tmp_path,
    )


def test_what_is_installed_here_is_what_pyproject_declares() -> None:
    metadata = distribution("fraexp")
    found = {(entry.group, entry.name, entry.value) for entry in metadata.entry_points}
    assert (metadata.version, found) == (PROJECT["version"], DECLARED), "installed before a change: run make clean test"


@pytest.mark.thorough
def test_a_package_index_takes_both_archives(archives: tuple[Path, Path], tmp_path: Path) -> None:
    done = run(sys.executable, "-m", "twine", "check", "--strict", *archives, cwd=tmp_path)
    assert done.stdout.count("PASSED") == 2


@pytest.mark.thorough
def test_the_wheel_holds_the_code_the_plugins_and_the_studies_and_nothing_else(archives: tuple[Path, Path]) -> None:
    names = set(zipfile.ZipFile(archives[1]).namelist())
    wanted = {path.relative_to(ROOT) for name in ("fraexp", "studies") for path in (ROOT / name).rglob("*.*")}
    code = [path for kind in ("*.py", "*.st") for path in (ROOT / "plugins").rglob(kind)]
    wanted |= {path.relative_to(ROOT / "plugins") for path in code}
    expected = {f"fraexp/{path}" if path.parts[0] == "studies" else str(path) for path in wanted if path.suffix}
    shipped = {name for name in names if ".dist-info/" not in name}
    assert {name for name in expected if "__pycache__" not in name} == shipped
    assert "fraexp/py.typed" in shipped
    assert [name for name in names if name.endswith(".dist-info/licenses/LICENSE")]


@pytest.mark.thorough
def test_the_installed_command_finds_the_plugins_and_the_studies_of_the_wheel(installed: Path, tmp_path: Path) -> None:
    text = run(installed, "plugins", "--json", cwd=tmp_path).stdout
    assert '"rolling"' in text
    assert str(ROOT) not in text
    done = run(installed, "run", "quick", "--dry-run", cwd=tmp_path)
    assert "sweep" in done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []  # a dry run writes nothing
