"""A PostgreSQL server: several runs write at once, each transaction whole, and every failure is one sentence."""

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, ClassVar

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, SQLAlchemyError, StatementError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.pool import QueuePool

from fraexp.errors import StoreError
from fraexp.store.backends.engine import ALONE, WRITE, Database, Step, compact, shown
from fraexp.store.tables import metadata

LOCK = 0x66726178
"""Number of the advisory lock ("frax") of a transaction during which no other run may write."""
IDLE = 60_000
"""Milliseconds after which the server ends a transaction whose process is gone or stopped: others wait for it."""
KEEPALIVE = {"keepalives_idle": 30, "keepalives_interval": 10, "keepalives_count": 3}
REASONS = (
    ("password authentication failed", "user and password do not fit", "check them, or write them to ~/.pgpass"),
    ("no password supplied", "the server asks for a password", "write it to ~/.pgpass, or set PGPASSWORD"),
    (r"no pg_hba\.conf entry", "the server does not let this host or user in", "ask who runs it"),
    (r'role ".*" does not exist', "the user does not exist", "check the user in the URL"),
    (r'database ".*" does not exist', "the database does not exist", "make it, for example with createdb"),
    ("permission denied", "the user may not use this database", "ask for the right to connect"),
    ("the database system is", "the server is starting or ending", "wait, and run again"),
    ("too many ", "the server has no connection left", "close some, or raise its max_connections"),
    ("", "the server cannot be reached", "check that it runs, and host and port in the URL"),
)
"""What is found in a refusal to connect, what it means, and what helps; the last one fits everything."""
STATES = {
    "55P03": "another run writes, and does not come to an end; wait, or stop it",
    "25006": "the database is open for reading only; choose another, or make it writable",
    "42501": "the user may not do this here; ask for the right to make and write tables",
    "53100": "the server's disk is full; make room and run again",
    "53300": "the server has no connection left; close some, or raise its max_connections",
    "57P01": "the server has been shut down; start it and run again",
    "40P01": "two runs waited for each other; run again",
}
"""What the states of SQL mean that a user can do something about."""


def parse(url: str) -> URL:
    """Return a URL; StoreError if it is none."""
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError):
        raise StoreError(f"{shown(url)}: this is no URL; expected postgresql://user@host:5432/database") from None
    if not parsed.database:
        raise StoreError(f"{shown(url)}: no database is named; expected postgresql://user@host:5432/database")
    return parsed.set(drivername="postgresql+psycopg")


