"""The tables of the database: runs, sweeps, results, and their tags.

Types are portable to PostgreSQL. Arrays are .npy bytes. A change here needs another SCHEMA_NUMBER.
"""

import math
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any, NamedTuple, TypeVar

import numpy as np
from sqlalchemy import (
    JSON,
    BigInteger,
    Column,
    ColumnElement,
    Connection,
    DateTime,
    Dialect,
    Executable,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Insert,
    Integer,
    MetaData,
    Row,
    RowMapping,
    Select,
    SmallInteger,
    String,
    Table,
    Text,
    bindparam,
)
from sqlalchemy.dialects import sqlite
from sqlalchemy.types import TypeDecorator

from fraexp.store.validation import CheckedBytes

NAMING_CONVENTION = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
}
SCHEMA_NUMBER = 3
"""Number of the schema that this module declares."""
MAX_KEYS_PER_QUERY = 500
"""Keys of an IN query: databases limit the variables of a statement."""
Key = TypeVar("Key", str, int)
RowValues = dict[str, Any]
"""Values of a row by column."""
TableRow = RowMapping | RowValues
"""A row that has been read, by column."""
ResultRow = Row[Any]
"""A row of a query's result; its columns are attributes."""
Query = Select[Any]
Expression = ColumnElement[Any]
"""An SQL expression of any type."""
SECTIONS = ("plant", "friction", "controller", "loop", "excitation", "numerics", "compensation", "record")
"""Sections of an experiment that are stored as parts, in the order in which an experiment has them."""
PARTS = ("rest", *SECTIONS, "estimator")
"""All parts of a sweep; `rest` is what its experiment has beside the sections."""


class UtcDateTime(TypeDecorator[datetime]):
    """A moment in UTC; SQLite does not store time zones, so they are removed and restored here."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the moment in UTC as the database stores it."""
        if value is None:
            return None
        moment = value.astimezone(UTC)
        return moment.replace(tzinfo=None) if dialect.name == "sqlite" else moment

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the moment with its time zone."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class NullableFloat(TypeDecorator[float]):
    """A float that may be NaN or infinite; NaN is stored as NULL, because SQLite has no NaN."""

    impl = Float(precision=53)
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Return None for NaN."""
        return None if value is None or math.isnan(value) else float(value)

    def process_result_value(self, value: float | None, dialect: Dialect) -> float:
        """Return NaN for None."""
        return math.nan if value is None else value


class EscapedText(TypeDecorator[str]):
    """Free text; what no encoding can store (file names of unknown encoding, NUL) is written as escapes."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return text that every database accepts."""
        return None if value is None else value.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")


STANDING_LATEST, STANDING_OVERTAKEN, STANDING_REPEATED = range(3)
"""Standing of a sweep in a run: it is the sweep's latest run, a later run has the sweep, or the run has it twice."""
IN_RUNS, WITHOUT_RUN = "yes", "no"
"""Whether a run has a sweep: words, of which none becomes the other one by a few changed bits."""


def _array_column(name: str) -> Column[bytes]:
    return Column(name, CheckedBytes, nullable=False)


def _text_column(name: str, default: str | None = None) -> Column[str]:
    return Column(name, EscapedText, nullable=False, default=default)


def _digest_column(name: str) -> Column[int]:
    return Column(name, BigInteger)


def _sweep_key_column(primary_key: bool = False) -> Column[str]:
    reference = ForeignKey("sweep.key", ondelete="CASCADE")
    return Column("key", String(64), reference, nullable=False, primary_key=primary_key)


metadata = MetaData(naming_convention=NAMING_CONVENTION)

schema = Table("fraexp_schema", metadata, Column("number", Integer, primary_key=True, autoincrement=False))
"""One row: the SCHEMA_NUMBER of the database."""

run = Table(
    "run",
    metadata,
    Column("number", Integer, primary_key=True),
    _text_column("study"),
    _text_column("study_file"),
    _text_column("command"),
    Column("state", String(16), nullable=False),
    Column("started", UtcDateTime, nullable=False),
    Column("ended", UtcDateTime),
    Column("heartbeat", UtcDateTime, nullable=False),
    _text_column("host"),
    _text_column("boot"),
    Column("pid", Integer, nullable=False),
    Column("process_start", BigInteger),  # clock ticks since boot, where known
    Column("provenance", JSON, nullable=False),
    Column("progress", JSON(none_as_null=True)),  # as the run last reported it; NULL before
    Column("sweeps", Integer, nullable=False, default=0),  # number of its rows of run_sweep
    Column("deleted", Integer, nullable=False, default=0),  # number of those that were deleted
    _digest_column("digest"),
    Column("sweep_digests", BigInteger, nullable=False, default=0),  # sum of those of these rows
    sqlite_autoincrement=True,  # a run's number is its name: never given twice
)

