"""Validation of what is read: a file may come from somebody else, and SQLite stores any value in any column."""

import json
import re
import types
from collections.abc import Callable
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from sqlalchemy import Dialect, LargeBinary

from fraexp.data.toml import check_plain
from fraexp.errors import StoreError

Json = Any
"""Stored plain data of any kind."""
JsonTable = dict[str, Any]
"""Stored plain data: texts, numbers, booleans, None, lists and tables by name."""
RecordType = TypeVar("RecordType")
MAX_DEPTH = 64
"""Maximum nesting of stored plain data."""
OPENING_BRACKETS = ("[", "{")
LONG_DIGITS = re.compile(r"\d{20}")
"""Digits that may be a whole number of more than 64 bits, or part of something else."""
FOREIGN_DATA_ERRORS = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RecursionError, MemoryError)
"""Errors that reading raises if a database does not contain what fraexp writes."""


class DamagedError(StoreError):
    """A stored sweep cannot be read; the store adds the name of the database."""

    def __init__(self, key: str, finding: str) -> None:
        super().__init__(f"sweep {key[4:12]}: {finding}" if key else finding)


def check_types(record: RecordType) -> RecordType:
    """Return a dataclass if its values have their declared types, except inside containers; otherwise TypeError."""
    record_type: Any = type(record)
    for name, kinds in _field_types(record_type):
        value = getattr(record, name)
        if not isinstance(value, kinds):
            raise TypeError(f"{name} is a {type(value).__name__}")
    return record


@cache
def _field_types(record: type[Any]) -> tuple[tuple[str, tuple[type, ...]], ...]:
    hints = get_type_hints(record)
    return tuple((item.name, _runtime_types(hints[item.name])) for item in fields(record))


def _runtime_types(hint: Any) -> tuple[type, ...]:
    if hint is Any:
        return (object,)
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(kind for of in get_args(hint) for kind in _runtime_types(of))
    kind = get_origin(hint) or hint
    return (float, int) if kind is float else (kind,)


def parse_json(text: str) -> object:
    """Return the plain data in a JSON text; ValueError if it is invalid, too deep, or has too large numbers."""
    data = json.loads(text)
    if sum(map(text.count, OPENING_BRACKETS)) > MAX_DEPTH or LONG_DIGITS.search(text):
        check_plain(data, MAX_DEPTH)
    return data


class CheckedBytes(LargeBinary):
    """A column of bytes that refuses other types: Python would convert a number to that many bytes."""

    def result_processor(self, dialect: Dialect, coltype: object) -> Callable[[object], bytes | None]:
        """Return the function that checks the bytes."""
        return _checked_bytes


def _checked_bytes(value: object) -> bytes | None:
    if value is None or isinstance(value, bytes):
        return value
    if isinstance(value, memoryview | bytearray):
        return bytes(value)
    raise TypeError(f"an array is a {type(value).__name__}")


def foreign_data_error(name: str, error: BaseException) -> StoreError:
    """Return the error for a database that does not contain what fraexp writes."""
    what = " ".join(str(error).split())[:100]
    reason = f"{type(error).__name__}: {what}"
    return StoreError(f"{name}: the database contains data that fraexp does not write ({reason}); restore a copy of it")
