"""The stamp in the file of a figure, which shows without drawing whether the file is up to date."""

from collections.abc import Iterable
from pathlib import Path

from fraexp.data.identity import key_of
from fraexp.errors import FraexpError

DRAWING_VERSION = 15
"""Version of the drawing code: it is raised whenever the same numbers are drawn differently."""
SUFFIXES = (".png", ".svg", ".pdf")
FILE_ENDINGS = {".png": b"IEND\xaeB`\x82", ".svg": b"</svg>", ".pdf": b"%%EOF"}


def stamp_digest(keys: Iterable[str]) -> str:
    """Return the stamp of a figure with these contents, in this order.

    `keys` are the keys of the sweeps and all else that changes the figure: results, labels, title.
    """
    return key_of({"drawing": DRAWING_VERSION, "keys": list(keys)})


def is_current(path: Path, stamp: str) -> bool:
    """Return whether a file exists, is complete, and has the stamp."""
    try:
        content = path.read_bytes()
    except OSError:
        return False
    return stamp.encode() in content and content.rstrip().endswith(FILE_ENDINGS.get(path.suffix.lower(), b"\0"))


def check_folder(path: Path) -> None:
    """Raise FraexpError if the folder of a figure's file does not exist; a misspelled one is not made."""
    if not path.absolute().parent.is_dir():
        raise FraexpError(f"{path}: there is no folder {path.parent}; make it, or choose another")


def check_suffix(path: Path) -> str:
    """Return the suffix of a figure's file in lower case; FraexpError if it is no format of figures."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FraexpError(f"{path}: a figure cannot be written as '{path.suffix}'; choose one of {', '.join(SUFFIXES)}")
    return suffix
