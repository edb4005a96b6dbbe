"""Files that appear complete or not at all, and locks that the system releases when a process dies."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fraexp.errors import BusyError, FraexpError


@contextmanager
def atomic_file(path: Path, *, makes_folder: bool = False) -> Iterator[Path]:
    """Return the path of a draft that takes the place of `path` at the end of the context.

    The draft is removed if the context raises anything, an interruption included. FraexpError if it cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        if makes_folder:
            path.parent.mkdir(parents=True, exist_ok=True)
        draft.touch()  # fails with the reason, which not every writer reports
        yield draft
        draft.replace(path)
    except BaseException as error:
        with suppress(OSError):  # a folder that refuses files refuses to remove them, too
            draft.unlink(missing_ok=True)
        if isinstance(error, OSError):
            what = error.strerror or error
            raise FraexpError(f"{path}: cannot be written: {what}; choose another place") from None
        raise


def try_lock(handle: int) -> bool:
    """Lock a file or folder by its handle; return False if another process holds the lock.

    It is held until the handle is closed. Windows, and file systems that know no such locks, give it to anybody.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


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
