"""The stamp that a figure's file carries: it tells, without drawing, whether the file shows what is asked for."""

from collections.abc import Iterable
from pathlib import Path

from fraexp.data.identity import key_of
from fraexp.errors import FraexpError

DRAWING = 5
"""Raised whenever the same numbers are drawn in another way."""
SUFFIXES = (".png", ".svg", ".pdf")
ENDINGS = {".png": b"IEND\xaeB`\x82", ".svg": b"</svg>", ".pdf": b"%%EOF"}


def digest(keys: Iterable[str]) -> str:
    """Return the stamp of a figure that shows what `keys` name, in that order.

    `keys` are the sweeps' keys and whatever else changes the picture: labels, title, time of computation.
    """
    return key_of({"drawing": DRAWING, "keys": list(keys)})


def is_current(path: Path, stamp: str) -> bool:
    """Say whether a file is there, whole, and carries the stamp."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    return stamp.encode() in content and content.rstrip().endswith(ENDINGS.get(path.suffix.lower(), b"\0"))


def check_suffix(path: Path) -> str:
    """Return the format of a figure's file, in lower case; FraexpError if figures are not written so."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FraexpError(f"{path}: a figure cannot be written as '{path.suffix}'; choose one of {', '.join(SUFFIXES)}")
    return suffix
