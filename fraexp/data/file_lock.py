"""A lock on an open file or folder, which the system releases when the process dies."""


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
