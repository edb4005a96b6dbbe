"""The kind of file system that holds a database: SQLite's log needs memory that all processes share."""

from pathlib import Path

NETWORK_TYPES = ("nfs", "cifs", "smb", "9p", "fuse.sshfs", "afs", "lustre", "ceph")
"""Prefixes of the types of file systems that several computers can use at the same time."""


def file_system_type(folder: Path) -> str:
    """Return the type of the file system that holds a folder; ``unknown`` if the system does not report it."""
    import psutil  # only a process that writes asks

    path = folder.resolve()
    try:
        partitions = psutil.disk_partitions(all=True)
    except (OSError, psutil.Error):
        return "unknown"
    holding = [part for part in partitions if path.is_relative_to(part.mountpoint)]
    # The last one mounted at a place covers the earlier ones.
    return max(reversed(holding), key=lambda part: len(part.mountpoint)).fstype if holding else "unknown"


def is_on_network(folder: Path) -> bool:
    """Return whether a folder lies on a file system that several computers can use."""
    return file_system_type(folder).startswith(NETWORK_TYPES)