sweep = Table(
    "sweep",
    metadata,
    Column("key", String(64), primary_key=True),
    Column("experiment_key", String(64), nullable=False, index=True),
    Column("outcome", String(16)),  # name of the Outcome; NULL while there is no result
    Column("findings", JSON, nullable=False, default=list),  # as Finding.plain gives each
    Column("elapsed", Float(precision=53), nullable=False, default=0.0),
    Column("numerics", EscapedText, nullable=False, default=""),  # how it was computed
    Column("created", UtcDateTime, index=True),
    Column("source", EscapedText),
    Column("plant_name", EscapedText),
    Column("friction_name", EscapedText),
    Column("controller_name", EscapedText),
    Column("excitation_name", EscapedText),
    Column("estimator_name", EscapedText, index=True),
    # So that a sweep whose run is not found, because an index is damaged, does not seem to have none.
    Column("in_runs", String(8), nullable=False, default=WITHOUT_RUN),
    # Numbers of parts, NULL where there is none. Not declared as references: an index on each, which removing
    # parts would need, is larger than the table.
    *(Column(f"{name}_part", Integer) for name in PARTS),
    _digest_column("digest"),  # of what listings show
    _digest_column("content"),  # of the result; NULL without one
    _digest_column("origins"),  # of the origins of its components
    _digest_column("parts"),  # of its parts
    _digest_column("tags"),  # NULL without any
)

part = Table(
    "part",
    metadata,
    Column("number", Integer, primary_key=True),
    Column("section", String(16), nullable=False),
    Column("digest", String(40), nullable=False, unique=True),
    Column("content", JSON, nullable=False),  # without long lists, so that it is quick to search
    Column("lists", JSON(none_as_null=True)),  # [[path, list], ...] of the long ones
)
"""Sections of experiments, and estimators, each stored once however many sweeps have it."""

field = Table(
    "field",
    metadata,
    Column("kind", String(16), primary_key=True),  # parameter, label, metric, or word: the name of a component
    Column("name", EscapedText, primary_key=True),
)
"""Names that a filter can use."""

tag = Table(
    "tag", metadata, _sweep_key_column(primary_key=True), Column("name", EscapedText, primary_key=True, index=True)
)

run_sweep = Table(
    "run_sweep",
    metadata,
    Column("run", Integer, ForeignKey("run.number", ondelete="CASCADE"), primary_key=True),
    Column("position", Integer, primary_key=True),
    _sweep_key_column(),
    Column("labels", JSON, nullable=False),
    Column("state", String(16), nullable=False, default="pending"),
    _text_column("message", ""),
    _text_column("log", ""),
    Column("standing", SmallInteger, nullable=False, default=STANDING_LATEST),
    Column("log_digest", BigInteger, nullable=False, default=0),
    _digest_column("digest"),
    # Contains all that a listing reads of a sweep's latest run, except its labels.
    Index("ix_run_sweep_key_standing_state_run", "key", "standing", "state", "run"),
)

lease = Table(
    "lease",
    metadata,
    _sweep_key_column(primary_key=True),
    Column("run", Integer, ForeignKey("run.number", ondelete="CASCADE"), nullable=False),
)
"""Sweeps that a run has claimed; a lease is valid as long as the run sends heartbeats."""


class ArrayField(NamedTuple):
    """An array of a frequency response, with a value for each of its n frequencies."""

    dtype: type
    sides: tuple[int, ...] = ()
    """Sides beside the frequencies."""
    is_optional: bool = False


RESPONSE_ARRAYS = {
    "frequency": ArrayField(np.float64),  # Hz
    "response": ArrayField(np.complex128),  # unit
    "covariance": ArrayField(np.float64, (2, 2)),  # of (real, imaginary) part, unit²
    "input_amplitude": ArrayField(np.float64),  # unit of the input
    "output_amplitude": ArrayField(np.float64),  # unit of the output
    "settled": ArrayField(np.bool_),
    "settling_time": ArrayField(np.float64),  # s
    "residual": ArrayField(np.float64),
    "harmonics": ArrayField(np.complex128, (6,)),  # relative to the fundamental
    "freedom": ArrayField(np.float64, is_optional=True),  # of the covariance
    "noise_variance": ArrayField(np.float64, is_optional=True),  # unit²
    "nonlinear_variance": ArrayField(np.float64, is_optional=True),  # unit²
    "coherence": ArrayField(np.float64, is_optional=True),  # squared
    "model_covariance": ArrayField(np.float64, (2, 2), is_optional=True),  # of 1/response, 1/unit²
    "numerical_error": ArrayField(np.float64, is_optional=True),  # relative
}

