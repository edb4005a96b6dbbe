"""On what kind of file system a database lies: SQLite's log needs memory that all who use it share."""

import os
from pathlib import Path

MOUNTS = Path("/proc/mounts")
NETWORK = ("nfs", "cifs", "smb", "9p", "fuse.sshfs", "afs", "lustre", "ceph")
"""Beginnings of the types of file systems that several computers may use at once."""


def file_system(folder: Path) -> str:
    """Return the type of the file system that holds a folder; ``unknown`` where the system does not tell."""
    try:
        lines = MOUNTS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return "unknown"
    real = os.path.realpath(folder)
    mounts = [(parts[1].replace("\\040", " "), parts[2]) for parts in (line.split() for line in lines)]
    holding = [mount for mount in mounts if os.path.commonpath([mount[0], real]) == mount[0]]
    # Of those at the same place the last one mounted covers the others.
    return max(reversed(holding), key=lambda mount: len(mount[0]))[1] if holding else "unknown"


def on_network(folder: Path) -> bool:
    """Return whether a folder is shared through a network."""
    return file_system(folder).startswith(NETWORK)
