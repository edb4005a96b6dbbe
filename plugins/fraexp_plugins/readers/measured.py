"""What the built-in readers share: the limit of size, and the sentence for a missing column."""

from collections.abc import Iterable
from pathlib import Path

from fraexp.api import RecordError, did_you_mean

LARGEST = 2 * 1024**3
"""Greatest decoded size of a file or variable that is read [bytes]."""
LISTED = 30
"""Columns named in a message at most."""


def missing_column(path: Path, name: str, known: Iterable[str]) -> RecordError:
    """Return the error for a column that a file does not have: it names what there is, and the nearest."""
    names = list(known)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    near = did_you_mean(name, names)
    nearest = near if near.startswith("; did") else ""
    return RecordError(f"{path.name}: no column is called '{name}'; it has {', '.join(names[:LISTED])}{more}{nearest}")


MODEST, DENSEST = 256 * 1024**2, 50
"""Decoded size [bytes] up to which a file may be as dense as it likes, and above which it may hold so many times its
own size: what was measured cannot be compressed further, zeros can be a thousand times."""


def check_size(path: Path, what: str, size: float) -> None:
    """Raise RecordError if something of `size` bytes is too large to be read, or cannot be in such a file."""
    own = path.stat().st_size
    if MODEST < size <= LARGEST and size > DENSEST * own:
        raise RecordError(
            f"{path.name}: {what} would take {size / 1024**3:.1f} GiB, {size / own:.0f} times the file; "
            f"expected measured numbers, {DENSEST} times at most"
        )
    if size > LARGEST:
        raise RecordError(
            f"{path.name}: {what} takes {size / 1024**3:.1f} GiB; at most {LARGEST / 1024**3:g} GiB are read: cut it"
        )
