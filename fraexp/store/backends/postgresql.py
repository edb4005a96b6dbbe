"""A PostgreSQL server: several runs write at the same time, in complete transactions; each failure is one sentence."""

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar
from urllib.parse import quote, unquote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url, text
from sqlalchemy.exc import ArgumentError, SQLAlchemyError, StatementError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.pool import QueuePool

from fraexp.errors import StoreError, UnavailableError
from fraexp.store.backends.engine import EXCLUSIVE, WRITE_MODE, Database, compact_json, masked_url, url_without_password
from fraexp.store.tables import create_tables

if TYPE_CHECKING:
    import psycopg

WRITE_LOCK_ID = 0x66726178
"""Number ("frax") of the advisory lock of a transaction that excludes other writers."""
IDLE_TIMEOUT_MS = 60_000
"""Time after which the server ends a transaction of a stopped process, for which others wait."""
KEEPALIVE_OPTIONS = {
    "keepalives_idle": 30,
    "keepalives_interval": 10,
    "keepalives_count": 3,
    "tcp_user_timeout": 30_000,  # ms; otherwise a statement waits a quarter of an hour for a host that is gone
}
CONNECTION_ERRORS = (
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
"""Pattern of a connection error, its meaning, and the remedy; the last pattern matches all errors."""
PASSING_CONNECTION_ERRORS = {reason[1] for reason in CONNECTION_ERRORS[-3:]}
"""Meanings of the connection errors that pass without a change of the URL."""
PASSING_SQL_STATES = ("08", "40001", "40P01", "53300", "55P03", "57P01", "57P02", "57P03", "25P03", "25P04")
"""SQL states, or classes of them, after which a later attempt may succeed."""
SQL_STATE_ERRORS = {
    "55P03": "another run writes, and does not come to an end; wait, or stop it",
    "25006": "the database is open for reading only; choose another, or make it writable",
    "42501": "the user may not do this here; ask for the right to make and write tables",
    "53100": "the server's disk is full; make room and run again",
    "53300": "the server has no connection left; close some, or raise its max_connections",
    "57P01": "the server has been shut down; start it and run again",
    "40P01": "two runs waited for each other; run again",
}
"""Meaning and remedy of the SQL states that a user can handle."""


def parse_url(url: str) -> URL:
    """Return a parsed URL; StoreError if it is invalid."""
    address, user, password = _split_credentials(url)
    try:
        parsed = make_url(address)
        parsed = parsed if user is None else parsed.set(username=unquote(user), password=unquote(password))
    except (ArgumentError, ValueError):
        raise StoreError(
            f"{masked_url(url)}: this is not a URL; expected postgresql://user@host:5432/database"
        ) from None
    if not parsed.database:
        raise StoreError(f"{masked_url(url)}: no database is named; expected postgresql://user@host:5432/database")
    return parsed.set(drivername="postgresql+psycopg")


def _split_credentials(url: str) -> tuple[str, str | None, str]:
    """Return a URL without its user and password, and these; user None, and the URL as it is, if it has no password.

    The password ends at the last @ before the options, so that what is special in a URL need not be escaped in it.
    """
    scheme, _, rest = url.partition("://")
    before_options = rest.partition("?")[0]
    is_whole = "@" in before_options or re.match(r"[^@/:]*(:\d+)?/", rest)  # else the ? is one of the password
    end = (before_options if is_whole else rest).rfind("@")
    user, colon, password = rest[: max(end, 0)].partition(":")
    if not colon or any(letter in user for letter in "/?#"):
        return url, None, ""
    return f"{scheme}://{rest[end + 1 :]}", user, password


@dataclass(frozen=True)
class PostgresqlServer(Database):
    """A database on a server, which several runs on several hosts may use."""

    url: URL
    timeout: float
    """Time to wait for other writers [s]."""
    reading: ClassVar[Mapping[str, object]] = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}

    @property
    def name(self) -> str:  # type: ignore[override]
        """The URL without password."""
        return masked_url(self.url.set(drivername="postgresql").render_as_string(hide_password=True))

    @property
    def location(self) -> str:
        """The URL without any sign of a password."""
        return url_without_password(self.url.set(drivername="postgresql").render_as_string(hide_password=False))

    def exists(self) -> bool:
        with self._connect() as connection:
            # Queried first: tables that another process creates in between must be recognised as those of fraexp below.
            foreign = connection.scalar(
                text(
                    "SELECT relname FROM pg_class WHERE relnamespace = to_regnamespace(current_schema()) "
                    "AND relkind IN ('r', 'p', 'v', 'm') LIMIT 1"
                )
            )
            if connection.scalar(text("SELECT to_regclass('run_sweep')")):
                return True
        if foreign:
            raise StoreError(f"{self.name}: there is a table '{foreign}' of others; make a database for fraexp")
        return False

    def identity(self) -> object:
        return None  # a server reports a deleted database itself

    def check_writable(self) -> None:
        """Do nothing: the server knows the rights of the user."""

    def writer(self) -> Engine:
        return self._create_engine(writes=True)

    def reader(self) -> Engine:
        return self._create_engine(writes=False)

    def schema_number(self) -> int | None:
        with self._connect() as connection:
            found = connection.scalar(text("SELECT to_regclass('fraexp_schema')"))
            return connection.scalar(text("SELECT number FROM fraexp_schema")) if found else None

    def create(self) -> None:
        engine = self._create_engine(writes=True)
        try:
            with self.translated_errors(), engine.execution_options(**{WRITE_MODE: EXCLUSIVE}).begin() as connection:
                if connection.scalar(text("SELECT to_regclass('fraexp_schema')")) is None:
                    create_tables(connection)
        finally:
            engine.dispose()

    def tidy(self) -> None:
        with self._connect({"isolation_level": "AUTOCOMMIT"}, writes=True) as connection:
            connection.execute(text("VACUUM (ANALYZE)"))

    def size(self) -> int:
        with self._connect() as connection:
            return int(connection.execute(text("SELECT pg_database_size(current_database())")).scalar_one())

    def version(self, connection: Connection) -> int:
        # Changes with each transaction of the server that begins to write or ends; the query is cheap.
        snapshot = str(connection.execute(text("SELECT CAST(pg_current_snapshot() AS text)")).scalar_one())
        return int.from_bytes(hashlib.blake2b(snapshot.encode(), digest_size=7).digest())

    def health(self, connection: Connection) -> str:
        broken = connection.scalar(
            text("SELECT CAST(CAST(indexrelid AS regclass) AS text) FROM pg_index WHERE NOT indisvalid LIMIT 1")
        )
        return f"the index {broken} is not valid" if broken else "sound"

    @contextmanager
    def translated_errors(self) -> Iterator[None]:
        try:
            yield
        except StatementError as error:
            kind = UnavailableError if _is_passing(error.orig) else StoreError
            raise kind(f"{self.name}: {self._error_text(error.orig)}") from error
        except PoolTimeoutError as error:
            raise UnavailableError(f"{self.name}: the database is busy in this process; try again") from error
        except SQLAlchemyError as error:
            raise StoreError(f"{self.name}: {self._error_text(error)}") from error
        except (TypeError, ValueError) as error:  # the driver refuses values that are not valid JSON or text
            raise StoreError(f"{self.name}: {error}") from error

    @contextmanager
    def _connect(self, options: Mapping[str, object] | None = None, writes: bool = False) -> Iterator[Connection]:
        """Open a separate connection for a few queries."""
        engine = self._create_engine(writes)
        try:
            with self.translated_errors(), engine.execution_options(**(options or {})).connect() as connection:
                yield connection
        finally:
            engine.dispose()

    def _create_engine(self, writes: bool) -> Engine:
        try:
            engine = create_engine(
                self.url,
                poolclass=QueuePool,
                pool_size=1,  # threads take turns
                max_overflow=0,
                pool_timeout=self.timeout,
                pool_pre_ping=True,  # reconnects after a restart of the server
                json_serializer=compact_json,
                connect_args={"connect_timeout": max(2, math.ceil(self.timeout)), **KEEPALIVE_OPTIONS},
            )
        except ModuleNotFoundError:
            raise StoreError(
                f"{self.name}: PostgreSQL needs the package psycopg; install it: pip install 'psycopg[binary]'"
            ) from None
        settings: dict[str, object] = {
            "lock_timeout": math.ceil(1e3 * self.timeout),
            "idle_in_transaction_session_timeout": IDLE_TIMEOUT_MS,
        }
        settings |= {"timezone": "UTC", "application_name": "fraexp"}
        settings |= {} if writes else {"default_transaction_read_only": "on"}

        def apply_settings(connection: "psycopg.Connection", _: object) -> None:
            with connection.cursor() as cursor:
                for name, value in settings.items():
                    cursor.execute(f"SET {name} = '{value}'")
            connection.commit()

        event.listen(engine, "connect", apply_settings)
        event.listen(engine, "begin", _begin)
        return engine

    def _error_text(self, error: BaseException | None) -> str:
        state = getattr(error, "sqlstate", None)
        if state in SQL_STATE_ERRORS:
            return SQL_STATE_ERRORS[state]
        said = _first_line(error)
        for secret in (self.url.password, self.url.query.get("password")):
            for form in (str(secret), quote(str(secret)), quote(str(secret), safe="")) if secret else ():
                said = said.replace(form, "***")
        if _is_connection_error(error):
            what, remedy = _connection_error(error)
            return f"{what} ({said}); {remedy}"
        return said or "the database failed"


def _is_passing(error: BaseException | None) -> bool:
    """Return whether the same call may succeed later: the server restarts, or another process holds a lock."""
    if _is_connection_error(error):
        return _connection_error(error)[0] in PASSING_CONNECTION_ERRORS
    return str(getattr(error, "sqlstate", None)).startswith(PASSING_SQL_STATES)


def _first_line(error: BaseException | None) -> str:
    return " ".join(str(error).partition("\n")[0].split()).removeprefix("connection failed: ")


def _is_connection_error(error: BaseException | None) -> bool:
    """Return whether the connection failed: the server has given no SQL state."""
    names = ("OperationalError", "ConnectionTimeout", "InterfaceError")
    return getattr(error, "sqlstate", None) is None and type(error).__name__ in names


def _connection_error(error: BaseException | None) -> tuple[str, str]:
    """Return the meaning of a connection error, and the remedy."""
    return next(reason[1:] for reason in CONNECTION_ERRORS if re.search(reason[0], _first_line(error)))


def _begin(connection: Connection) -> None:
    # What a transaction reads must not change before it writes: two runs could store the same sweep or name.
    if connection.get_execution_options().get(WRITE_MODE) == EXCLUSIVE:
        connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({WRITE_LOCK_ID})")
