"""A SQLite file: one writer, readers that cannot write, copies before changes, and every failure as one sentence."""

import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import StatementError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.pool import QueuePool

from fraexp.errors import StoreError
from fraexp.store.backends.engine import ALONE, WRITE, Database, Step, compact
from fraexp.store.backends.file_system import file_system, on_network
from fraexp.store.validation import json_data

APPLICATION_ID = 0x66726178
"""Marks a SQLite file as ours ("frax" in its header)."""
NOT_OURS = """
    SELECT type, name FROM sqlite_master WHERE type IN ('view', 'trigger')
    UNION ALL SELECT 'virtual table', name FROM sqlite_master WHERE sql LIKE 'create virtual%'
    UNION ALL SELECT 'computed column', tables.name || '.' || of.name
        FROM sqlite_master AS tables JOIN pragma_table_xinfo(tables.name) AS of
        WHERE tables.type = 'table' AND tables.sql NOT LIKE 'create virtual%' AND of.hidden > 1
    LIMIT 1
"""
"""What runs code of the database's author when tables are read or written."""
MAGIC = b"SQLite format 3\0"
LOG = ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = NORMAL")
"""Writing to a log: readers and the writer do not wait for each other, and a kill costs nothing."""
JOURNAL = ("PRAGMA journal_mode = DELETE", "PRAGMA synchronous = FULL")
"""Writing with a journal, on a network: the log's index is memory that all who use it share, as computers cannot."""


