"""A lock of the process that measures: two would move one machine, or mix their samples."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fraexp.data.atomic_file import try_lock
from fraexp.errors import BusyError


@contextmanager
def process_lock(file: Path, place: str, where: str) -> Iterator[None]:
    """Keep other processes out, and oneself from beginning twice; BusyError names the process that holds the lock.

    `place` and `where` say in that message what is locked.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("a+", encoding="utf-8") as stream:  # it stays: whoever removed it could remove that of somebody else
        if not try_lock(stream.fileno()):
            stream.seek(0)
            raise BusyError(
                f"{place}: process {stream.read().strip()} is measuring {where}; wait until it has ended, or stop it"
            )
        stream.truncate(0)
        stream.write(f"{os.getpid()}\n")
        stream.flush()
        yield
