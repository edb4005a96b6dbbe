"""Connections to a SQLite file: one writer, readers that cannot write, and every failure as one sentence."""

import json
import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import StatementError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.pool import QueuePool

from fraexp.errors import StoreError

APPLICATION_ID = 0x66726178
"""Marks a SQLite file as ours ("frax" in its header)."""
MAGIC = b"SQLite format 3\0"
WRITE = "fraexp_write"
"""Execution option of a transaction that is going to write."""
WRITER = ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = NORMAL", "PRAGMA foreign_keys = ON")


def locate(url: str) -> Path:
    """Return the file behind ``sqlite:///file`` or a plain path; StoreError for another kind of database."""
    scheme, separator, rest = url.partition("://")
    if separator and scheme != "sqlite":
        raise StoreError(f"{url}: {scheme} databases are not supported; give a file such as sqlite:///results.db")
    name = rest.removeprefix("/") if separator else url
    if not name or name == ":memory:" or "\0" in name:
        raise StoreError(f"{url!r} names no file; give one such as sqlite:///results.db")
    return Path(name)


@dataclass(frozen=True)
class Database:
    """A SQLite file, whether it exists or not."""

    path: Path
    timeout: float
    """How long to wait for another process that writes [s]."""

    def exists(self) -> bool:
        """Return whether there is a database of ours; False if the file is missing or empty, else StoreError.

        Only the file's header is read: SQLite itself would leave files beside a foreign database.
        """
        try:
            if not self.path.exists():
                return False
            if not self.path.is_file():
                raise StoreError(f"{self.path}: this is no file; name a database file, such as results.db in it")
            with self.path.open("rb") as stream:
                header = stream.read(100)
        except OSError as error:
            raise StoreError(f"{self.path}: cannot be read ({error.strerror}); choose another database") from None
        if not header:
            return False
        if len(header) < 100 or not header.startswith(MAGIC):
            raise StoreError(f"{self.path}: this is no database; name another file, or move this one away")
        if int.from_bytes(header[68:72]) != APPLICATION_ID:
            raise StoreError(f"{self.path}: this database was not made by fraexp; name another file")
        return True

    def check_writable(self) -> None:
        """Raise StoreError if the folder is missing, or it or the file may not be written."""
        folder = self.path.absolute().parent
        if not folder.is_dir():
            raise StoreError(f"{self.path}: there is no folder {folder}; make it, or choose another database")
        if not _may_write(folder):
            raise StoreError(f"{self.path}: the folder is read-only; choose a database in a folder of yours")
        if self.path.exists() and not _may_write(self.path):
            raise StoreError(f"{self.path}: the file is read-only; make it writable, or choose another database")

    def writer(self, pragmas: Sequence[str] = WRITER) -> Engine:
        """Return an engine of one connection, which also reads."""
        return self._engine("mode=rw", pragmas)

    def reader(self) -> Engine:
        """Return an engine that cannot write."""
        # SQLite needs files beside a database to read it; where it cannot make them, nobody can be writing.
        return self._engine("mode=ro" if _may_write(self.path.resolve().parent) else self._undisturbing(), ())

    def revision(self) -> str | None:
        """Return the revision of the schema; None if there is none."""
        with self.sentences(), closing(self.connect(self._undisturbing())) as connection:
            found = connection.execute("SELECT name FROM sqlite_master WHERE name = 'alembic_version'").fetchone()
            row = connection.execute("SELECT version_num FROM alembic_version").fetchone() if found else None
        return str(row[0]) if row else None

    def connect(self, query: str) -> sqlite3.Connection:
        """Return a connection on which only we begin transactions, on every version of Python."""
        uri = f"{self.path.resolve().as_uri()}?{query}"
        return sqlite3.connect(uri, uri=True, timeout=self.timeout, isolation_level=None, check_same_thread=False)

    def _undisturbing(self) -> str:
        # Without a log beside it a database is in use by nobody, and can be read without leaving files there.
        return "mode=ro" if Path(f"{self.path.resolve()}-wal").exists() else "mode=ro&immutable=1"

    def _engine(self, query: str, pragmas: Sequence[str]) -> Engine:
        def connect() -> sqlite3.Connection:
            connection = self.connect(query)
            try:
                for pragma in pragmas:
                    connection.execute(pragma)
            except sqlite3.Error:
                connection.close()
                raise
            return connection

        engine = create_engine(
            "sqlite://",
            creator=connect,
            poolclass=QueuePool,
            pool_size=1,  # threads take turns: two connections never write or checkpoint at once
            max_overflow=0,
            pool_timeout=self.timeout,
            json_serializer=_compact,
        )
        event.listen(engine, "begin", _begin)
        return engine

    @contextmanager
    def sentences(self) -> Iterator[None]:
        """Turn what the database and the file system raise into StoreError."""
        try:
            yield
        except StatementError as error:
            raise StoreError(f"{self.path}: {_sentence(error.orig)}") from error
        except sqlite3.Error as error:
            raise StoreError(f"{self.path}: {_sentence(error)}") from error
        except OSError as error:
            raise StoreError(f"{self.path}: {error.strerror or error}; check the folder, or choose another") from error
        except PoolTimeoutError as error:
            raise StoreError(f"{self.path}: the database is busy in this process; try again") from error


def _begin(connection: Connection) -> None:
    # A deferred transaction that turns to writing is refused at once, whatever the timeout: ask for the lock first.
    writes = connection.get_execution_options().get(WRITE)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _compact(data: Any) -> str:
    return json.dumps(data, separators=(",", ":"))


def _may_write(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


def _sentence(error: BaseException | None) -> str:
    code = getattr(error, "sqlite_errorcode", None) or 0
    match code & 0xFF:  # the low byte is the kind
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            return "the database is locked by another process that writes; wait until it has ended, or stop it"
        case sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM:
            return "the database is open for reading only; choose another, or make it writable"
        case sqlite3.SQLITE_CANTOPEN:
            return "the database cannot be opened; check that file and folder exist and may be written"
        case sqlite3.SQLITE_FULL:
            return "the disk is full; make room and run again"
        case sqlite3.SQLITE_CORRUPT | sqlite3.SQLITE_NOTADB:
            return f"the database is damaged ({error}); restore a copy, or name another file"
    return " ".join(str(error).split()) or "the database failed"