frequency_response = Table(
    "frequency_response",
    metadata,
    _sweep_key_column(primary_key=True),
    _text_column("unit"),
    _text_column("input"),
    _text_column("output"),
    Column("points", Integer, nullable=False),
    *(Column(name, CheckedBytes, nullable=of.is_optional) for name, of in RESPONSE_ARRAYS.items()),
)

metric = Table(
    "metric",
    metadata,
    _sweep_key_column(primary_key=True),
    Column("position", Integer, primary_key=True),
    _text_column("name"),
    Column("value", NullableFloat),  # NULL: not a number
    _text_column("unit"),
    Index("ix_metric_name_key_value", "name", "key", "value"),
)

curve = Table(
    "curve",
    metadata,
    _sweep_key_column(primary_key=True),
    Column("position", Integer, primary_key=True),
    _text_column("name"),
)

curve_column = Table(
    "curve_column",
    metadata,
    Column("key", String(64), primary_key=True),
    Column("curve", Integer, primary_key=True),
    Column("position", Integer, primary_key=True),
    _text_column("name"),
    Column("unit", EscapedText),
    _array_column("samples"),
    ForeignKeyConstraint(["key", "curve"], ["curve.key", "curve.position"], ondelete="CASCADE"),
)

fit = Table(
    "fit",
    metadata,
    _sweep_key_column(primary_key=True),
    Column("position", Integer, primary_key=True),
    Column("kind", String(32), nullable=False),
    Column("component", JSON, nullable=False),
    Column("parameters", JSON, nullable=False),  # names
    Column("units", JSON, nullable=False),
    _array_column("values"),  # float (p,)
    _array_column("covariance"),  # products of the units, float (p, p)
)

supplied_component = Table(
    "supplied_component",
    metadata,
    _sweep_key_column(primary_key=True),
    Column("kind", String(32), primary_key=True),
    Column("name", String(128), primary_key=True),
    Column("version", Integer),
    _text_column("source_hash"),
    _text_column("distribution"),
)

RESULT_TABLES = (curve_column, curve, metric, fit, frequency_response, supplied_component)
"""Tables of a result's parts, which are deleted with it, children first."""
SWEEP_TABLES = (sweep, tag, *reversed(RESULT_TABLES))
"""Tables with all that belongs to a sweep outside of runs, parents first."""


def _trash_of(table: Table) -> Table:
    columns = (Column(of.name, of.type, primary_key=of.primary_key, autoincrement=False) for of in table.columns)
    moment = [Column("deleted_at", UtcDateTime, nullable=False)] if table in (run, sweep) else []
    return Table(f"trash_{table.name}", metadata, *columns, *moment)


TRASH = {table: _trash_of(table) for table in (run, run_sweep, *SWEEP_TABLES)}
"""For each table the one in which its deleted rows are kept, as they were, until the trash is emptied."""


def create_tables(connection: Connection) -> None:
    """Create all tables, and note the number of the schema."""
    metadata.create_all(connection)
    connection.execute(schema.insert().values(number=SCHEMA_NUMBER))


def insert_or_ignore(connection: Connection, table: Table) -> Insert:
    """Return an INSERT that skips rows which exist already."""
    if connection.dialect.name == "postgresql":
        from sqlalchemy.dialects import postgresql  # its import takes time

        return postgresql.insert(table).on_conflict_do_nothing()
    return sqlite.insert(table).on_conflict_do_nothing()


def is_one_of(column: Column[Any]) -> Expression:
    """Return the condition of a prepared statement that a column has one of the values of its parameter `keys`.

    SQLAlchemy takes several times as long to build a statement as to execute it: those of a run are built once.
    """
    return column.in_(bindparam("keys", expanding=True))


def scalars_of(connection: Connection, statement: Executable, keys: Iterable[Key], **values: object) -> set[Any]:
    """Return the first column of a prepared statement for all of its `keys`, however many."""
    return {found for chunk in key_chunks(keys) for found in connection.scalars(statement, {**values, "keys": chunk})}


def key_chunks(keys: Iterable[Key]) -> Iterator[list[Key]]:
    """Yield the distinct keys in lists short enough for an IN query."""
    distinct = list(dict.fromkeys(keys))
    for start in range(0, len(distinct), MAX_KEYS_PER_QUERY):
        yield distinct[start : start + MAX_KEYS_PER_QUERY]