@dataclass(frozen=True)
class SqliteFile(Database):
    """A SQLite file, whether it exists or not."""

    path: Path
    timeout: float
    """How long to wait for another process that writes [s]."""
    reading: ClassVar[Mapping[str, Any]] = {}
    upgrades_itself: ClassVar[bool] = True

    @property
    def name(self) -> str:  # type: ignore[override]
        """The file."""
        return str(self.path)

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

    def identity(self) -> object:
        """Return device and number of the file."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def check_writable(self) -> None:
        """Raise StoreError if the folder is missing, or it or the file may not be written."""
        folder = self.path.absolute().parent
        if not folder.is_dir():
            raise StoreError(f"{self.path}: there is no folder {folder}; make it, or choose another database")
        if not _may_write(folder):
            raise StoreError(f"{self.path}: the folder is read-only; choose a database in a folder of yours")
        if self.path.exists() and not _may_write(self.path):
            raise StoreError(f"{self.path}: the file is read-only; make it writable, or choose another database")

    def advice(self) -> str:
        """Return where a database that lies on a network should better be; else nothing."""
        folder = self.path.resolve().parent
        if not on_network(folder):
            return ""
        return (
            f"{self.path}: it lies on a network file system ({file_system(folder)}), where writing is slow and locks "
            "may not hold; put it on a local disk with --db, or use a server such as postgresql://user@host/database"
        )

    def writer(self, foreign_keys: bool = True) -> Engine:
        """Return an engine of one connection, which also reads."""
        journal = JOURNAL if on_network(self.path.resolve().parent) else LOG
        return self._engine("mode=rw", (*journal, f"PRAGMA foreign_keys = {'ON' if foreign_keys else 'OFF'}"))

    def reader(self) -> Engine:
        """Return an engine that cannot write."""
        if not _may_write(self.path.resolve().parent):
            # SQLite needs files beside a database to read it; where it cannot make them, nobody can be writing.
            return self._engine(self._undisturbing(), ())
        if self._has_journal():  # what a killed writer has left half-done is undone by whoever comes next
            return self._engine("mode=rw", ("PRAGMA query_only = ON",))
        return self._engine("mode=ro", ())

    def revision(self) -> str | None:
        """Return the revision of the schema; None if there is none."""
        with self.sentences(), closing(self.connect(self._undisturbing())) as connection:
            if strange := connection.execute(NOT_OURS).fetchone():
                raise StoreError(
                    f"{self.path}: it has a {strange[0]} '{strange[1]}', which fraexp does not make and which could "
                    "run whatever its author wished; drop it, or name another file"
                )
            found = connection.execute("SELECT name FROM sqlite_master WHERE name = 'alembic_version'").fetchone()
            row = connection.execute("SELECT version_num FROM alembic_version").fetchone() if found else None
        return str(row[0]) if row else None

    def create(self, first: str, upgrade: Callable[[Connection, str | None], None]) -> None:
        self.check_writable()
        with _locked_folder(self):
            if not self.exists():  # somebody else may have been quicker
                # Made beside and moved into place: a half-made database never bears the name.
                path = self.path.resolve()
                draft = replace(self, path=path.with_name(f"{path.name}.new"))
                with self.sentences():
                    _remove(draft.path)
                    draft.path.touch()
                    draft._change(lambda connection: upgrade(connection, None))
                    draft.path.replace(path)

    def migrate(self, head: str, upgrade: Step) -> None:
        """Copy the file to ``<name>.bak-<revision>``, then change it in one transaction."""
        self.check_writable()
        with _locked_folder(self):
            revision = self.revision()
            if revision != head:
                self._copy(f"bak-{revision}")
                self._change(upgrade)

    def tidy(self) -> None:
        with self.sentences(), closing(self.connect("mode=rw")) as connection:
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def size(self) -> int:
        with self.sentences():
            return self.path.stat().st_size

    def journal(self, connection: Connection) -> str:
        mode = str(connection.exec_driver_sql("PRAGMA journal_mode").scalar_one())
        log = Path(f"{self.path}-wal")
        if mode != "wal" and not self._has_journal():  # a reader that leaves no files sees none
            mode = "wal"
        waiting = log.stat().st_size if log.exists() else 0
        return f"{mode}, {waiting / 1e6:.1f} MB not yet in the file" if waiting else mode

    def version(self, connection: Connection) -> int:
        return int(connection.exec_driver_sql("PRAGMA data_version").scalar_one())

    def health(self, connection: Connection) -> str:
        finding = str(connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one())
        orphan = connection.exec_driver_sql("PRAGMA foreign_key_check").first()
        if finding != "ok":
            return finding
        return f"a row of {orphan[0]} refers to a {orphan[2]} that does not exist" if orphan else "sound"

    def _copy(self, suffix: str) -> None:
        path = self.path.resolve()
        copy = path.with_name(f"{path.name}.{suffix}")
        draft = replace(self, path=copy.with_name(f"{copy.name}.new"))
        with self.sentences():
            _remove(draft.path)
            with closing(self.connect("mode=ro")) as source, closing(draft.connect("mode=rwc")) as target:
                source.backup(target)
                target.execute("PRAGMA journal_mode = DELETE")  # one file, no companions
            draft.path.replace(copy)

    def _change(self, step: Step) -> None:
        # Foreign keys are off, as rebuilding a table would delete what refers to it; they are checked at the end.
        engine = self.writer(foreign_keys=False)
        try:
            with self.sentences(), engine.execution_options(**{WRITE: ALONE}).begin() as connection:
                connection.exec_driver_sql(f"PRAGMA application_id = {APPLICATION_ID}")
                step(connection)
                if connection.exec_driver_sql("PRAGMA foreign_key_check").first():
                    raise StoreError(f"{self.path}: rows would lose what they refer to; the schema stays as it was")
        finally:
            engine.dispose()

    def connect(self, query: str) -> sqlite3.Connection:
        """Return a connection on which only we begin transactions, on every version of Python."""
        uri = f"{self.path.resolve().as_uri()}?{query}"
        return sqlite3.connect(uri, uri=True, timeout=self.timeout, isolation_level=None, check_same_thread=False)

    def _undisturbing(self) -> str:
        path = self.path.resolve()
        if self._has_journal():
            undo = Path(f"{path}-journal").exists() and _may_write(path.parent) and _may_write(path)
            return "mode=rw" if undo else "mode=ro"
        # Without a log beside it a database is in use by nobody, and can be read without leaving files there.
        return "mode=ro" if Path(f"{path}-wal").exists() else "mode=ro&immutable=1"

    def _has_journal(self) -> bool:
        """Return whether the file is written with a journal and not with a log."""
        try:
            with self.path.open("rb") as stream:
                return stream.read(19)[18:] == b"\1"
        except OSError:  # whoever connects is told
            return False

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
            json_serializer=compact,
            json_deserializer=json_data,
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
        except UnicodeDecodeError as error:  # what SQLite says of a damaged file names what it finds there
            raise StoreError(f"{self.path}: {_DAMAGED.format('a name in it is no text')}") from error
        except OSError as error:
            raise StoreError(f"{self.path}: {error.strerror or error}; check the folder, or choose another") from error
        except PoolTimeoutError as error:
            raise StoreError(f"{self.path}: the database is busy in this process; try again") from error


def _remove(path: Path) -> None:
    """Remove what an interrupted attempt may have left: a file, and the log that would be taken for the next one's."""
    for suffix in ("", "-wal", "-shm", "-journal"):
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def _begin(connection: Connection) -> None:
    # A deferred transaction that turns to writing is refused at once, whatever the timeout: ask for the lock first.
    writes = WRITE in connection.get_execution_options()
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _may_write(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


_DAMAGED = "the database is damaged ({}); restore a copy, or name another file"


def _sentence(error: BaseException | None) -> str:
    code = getattr(error, "sqlite_errorcode", None) or 0
    match code & 0xFF:  # the low byte is the kind
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            return "the database is locked by another process that writes; wait until it has ended, or stop it"
        case sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM:
            return "the database is open for reading only; choose another, or make it writable"
        case sqlite3.SQLITE_CANTOPEN:
            return "the database cannot be opened; check that file and folder exist and may be written"
        case sqlite3.SQLITE_FULL | sqlite3.SQLITE_IOERR:
            return f"the disk is full or fails ({error}); make room and run again"
        case sqlite3.SQLITE_CORRUPT | sqlite3.SQLITE_NOTADB:
            return _DAMAGED.format(error)
    return " ".join(str(error).split()) or "the database failed"


@contextmanager
def _locked_folder(database: SqliteFile) -> Iterator[None]:
    """Hold the folder's lock: released by the system if the process dies, and no file is left behind."""
    try:
        import fcntl
    except ImportError:  # Windows: the transaction alone protects
        yield
        return
    with database.sentences():
        handle = os.open(database.path.resolve().parent, os.O_RDONLY)
    try:
        deadline = time.monotonic() + database.timeout
        while not _take(handle, fcntl.LOCK_EX | fcntl.LOCK_NB):
            if time.monotonic() > deadline:
                raise StoreError(f"{database.path}: another process is making the database; try again")
            time.sleep(0.02)
        yield
    finally:
        os.close(handle)


def _take(handle: int, operation: int) -> bool:
    import fcntl

    try:
        fcntl.flock(handle, operation)
    except BlockingIOError:
        return False
    except OSError:  # a file system without such locks: the transaction alone protects
        return True
    return True
