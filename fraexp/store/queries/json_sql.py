"""SQL of values in stored JSON, for each kind of database; and parsing of the values in a filter."""

import math
import re
from collections.abc import Callable, Collection, Sequence
from datetime import datetime, timedelta
from typing import TypeVar

from sqlalchemy import Boolean, ColumnElement, Float, Text, literal
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from fraexp.data import units
from fraexp.errors import FilterError, ParameterError
from fraexp.store.tables import Expression

Value = TypeVar("Value")
NUMBER_WITH_UNIT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
PATH_SEPARATOR = "\n"
ESCAPE = "/"
RELATIVE_TOLERANCE = 1e-9
"""Relative difference up to which numbers are equal: 0.1 um is not exactly 1e-7."""
TIME_FORMATS = (("%Y-%m-%d", timedelta(days=1)), ("%Y-%m-%dT%H:%M", timedelta(minutes=1)))


class number_at(FunctionElement[float]):  # noqa: N801 (named as the SQL function that it is)
    """The number at a place in a JSON column; NULL if there is none."""

    type = Float()
    inherit_cache = True


class text_at(FunctionElement[str]):  # noqa: N801
    """The value at a place in a JSON column as text, including ``true`` and ``false``; NULL if there is none."""

    type = Text()
    inherit_cache = True


class sorted_at(FunctionElement[float]):  # noqa: N801
    """The value at a place in a JSON column as the first sort key: numbers, then texts."""

    type = Float()
    inherit_cache = True


class text_sorted_at(FunctionElement[str]):  # noqa: N801
    """The second sort key: texts, for databases in which a column has one type."""

    type = Text()
    inherit_cache = True


class has_text(FunctionElement[bool]):  # noqa: N801
    """Whether a text contains another one, ignoring case (of ASCII letters only, in SQLite)."""

    type = Boolean()
    inherit_cache = True


def contains_text(column: Expression, text: str) -> ColumnElement[bool]:
    """Return the SQL of whether a column contains a text, in which no letter has a special meaning."""
    for letter in ESCAPE, "%", "_":
        text = text.replace(letter, ESCAPE + letter)
    found: ColumnElement[bool] = has_text(column, literal(f"%{text}%"))
    return found


@compiles(has_text)
def _has_text(element: has_text, compiler: SQLCompiler, **options: object) -> str:
    column, pattern = (compiler.process(clause, **options) for clause in element.clauses)
    like = "ILIKE" if compiler.dialect.name == "postgresql" else "LIKE"  # which ignores case in SQLite
    return f"({column} {like} {pattern} ESCAPE '{ESCAPE}')"


def json_value(kind: "type[FunctionElement[Value]]", column: Expression, place: Sequence[str]) -> ColumnElement[Value]:
    """Return `kind`, such as number_at, of a place: keys and list indices, from outside to inside."""
    steps = "".join(f"[{part}]" if part.isdecimal() else f'."{part}"' for part in place)
    element: ColumnElement[Value] = kind(column, literal(f"${steps}"), literal(PATH_SEPARATOR.join(place)))
    return element


