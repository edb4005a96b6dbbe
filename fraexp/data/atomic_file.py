"""Files that appear complete or not at all: they are written beside their place, and renamed."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Return the path of a draft that takes the place of `path` at the end of the context.

    The draft is removed if the context raises anything, an interruption included. OSError if it cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        draft.touch()  # fails with the reason, which not every writer reports
        yield draft
        draft.replace(path)
    except BaseException:
        with suppress(OSError):  # a folder that refuses files refuses to remove them, too
            draft.unlink(missing_ok=True)
        raise
