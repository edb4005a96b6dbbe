"""Checks that the built-in readers share: limits of size, and the message for a missing column."""

from collections.abc import Iterable
from pathlib import Path

from fraexp.api import RecordError, did_you_mean

MAX_SIZE_BYTES = 2 * 1024**3
"""Maximum decoded size of a file or variable that is read."""
MAX_LISTED_COLUMNS = 30
"""Maximum number of columns named in a message."""
UNCHECKED_SIZE_BYTES, MAX_EXPANSION = 256 * 1024**2, 50
"""Decoded size up to which a file may be compressed at will, and how many times its own size a file may decode to
above that: measured data cannot be compressed further, zeros a thousand times."""


def missing_column(path: Path, name: str, known: Iterable[str]) -> RecordError:
    """Return the error for a column that a file does not have: it lists the columns, and the nearest name."""
    names = list(known)
    more = f" and {len(names) - MAX_LISTED_COLUMNS} more" if len(names) > MAX_LISTED_COLUMNS else ""
    near = did_you_mean(name, names)
    nearest = near if near.startswith("; did") else ""
    if name.removeprefix("-") in names:
        nearest = f"; to change the sign, write '{name[1:]} * -1'"
    listed = ", ".join(names[:MAX_LISTED_COLUMNS])
    return RecordError(f"{path.name}: no column is called '{name}'; it has {listed}{more}{nearest}")


def check_size(path: Path, what: str, size: float) -> None:
    """Raise RecordError if something of `size` bytes is too large to be read, or implausible for the file's size."""
    own = path.stat().st_size
    if UNCHECKED_SIZE_BYTES < size <= MAX_SIZE_BYTES and size > MAX_EXPANSION * own:
        raise RecordError(
            f"{path.name}: {what} would take {size / 1024**3:.1f} GiB, {size / own:.0f} times the file; "
            f"expected measured numbers, up to {MAX_EXPANSION} times the file"
        )
    if size > MAX_SIZE_BYTES:
        raise RecordError(
            f"{path.name}: {what} takes {size / 1024**3:.1f} GiB; expected up to {MAX_SIZE_BYTES / 1024**3:g} GiB: "
            "split it"
        )
