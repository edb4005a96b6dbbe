"""What comes out of a database that somebody else has written: SQLite keeps whatever was put into a column."""

import json
import re
import types
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from sqlalchemy import Dialect, LargeBinary

from fraexp.errors import StoreError

Record = TypeVar("Record")
DEEPEST = 64
"""Levels of stored plain data."""
LARGEST = 2**64
"""Whole numbers in it are smaller."""
OPENING = ("[", "{")
LONG_NUMBER = re.compile(r"\d{20}")
"""What may be a whole number of more than 64 bits, or part of something else."""
FOREIGN = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RecursionError, MemoryError)
"""What reading raises where the database does not hold what fraexp writes."""


class DamagedError(StoreError):
    """What is stored of a sweep cannot be read; whoever knows of which database adds its name."""

    def __init__(self, key: str, finding: str) -> None:
        super().__init__(f"sweep {key[4:12]}: {finding}" if key else finding)


def sound(record: Record) -> Record:
    """Return a dataclass whose values are of the types that it declares, inside of containers aside; else TypeError."""
    record_type: Any = type(record)
    for name, kinds in _kinds(record_type):
        value = getattr(record, name)
        if not isinstance(value, kinds):
            raise TypeError(f"{name} is a {type(value).__name__}")
    return record


@cache
def _kinds(record: type[Any]) -> tuple[tuple[str, tuple[type, ...]], ...]:
    hints = get_type_hints(record)
    return tuple((item.name, _runtime(hints[item.name])) for item in fields(record))


def _runtime(hint: Any) -> tuple[type, ...]:
    if hint is Any:
        return (object,)
    if get_origin(hint) in (Union, types.UnionType):
        return tuple(kind for of in get_args(hint) for kind in _runtime(of))
    kind = get_origin(hint) or hint
    return (float, int) if kind is float else (kind,)


def json_data(text: str) -> Any:
    """Return plain data that nests and counts within reason; ValueError else."""
    data = json.loads(text)
    if sum(map(text.count, OPENING)) > DEEPEST or LONG_NUMBER.search(text):
        _check(data)
    return data


def _check(data: Any) -> None:
    level = [data]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for one in level:
            if isinstance(one, Mapping):
                inner += one.values()
            elif isinstance(one, list):
                inner += one
            elif isinstance(one, int) and abs(one) >= LARGEST:
                raise ValueError(f"a whole number has {one.bit_length()} bits")
        level = inner
        if not level:
            return
    raise ValueError(f"data are nested deeper than {DEEPEST} levels")


class Bytes(LargeBinary):
    """Bytes, and nothing that Python would make bytes of: of a number it makes as many as it says."""

    def result_processor(self, dialect: Dialect, coltype: object) -> Any:
        """Return what checks the bytes."""
        return _bytes


def _bytes(value: Any) -> bytes | None:
    if value is None or isinstance(value, bytes):
        return value
    if isinstance(value, memoryview | bytearray):
        return bytes(value)
    raise TypeError(f"an array is a {type(value).__name__}")


def foreign(name: str, error: BaseException) -> StoreError:
    """Return what is said of a database that does not hold what fraexp writes."""
    what = " ".join(str(error).split())[:100]
    return StoreError(
        f"{name}: it holds what fraexp does not write ({type(error).__name__}: {what}); restore a copy of it"
    )
