"""The tables: runs, sweeps and what was learnt, with units and covariance in columns of their own.

Types are portable to PostgreSQL. Arrays are .npy bytes. A change here needs a revision under `migrations`.
"""

import math
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any, TypeVar

from sqlalchemy import (
    JSON,
    BigInteger,
    Column,
    Connection,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    MetaData,
    SmallInteger,
    String,
    Table,
    Text,
)
from sqlalchemy.dialects import sqlite
from sqlalchemy.types import TypeDecorator

from fraexp.store.validation import Bytes

NAMING = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
}
CHUNK = 500
"""Keys per IN query: databases limit the variables of a statement."""
Key = TypeVar("Key", str, int)
SECTIONS = ("plant", "friction", "controller", "loop", "excitation", "numerics", "compensation", "record")
"""Sections of an experiment that are stored as parts, in the order in which an experiment has them."""
PARTS = ("rest", *SECTIONS, "estimator")
"""All parts of a sweep; `rest` is what stands in its experiment beside the sections."""


class Utc(TypeDecorator[datetime]):
    """An aware moment in UTC; SQLite forgets time zones, so they are taken off and put back here."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the moment in UTC as the database takes it."""
        if value is None:
            return None
        moment = value.astimezone(UTC)
        return moment.replace(tzinfo=None) if dialect.name == "sqlite" else moment

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the moment with its time zone."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Number(TypeDecorator[float]):
    """A float that may be NaN or infinite; SQLite has no NaN, so it is NULL there and everywhere."""

    impl = Float(precision=53)
    cache_ok = True

    def process_bind_param(self, value: float | None, dialect: Dialect) -> float | None:
        """Return None for NaN."""
        return None if value is None or math.isnan(value) else float(value)

    def process_result_value(self, value: float | None, dialect: Dialect) -> float:
        """Return NaN for None."""
        return math.nan if value is None else value


class Words(TypeDecorator[str]):
    """Free text; what no encoding can hold (file names of unknown encoding, NUL) is written as escapes."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return text that every database takes."""
        return None if value is None else value.encode("utf-8", "backslashreplace").decode().replace("\0", "\\x00")


LATEST, OVERTAKEN, REPEATED = range(3)
"""Standing of a sweep in a run: it is its latest run, a later one has it too, or it stands in this run once before."""


def _array(name: str, nullable: bool = False) -> Column[bytes]:
    return Column(name, Bytes, nullable=nullable)


def _text(name: str, default: str | None = None) -> Column[str]:
    return Column(name, Words, nullable=False, default=default)


def _sweep_key(**options: Any) -> Column[str]:
    return Column("key", String(64), ForeignKey("sweep.key", ondelete="CASCADE"), nullable=False, **options)


metadata = MetaData(naming_convention=NAMING)

run = Table(
    "run",
    metadata,
    Column("number", Integer, primary_key=True),
    _text("study"),
    _text("study_file"),
    _text("command"),
    Column("state", String(16), nullable=False),
    Column("started", Utc, nullable=False),
    Column("ended", Utc),
    Column("heartbeat", Utc, nullable=False),
    _text("host"),
    _text("boot"),
    Column("pid", Integer, nullable=False),
    Column("process_start", BigInteger),  # clock ticks since boot, where known
    Column("provenance", JSON, nullable=False),
    Column("progress", JSON(none_as_null=True)),  # as the run last told it; NULL before
    sqlite_autoincrement=True,  # a run's number is its name: never given twice
)

sweep = Table(
    "sweep",
    metadata,
    Column("key", String(64), primary_key=True),
    Column("experiment_key", String(64), nullable=False, index=True),
    Column("outcome", String(16)),  # name of the Outcome; NULL while there is no result
    _text("message", ""),
    Column("elapsed", Float(precision=53), nullable=False, default=0.0),
    Column("numerics", Words, nullable=False, default="", server_default=""),  # how it was computed
    Column("created", Utc, index=True),
    Column("source", Words),
    Column("plant_name", Words),
    Column("friction_name", Words),
    Column("controller_name", Words),
    Column("excitation_name", Words),
    Column("estimator_name", Words, index=True),
    # Numbers of parts, NULL where there is none. Not declared as references: an index on each, which removing
    # parts would need, is larger than the table.
    *(Column(f"{name}_part", Integer) for name in PARTS),
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
    Column("name", Words, primary_key=True),
)
"""Names that sweeps can be found by."""

tag = Table(
    "tag",
    metadata,
    _sweep_key(primary_key=True),
    Column("name", Words, primary_key=True, index=True),
)

