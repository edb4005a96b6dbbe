"""Where numbers come from: the code, its packages and the machine, as plain data."""

import os
import platform
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import fraexp

CHECKOUT = Path(fraexp.__file__).resolve().parents[1]
"""Folder above the package: a checkout, or the folder of installed packages."""
PATIENCE = 5.0
"""How long git may take [s]."""


def gather() -> dict[str, Any]:
    """Return version, git state, Python, packages and machine as plain data; what is unknown is None."""
    version, requirements = _project()
    return {
        "fraexp": version,
        "git": _git(CHECKOUT),
        "python": {"version": platform.python_version(), "implementation": platform.python_implementation()},
        "packages": {name: _version(name) for name in sorted(requirements)},
        "machine": {
            "platform": platform.platform(),
            "architecture": platform.machine(),
            "host": platform.node(),
            "cpu": _cpu(),
            "cores": os.cpu_count(),
            "usable_cores": _usable_cores(),
        },
        "log": os.environ.get("FRAEXP_LOG"),  # of a run that has no terminal
    }


def _project() -> tuple[str | None, list[str]]:
    """Return version and names of the required packages, from the installed package or the checkout."""
    try:
        installed = metadata.metadata("fraexp")
        return installed["Version"], _names(metadata.requires("fraexp") or [])
    except metadata.PackageNotFoundError:
        pass
    try:
        project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")).get("project", {})
    except (OSError, tomllib.TOMLDecodeError):
        return None, []
    return project.get("version"), _names(project.get("dependencies", []))


def _names(requirements: list[str]) -> list[str]:
    needed = [text for text in requirements if "extra ==" not in text]
    return [found.group() for text in needed if (found := re.match(r"[\w.-]+", text.strip()))]


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _git(folder: Path) -> dict[str, Any] | None:
    """Return commit and whether anything differs from it; None if this is no checkout, or git is absent."""
    if not (folder / ".git").exists():
        return None
    command = ["git", "-C", str(folder), "status", "--porcelain=v2", "--branch"]
    quiet = {**os.environ, "GIT_OPTIONAL_LOCKS": "0"}  # looking must not write the index
    try:
        done = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=True, env=quiet)
    except (OSError, subprocess.SubprocessError):
        return None
    lines = done.stdout.decode(errors="replace").splitlines()
    commit = next((line.split()[2] for line in lines if line.startswith("# branch.oid ")), "(initial)")
    dirty = any(not line.startswith("#") for line in lines)
    return {"commit": None if commit == "(initial)" else commit, "dirty": dirty}


def _cpu() -> str | None:
    try:
        lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.lower().startswith("model name")]
    return named[0] if named else platform.processor() or None


def _usable_cores() -> int | None:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count()