@dataclass(frozen=True)
class PostgresqlServer(Database):
    """A database on a server; several runs, on several hosts, may use it."""

    url: URL
    timeout: float
    """How long to wait for others that write [s]."""
    reading: ClassVar[Mapping[str, Any]] = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
    upgrades_itself: ClassVar[bool] = False

    @property
    def name(self) -> str:  # type: ignore[override]
        """The URL without password."""
        return shown(self.url.set(drivername="postgresql").render_as_string(hide_password=True))

    def exists(self) -> bool:
        with self._asking() as connection:
            # Asked first: whatever another process makes meanwhile must be known as ours below.
            foreign = connection.scalar(
                text(
                    "SELECT relname FROM pg_class WHERE relnamespace = to_regnamespace(current_schema()) "
                    "AND relkind IN ('r', 'p', 'v', 'm') LIMIT 1"
                )
            )
            if connection.scalar(text("SELECT to_regclass('alembic_version')")):
                if connection.scalar(text("SELECT to_regclass('run_sweep')")):
                    return True
                raise StoreError(f"{self.name}: another program keeps its tables here; make a database for fraexp")
        if foreign:
            raise StoreError(f"{self.name}: there is a table '{foreign}' of others; make a database for fraexp")
        return False

    def identity(self) -> object:
        return None  # a server says itself when a database is gone

    def check_writable(self) -> None:
        """Leave it to the server, which knows what a user may do."""

    def writer(self) -> Engine:
        return self._engine(writes=True)

    def reader(self) -> Engine:
        return self._engine(writes=False)

    def revision(self) -> str | None:
        with self._asking() as connection:
            found = connection.scalar(text("SELECT version_num FROM alembic_version"))
        return None if found is None else str(found)

    def create(self, first: str, upgrade: Callable[[Connection, str | None], None]) -> None:
        with self._alone() as connection:
            if connection.scalar(text("SELECT to_regclass('alembic_version')")) is None:
                metadata.create_all(connection)
                upgrade(connection, first)

    def migrate(self, head: str, upgrade: Step) -> None:
        with self._alone() as connection:
            if connection.scalar(text("SELECT version_num FROM alembic_version")) != head:
                upgrade(connection)

    def tidy(self) -> None:
        with self._asking({"isolation_level": "AUTOCOMMIT"}, writes=True) as connection:
            connection.execute(text("VACUUM (ANALYZE)"))

    def size(self) -> int:
        with self._asking() as connection:
            return int(connection.execute(text("SELECT pg_database_size(current_database())")).scalar_one())

    def version(self, connection: Connection) -> int:
        # Changes with every transaction of the server that begins to write or ends; asking costs nothing.
        snapshot = str(connection.execute(text("SELECT CAST(pg_current_snapshot() AS text)")).scalar_one())
        return int.from_bytes(hashlib.blake2b(snapshot.encode(), digest_size=7).digest())

    def health(self, connection: Connection) -> str:
        broken = connection.scalar(
            text("SELECT CAST(CAST(indexrelid AS regclass) AS text) FROM pg_index WHERE NOT indisvalid LIMIT 1")
        )
        return f"the index {broken} is not valid" if broken else "sound"

    @contextmanager
    def sentences(self) -> Iterator[None]:
        try:
            yield
        except StatementError as error:
            raise StoreError(f"{self.name}: {self._sentence(error.orig)}") from error
        except PoolTimeoutError as error:
            raise StoreError(f"{self.name}: the database is busy in this process; try again") from error
        except SQLAlchemyError as error:
            raise StoreError(f"{self.name}: {self._sentence(error)}") from error
        except (TypeError, ValueError) as error:  # of the driver, about what cannot be written as JSON or as text
            raise StoreError(f"{self.name}: {error}") from error

    @contextmanager
    def _asking(self, options: Mapping[str, Any] | None = None, writes: bool = False) -> Iterator[Connection]:
        """Give a connection of its own for a question or two."""
        engine = self._engine(writes)
        try:
            with self.sentences(), engine.execution_options(**(options or {})).connect() as connection:
                yield connection
        finally:
            engine.dispose()

    @contextmanager
    def _alone(self) -> Iterator[Connection]:
        engine = self._engine(writes=True)
        try:
            with self.sentences(), engine.execution_options(**{WRITE: ALONE}).begin() as connection:
                yield connection
        finally:
            engine.dispose()

    def _engine(self, writes: bool) -> Engine:
        try:
            engine = create_engine(
                self.url,
                poolclass=QueuePool,
                pool_size=1,  # threads take turns
                max_overflow=0,
                pool_timeout=self.timeout,
                pool_pre_ping=True,  # a server that was restarted since is asked again
                json_serializer=compact,
                connect_args={"connect_timeout": max(2, math.ceil(self.timeout)), **KEEPALIVE},
            )
        except ModuleNotFoundError:
            raise StoreError(
                f"{self.name}: PostgreSQL needs the package psycopg; install it with pip install 'fraexp[postgresql]'"
            ) from None
        settings: dict[str, object] = {
            "lock_timeout": math.ceil(1e3 * self.timeout),
            "idle_in_transaction_session_timeout": IDLE,
        }
        settings |= {"timezone": "UTC", "application_name": "fraexp"}
        settings |= {} if writes else {"default_transaction_read_only": "on"}

        def connected(connection: Any, _: object) -> None:
            with connection.cursor() as cursor:
                for name, value in settings.items():
                    cursor.execute(f"SET {name} = '{value}'")
            connection.commit()

        event.listen(engine, "connect", connected)
        event.listen(engine, "begin", _begin)
        return engine

    def _sentence(self, error: BaseException | None) -> str:
        state = getattr(error, "sqlstate", None)
        if state in STATES:
            return STATES[state]
        said = " ".join(str(error).partition("\n")[0].split()).removeprefix("connection failed: ")
        if self.url.password:
            said = said.replace(str(self.url.password), "***")
        if state is None and type(error).__name__ in ("OperationalError", "ConnectionTimeout"):
            what, remedy = next(reason[1:] for reason in REASONS if re.search(reason[0], said))
            return f"{what} ({said}); {remedy}"
        return said or "the database failed"


def _begin(connection: Connection) -> None:
    # What is asked and then written must not change between: results of one sweep from two runs, or one name twice.
    if connection.get_execution_options().get(WRITE) == ALONE:
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({LOCK})")