note = Table(
    "note",
    metadata,
    _sweep_key(primary_key=True),
    _text("text"),
)

run_sweep = Table(
    "run_sweep",
    metadata,
    Column("run", Integer, ForeignKey("run.number", ondelete="CASCADE"), primary_key=True),
    Column("position", Integer, primary_key=True),
    _sweep_key(),
    Column("labels", JSON, nullable=False),
    Column("state", String(16), nullable=False, default="pending"),
    _text("message", ""),
    _text("log", ""),
    Column("standing", SmallInteger, nullable=False, default=LATEST, server_default="0"),
    # All that listings ask of a sweep's latest run, so that they need not read its labels.
    Index("ix_run_sweep_key_standing_state_run", "key", "standing", "state", "run"),
)

lease = Table(
    "lease",
    metadata,
    _sweep_key(primary_key=True),
    Column("run", Integer, ForeignKey("run.number", ondelete="CASCADE"), nullable=False),
)
"""Sweeps that a run has taken upon itself; what its heartbeat does not keep alive counts for nothing."""

frequency_response = Table(
    "frequency_response",
    metadata,
    _sweep_key(primary_key=True),
    _text("unit"),
    _text("input"),
    _text("output"),
    Column("points", Integer, nullable=False),
    _array("frequency"),  # Hz, float (n,)
    _array("response"),  # unit, complex (n,)
    _array("covariance"),  # of (real, imaginary) part, unit², float (n, 2, 2)
    _array("input_amplitude"),  # unit of the input, float (n,)
    _array("output_amplitude"),  # unit of the output, float (n,)
    _array("settled"),  # bool (n,)
    _array("settling_time"),  # s, float (n,)
    _array("residual"),  # float (n,)
    _array("harmonics"),  # relative to the fundamental, complex (n, 6)
    _array("freedom", nullable=True),  # of the covariance, float (n,)
    _array("noise_variance", nullable=True),  # unit², float (n,)
    _array("nonlinear_variance", nullable=True),  # unit², float (n,)
    _array("coherence", nullable=True),  # squared, float (n,)
    _array("model_covariance", nullable=True),  # of 1/response, 1/unit², float (n, 2, 2)
)

metric = Table(
    "metric",
    metadata,
    _sweep_key(primary_key=True),
    Column("position", Integer, primary_key=True),
    _text("name"),
    Column("value", Number),  # NULL: not a number
    _text("unit"),
    Index("ix_metric_name_key_value", "name", "key", "value"),
)

curve = Table(
    "curve",
    metadata,
    _sweep_key(primary_key=True),
    Column("position", Integer, primary_key=True),
    _text("name"),
)

curve_column = Table(
    "curve_column",
    metadata,
    Column("key", String(64), primary_key=True),
    Column("curve", Integer, primary_key=True),
    Column("position", Integer, primary_key=True),
    _text("name"),
    Column("unit", Words),
    _array("samples"),
    ForeignKeyConstraint(["key", "curve"], ["curve.key", "curve.position"], ondelete="CASCADE"),
)

fit = Table(
    "fit",
    metadata,
    _sweep_key(primary_key=True),
    Column("position", Integer, primary_key=True),
    Column("kind", String(32), nullable=False),
    Column("component", JSON, nullable=False),
    Column("parameters", JSON, nullable=False),  # names
    Column("units", JSON, nullable=False),
    _array("values"),  # float (p,)
    _array("covariance"),  # products of the units, float (p, p)
)

supplied_component = Table(
    "supplied_component",
    metadata,
    _sweep_key(primary_key=True),
    Column("kind", String(32), primary_key=True),
    Column("name", String(128), primary_key=True),
    Column("version", Integer),
    _text("source_hash"),
    _text("distribution"),
)

RESULT_TABLES = (curve_column, curve, metric, fit, frequency_response, supplied_component)
"""What belongs to a result and goes with it, children first."""


def insert_or_ignore(connection: Connection, table: Table) -> Any:
    """Return an INSERT that leaves rows alone which are there already."""
    if connection.dialect.name == "postgresql":
        from sqlalchemy.dialects import postgresql  # which takes its time to import

        return postgresql.insert(table).on_conflict_do_nothing()
    return sqlite.insert(table).on_conflict_do_nothing()


def chunks(keys: Iterable[Key]) -> Iterator[list[Key]]:
    """Yield the distinct keys in lists short enough for an IN query."""
    distinct = list(dict.fromkeys(keys))
    for start in range(0, len(distinct), CHUNK):
        yield distinct[start : start + CHUNK]
