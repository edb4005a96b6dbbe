"""Values inside stored JSON as SQL, for every database; and values as people write them in a filter."""

import math
import re
from collections.abc import Callable, Collection, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Boolean, ColumnElement, Float, Text, literal
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import FunctionElement

from fraexp.data import units
from fraexp.errors import ParameterError, StoreError

NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
PATH_SEPARATOR = "\n"
ESCAPE = "/"
SAME = 1e-9
"""Relative difference up to which numbers are equal: 0.1 um is not exactly 1e-7."""
UNITS_OF_TIME = (("%Y-%m-%d", timedelta(days=1)), ("%Y-%m-%dT%H:%M", timedelta(minutes=1)))


class number_at(FunctionElement[float]):  # noqa: N801 (named as the SQL function that it is)
    """The number at a place in a JSON column; NULL where there is none."""

    type = Float()
    inherit_cache = True


class text_at(FunctionElement[str]):  # noqa: N801
    """What is at a place in a JSON column as text, ``true`` and ``false`` included; NULL where there is nothing."""

    type = Text()
    inherit_cache = True


class sorted_at(FunctionElement[float]):  # noqa: N801
    """What is at a place in a JSON column, to sort by before `text_sorted_at`: numbers, then texts."""

    type = Float()
    inherit_cache = True


class text_sorted_at(FunctionElement[str]):  # noqa: N801
    """The rest of `sorted_at`, for databases in which a column has one type."""

    type = Text()
    inherit_cache = True


class has_text(FunctionElement[bool]):  # noqa: N801
    """Whether a text holds another one, in capital letters or small ones (of ASCII alone, in SQLite)."""

    type = Boolean()
    inherit_cache = True


def contains(column: ColumnElement[Any], text: str) -> ColumnElement[bool]:
    """Return whether a column holds a text, in which nothing has a special meaning."""
    for letter in ESCAPE, "%", "_":
        text = text.replace(letter, ESCAPE + letter)
    found: ColumnElement[bool] = has_text(column, literal(f"%{text}%"))
    return found


@compiles(has_text)
def _has_text(element: Any, compiler: Any, **options: Any) -> str:
    column, pattern = (compiler.process(clause, **options) for clause in element.clauses)
    like = "ILIKE" if compiler.dialect.name == "postgresql" else "LIKE"  # which ignores case in SQLite
    return f"({column} {like} {pattern} ESCAPE '{ESCAPE}')"


def at(kind: Any, column: ColumnElement[Any], place: Sequence[str]) -> ColumnElement[Any]:
    """Return `kind` (number_at or text_at) of a place: keys, and numbers of list items, from outside to inside."""
    steps = "".join(f"[{part}]" if part.isdecimal() else f'."{part}"' for part in place)
    element: ColumnElement[Any] = kind(column, literal(f"${steps}"), literal(PATH_SEPARATOR.join(place)))
    return element


@compiles(number_at)
def _number_in_sqlite(element: Any, compiler: Any, **options: Any) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    found = f"json_extract({column}, {path})"
    return f"CASE WHEN json_type({column}, {path}) IN ('integer', 'real') THEN {found} END"


@compiles(text_at)
def _text_in_sqlite(element: Any, compiler: Any, **options: Any) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    kind, found = f"json_type({column}, {path})", f"CAST(json_extract({column}, {path}) AS TEXT)"
    return f"CASE {kind} WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' ELSE {found} END"


@compiles(sorted_at)
def _sorted_in_sqlite(element: Any, compiler: Any, **options: Any) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    return f"json_extract({column}, {path})"  # once: SQLite sorts numbers before texts


@compiles(text_sorted_at)
def _text_sorted_in_sqlite(element: Any, compiler: Any, **options: Any) -> str:
    return "NULL"


def _in_postgresql(element: Any, compiler: Any, operator: str, **options: Any) -> str:
    clauses = list(element.clauses)
    column, path = (compiler.process(clauses[index], **options) for index in (0, 2))
    return f"({column} {operator} string_to_array({path}, chr(10)))"


@compiles(number_at, "postgresql")
def _number_in_postgresql(element: Any, compiler: Any, **options: Any) -> str:
    found, text = (_in_postgresql(element, compiler, operator, **options) for operator in ("#>", "#>>"))
    return f"CASE WHEN json_typeof({found}) = 'number' THEN CAST({text} AS DOUBLE PRECISION) END"


@compiles(sorted_at, "postgresql")
def _sorted_in_postgresql(element: Any, compiler: Any, **options: Any) -> str:
    return _number_in_postgresql(element, compiler, **options)


@compiles(text_sorted_at, "postgresql")
@compiles(text_at, "postgresql")
def _text_in_postgresql(element: Any, compiler: Any, **options: Any) -> str:
    return _in_postgresql(element, compiler, "#>>", **options)


Kinds = Callable[[], Collection[str]]


def unknown() -> Collection[str]:
    """Return no unit, where nothing is known of those that numbers may have."""
    return ()


def number(text: str, kinds: Kinds = unknown) -> float | None:
    """Return the number, in base units, that a text such as ``12`` or ``0.1um`` tells; None if it tells none.

    StoreError if it has a unit that is of another kind than all that `kinds` returns, if it returns any.
    """
    match = NUMBER.fullmatch(text.strip())
    if not match:
        return None
    value, unit = float(match[1]), match[2].strip()
    if unit:
        try:
            value *= units.si(unit)[0]
        except ParameterError:
            return None
        _check_kind(unit, sorted(kinds()))
    return value if math.isfinite(value) else None


def _check_kind(unit: str, kinds: Sequence[str]) -> None:
    """Raise StoreError if a unit is of another kind than each of some units."""
    unfit = ""
    for kind in kinds:
        try:
            units.factor(unit, kind)
            return
        except ParameterError as error:
            unfit = f"{unfit} or '{kind}'" if unfit else str(error)
    if unfit:
        raise StoreError(unfit)


def compared(column: ColumnElement[Any], operator: str, value: float) -> ColumnElement[bool]:
    """Return a comparison of numbers that takes those for equal that differ by rounding alone."""
    margin = abs(value) * SAME
    low, high = literal(value - margin, Float()), literal(value + margin, Float())
    match operator:
        case ">":
            return column > high
        case ">=":
            return column >= low
        case "<":
            return column < low
        case "<=":
            return column <= high
    return column.between(low, high)


def span(text: str, now: datetime) -> tuple[datetime, datetime]:
    """Return begin and end of the time that a text names, in the time zone of `now`: ``today``, a day or a minute."""
    if text.lower() in ("today", "yesterday"):
        begin = now.replace(hour=0, minute=0, second=0, microsecond=0)
        begin -= timedelta(days=text.lower() == "yesterday")
        return begin, begin + timedelta(days=1)
    for form, length in UNITS_OF_TIME:
        try:
            begin = datetime.strptime(text, form).astimezone(now.tzinfo)
        except ValueError:
            continue
        return begin, begin + length
    raise StoreError(
        f"filter: '{text}' is no date; expected one such as 2026-03-31, 2026-03-31T12:00, today or yesterday"
    )
