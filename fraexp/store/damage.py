"""Reading of a damaged database: what is sound is read, what is not is left out and can be named."""

import sqlite3
from collections.abc import Callable, Iterable
from typing import TypeVar

from sqlalchemy.exc import StatementError

from fraexp.store.tables import Key, key_chunks
from fraexp.store.validation import FOREIGN_DATA_ERRORS

Value = TypeVar("Value")
RESTORE_HINT = "restore a copy with 'fraexp restore COPY', or save what is sound with fraexp merge into a new one"
DAMAGED = "the stored values do not match their digest: they are damaged"
CORRUPT_CODES = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_IOERR)
UNDECODABLE = "Could not decode"
"""Beginning of what SQLite's driver says of a text that is not UTF-8."""


def is_damage(error: BaseException) -> bool:
    """Return whether an error comes from damaged data, and not from a lock or a lost connection."""
    if not isinstance(error, StatementError):
        return isinstance(error, FOREIGN_DATA_ERRORS)
    code = getattr(error.orig, "sqlite_errorcode", None) or 0
    return code & 0xFF in CORRUPT_CODES or UNDECODABLE in str(error.orig) or isinstance(error.orig, FOREIGN_DATA_ERRORS)


def read_tolerantly(read: Callable[[list[Key]], dict[Key, Value]], keys: Iterable[Key]) -> dict[Key, Value]:
    """Return what `read` returns for keys; those that cannot be read because of damage are missing."""
    found: dict[Key, Value] = {}
    for chunk in key_chunks(keys):
        found |= _read_chunk(read, chunk)
    return found


def _read_chunk(read: Callable[[list[Key]], dict[Key, Value]], keys: list[Key]) -> dict[Key, Value]:
    try:
        return read(keys)
    except (StatementError, *FOREIGN_DATA_ERRORS) as error:
        if not is_damage(error):
            raise
    if len(keys) == 1:
        return {}
    half = len(keys) // 2
    return _read_chunk(read, keys[:half]) | _read_chunk(read, keys[half:])
