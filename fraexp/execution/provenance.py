"""Provenance of results: code version, packages and machine, as plain data."""

import os
import platform
import re
import subprocess
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import fraexp

CHECKOUT = Path(fraexp.__file__).resolve().parents[1]
"""Folder above the package: a checkout, or the folder of installed packages."""
CODE_FOLDERS = ("fraexp", "plugins")
"""What of a checkout decides results: not its studies, which runs store."""
GIT_TIMEOUT_S = 5.0
"""Timeout for git."""


def gather_provenance() -> dict[str, Any]:
    """Return version, git state, Python, packages and machine as plain data; unknown values are None."""
    version, requirements = _read_project()
    return {
        "fraexp": version,
        "git": _git_state(CHECKOUT),
        "python": {"version": platform.python_version(), "implementation": platform.python_implementation()},
        "packages": {name: _installed_version(name) for name in sorted(requirements)},
        "machine": {
            "platform": platform.platform(),
            "architecture": platform.machine(),
            "host": platform.node(),
            "cpu": _cpu_name(),
            "cores": os.cpu_count(),
            "usable_cores": usable_cores(),
        },
        "log": os.environ.get("FRAEXP_LOG"),  # of a run that has no terminal
    }


def usable_cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _read_project() -> tuple[str | None, list[str]]:
    """Return version and names of the required packages, from the installed package or the checkout."""
    try:
        return next(iter(_header("fraexp", "Version")), None), _package_names(_header("fraexp", "Requires-Dist"))
    except metadata.PackageNotFoundError:
        pass
    try:
        project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")).get("project", {})
    except (OSError, tomllib.TOMLDecodeError):
        return None, []
    return project.get("version"), _package_names(project.get("dependencies", []))


def _package_names(requirements: list[str]) -> list[str]:
    needed = [text for text in requirements if "extra ==" not in text]
    return [found.group() for text in needed if (found := re.match(r"[\w.-]+", text.strip()))]


def _installed_version(name: str) -> str | None:
    try:
        return next(iter(_header(name, "Version")), None)
    except metadata.PackageNotFoundError:
        return None


def _header(name: str, header: str) -> list[str]:
    """Return what an installed package states under a header; importlib.metadata also parses its whole description."""
    installed = metadata.distribution(name)
    headers, _, _ = (installed.read_text("METADATA") or installed.read_text("PKG-INFO") or "").partition("\n\n")
    return re.findall(rf"^{header}: (.+)$", headers, re.MULTILINE)


def _git_state(folder: Path) -> dict[str, object] | None:
    """Return the commit and whether the code differs from it; None without a checkout or without git."""
    if not (folder / ".git").exists():
        return None
    command = ["git", "-C", str(folder), "status", "--porcelain=v2", "--branch", "--", *CODE_FOLDERS]
    quiet = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # git status must not write the index
    try:
        done = subprocess.run(command, capture_output=True, timeout=GIT_TIMEOUT_S, check=True, env=quiet)
    except (OSError, subprocess.SubprocessError):
        return None
    lines = done.stdout.decode(errors="replace").splitlines()
    commit = next((line.split()[2] for line in lines if line.startswith("# branch.oid ")), "(initial)")
    dirty = any(not line.startswith("#") for line in lines)
    return {"commit": None if commit == "(initial)" else commit, "dirty": dirty}


def _cpu_name() -> str | None:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.lower().startswith("model name")]
    return named[0] if named else platform.processor() or None