@compiles(number_at)
def _number_in_sqlite(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    found = f"json_extract({column}, {path})"
    return f"CASE WHEN json_type({column}, {path}) IN ('integer', 'real') THEN {found} END"


@compiles(text_at)
def _text_in_sqlite(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    kind, found = f"json_type({column}, {path})", f"CAST(json_extract({column}, {path}) AS TEXT)"
    return f"CASE {kind} WHEN 'true' THEN 'true' WHEN 'false' THEN 'false' ELSE {found} END"


@compiles(sorted_at)
def _sorted_in_sqlite(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    column, path, _ = (compiler.process(clause, **options) for clause in element.clauses)
    return f"json_extract({column}, {path})"  # once: SQLite sorts numbers before texts


@compiles(text_sorted_at)
def _text_sorted_in_sqlite(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    return "NULL"


def _in_postgresql(element: FunctionElement[Value], compiler: SQLCompiler, operator: str, **options: object) -> str:
    clauses = list(element.clauses)
    column, path = (compiler.process(clauses[index], **options) for index in (0, 2))
    return f"({column} {operator} string_to_array({path}, chr(10)))"


@compiles(number_at, "postgresql")
def _number_in_postgresql(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    found, text = (_in_postgresql(element, compiler, operator, **options) for operator in ("#>", "#>>"))
    return f"CASE WHEN json_typeof({found}) = 'number' THEN CAST({text} AS DOUBLE PRECISION) END"


@compiles(sorted_at, "postgresql")
def _sorted_in_postgresql(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    return _number_in_postgresql(element, compiler, **options)


@compiles(text_sorted_at, "postgresql")
@compiles(text_at, "postgresql")
def _text_in_postgresql(element: FunctionElement[Value], compiler: SQLCompiler, **options: object) -> str:
    return _in_postgresql(element, compiler, "#>>", **options)


UnitLookup = Callable[[], Collection[str]]
"""Returns the units that a number can have."""


def no_units() -> Collection[str]:
    """Return no unit, if the units of numbers are unknown."""
    return ()


def parse_number(text: str, kinds: UnitLookup = no_units) -> float | None:
    """Return the number in base units of a text such as ``12`` or ``0.1um``; None if it is not a number.

    FilterError if `kinds` returns units and the text has a unit of another kind.
    """
    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    if not match:
        return None
    value, unit = float(match[1]), match[2].strip()
    if unit:
        try:
            value *= units.si(unit)[0]
        except ParameterError:
            return None
        _check_unit_kind(unit, sorted(kinds()))
    return value if math.isfinite(value) else None


def unit_in(text: str) -> str:
    """Return the unit after a number, such as mm in ``0.1mm``; empty if the text is no number with a known unit."""
    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    unit = match[2].strip() if match else ""
    try:
        return unit if unit and units.si(unit) else ""
    except ParameterError:
        return ""


def is_of_a_kind(unit: str, kinds: Collection[str]) -> bool:
    """Return whether a unit can be converted to one of `kinds`."""
    return any(_unfit_text(unit, kind) == "" for kind in kinds)


def _unfit_text(unit: str, kind: str) -> str:
    """Return why a unit cannot be converted to another one; empty if it can."""
    try:
        units.factor(unit, kind)
    except ParameterError as error:
        return str(error)
    return ""


def _check_unit_kind(unit: str, kinds: Sequence[str]) -> None:
    """Raise FilterError if a unit is of another kind than all of `kinds`."""
    if not kinds or is_of_a_kind(unit, kinds):
        return
    quoting = ", or quotes around a word to search for" if " " in unit else ""
    raise FilterError(" or ".join([_unfit_text(unit, kinds[0]), *(f"'{kind}'" for kind in kinds[1:])]) + quoting)


def compare_number(column: Expression, operator: str, value: float) -> ColumnElement[bool]:
    """Return the SQL of a comparison of numbers, which are equal if they differ by rounding only."""
    margin = abs(value) * RELATIVE_TOLERANCE
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


def parse_time_span(text: str, now: datetime) -> tuple[datetime, datetime]:
    """Return begin and end of a time such as ``today``, a day or a minute, in the time zone of `now`."""
    if text.lower() in ("today", "yesterday"):
        begin = now.replace(hour=0, minute=0, second=0, microsecond=0)
        begin -= timedelta(days=text.lower() == "yesterday")
        return begin, begin + timedelta(days=1)
    for form, length in TIME_FORMATS:
        try:
            begin = datetime.strptime(text, form).astimezone(now.tzinfo)
        except ValueError:
            continue
        return begin, begin + length
    raise FilterError(
        f"filter: '{text}' is not a date; expected one such as 2026-03-31, 2026-03-31T12:00, today or yesterday"
    )
