"""A SQLite file: one writer, and readers that cannot write; each failure is one sentence."""

import os
import shlex
import sqlite3
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import ClassVar

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.exc import StatementError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.pool import QueuePool

from fraexp.data.atomic_file import try_lock
from fraexp.errors import StoreError, UnavailableError
from fraexp.store.backends.engine import EXCLUSIVE, WRITE_MODE, Database, compact_json
from fraexp.store.damage import RESTORE_HINT
from fraexp.store.tables import create_tables
from fraexp.store.validation import parse_json

APPLICATION_ID = 0x66726178
"""Marks a SQLite file as ours ("frax" in its header)."""
FOREIGN_OBJECTS_SQL = """
    SELECT type, name FROM sqlite_master WHERE type IN ('view', 'trigger')
    UNION ALL SELECT 'virtual table', name FROM sqlite_master WHERE sql LIKE 'create virtual%'
    UNION ALL SELECT 'computed column', tables.name || '.' || of.name
        FROM sqlite_master AS tables JOIN pragma_table_xinfo(tables.name) AS of
        WHERE tables.type = 'table' AND tables.sql NOT LIKE 'create virtual%' AND of.hidden > 1
    LIMIT 1
"""
"""Finds what would run code of the database's author when tables are read or written."""
IMMUTABLE_MODE = "mode=ro&immutable=1"
"""Opens the file as if nothing were beside it, and leaves nothing there."""
FILE_SUFFIXES = ("", "-wal", "-shm", "-journal")
"""Endings of the database's files, its own first."""
LOCKED_BYTES = (512, 0x40000000)
"""Number of bytes, from an offset, that SQLite locks in a file; each open connection holds one of them."""
DAMAGE_CODES = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
SQLITE_MAGIC = b"SQLite format 3\0"
WAL_PRAGMAS = ("PRAGMA journal_mode = WAL", "PRAGMA synchronous = NORMAL")
"""Write-ahead log: readers and the writer do not wait for each other, and a killed process loses nothing."""
JOURNAL_PRAGMAS = ("PRAGMA journal_mode = DELETE", "PRAGMA synchronous = FULL")
"""Rollback journal, for networks: the index of a write-ahead log is shared memory, which computers do not share."""


@dataclass(frozen=True)
class SqliteFile(Database):
    """A SQLite file, whether it exists or not."""

    path: Path
    timeout: float
    """Time to wait for another process that writes [s]."""
    reading: ClassVar[Mapping[str, object]] = {}

    @property
    def name(self) -> str:  # type: ignore[override]
        """The file."""
        return str(self.path)

    def exists(self) -> bool:
        """Return whether there is a database of fraexp; False if the file is missing or empty, otherwise StoreError.

        Only the header of the file is read: SQLite itself would leave files beside a foreign database.
        """
        try:
            if not self.path.exists():
                return False
            if not self.path.is_file():
                raise StoreError(f"{self.path}: this is not a file; name a database file, such as results.db in it")
            with self.path.open("rb") as stream:
                header = stream.read(100)
        except OSError as error:
            raise StoreError(f"{self.path}: cannot be read ({error.strerror}); choose another database") from None
        if not header:
            return False
        if len(header) < 100 or not header.startswith(SQLITE_MAGIC):
            raise StoreError(f"{self.path}: this is not a database; name another file, or move this one away")
        if int.from_bytes(header[68:72]) != APPLICATION_ID:
            raise StoreError(f"{self.path}: this database was not made by fraexp; name another file")
        return True

    def identity(self) -> object:
        """Return device and inode number of the file."""
        try:
            found = self.path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def check_writable(self) -> None:
        """Raise StoreError if the folder is missing, or the folder or the file is read-only."""
        folder = self.path.absolute().parent
        if not folder.is_dir():
            raise StoreError(f"{self.path}: there is no folder {folder}; make it, or choose another database")
        if not _is_writable(folder):
            raise StoreError(f"{self.path}: the folder is read-only; choose a database in a folder of yours")
        if self.path.exists() and not _is_writable(self.path):
            raise StoreError(f"{self.path}: the file is read-only; make it writable, or choose another database")
        if self.has_foreign_log:
            raise StoreError(self._foreign_log_text())

    @cached_property
    def has_foreign_log(self) -> bool:
        """Whether the log beside the file belongs to another one, such as that in whose place a copy was put.

        SQLite would write it into the file. It is recognised because the file is sound without it alone. This is
        checked if the file was written after the log: a writer that dies has written the log last, or both alike.
        """
        try:
            file, log = self.path.stat(), Path(f"{self.path.resolve()}-wal").stat()
        except OSError:
            return False
        if not log.st_size or max(file.st_mtime_ns, file.st_ctime_ns) <= log.st_mtime_ns:
            return False
        return not self._is_sound("mode=ro") and self._is_sound(IMMUTABLE_MODE)

    def _is_sound(self, query: str) -> bool:
        try:
            with closing(self.connect(query)) as connection:
                finding = connection.execute("PRAGMA integrity_check(1)").fetchone()
                return finding == ("ok",) and not connection.execute("PRAGMA foreign_key_check").fetchone()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            return not isinstance(error, sqlite3.Error) or _error_code(error) not in DAMAGE_CODES

    def _foreign_log_text(self) -> str:
        name = shlex.quote(str(self.path))
        return (
            f"{self.path}: the log {self.path.name}-wal beside it belongs to another file; "
            f"'fraexp restore {name} --db {name}' sets it aside"
        )

    def advice(self) -> str:
        """Return a warning if the database lies on a network, or beside the log of another one."""
        if self.has_foreign_log:
            return self._foreign_log_text()
        folder = self.path.resolve().parent
        if not is_on_network(folder):
            return ""
        return (
            f"{self.path}: it lies on a network file system ({file_system_type(folder)}), where writing is slow and "
            "locks may fail; put it on a local disk with --db, or use a server such as postgresql://user@host/database"
        )

    def writer(self) -> Engine:
        """Return an engine with one connection, which can read and write."""
        journal = JOURNAL_PRAGMAS if is_on_network(self.path.resolve().parent) else WAL_PRAGMAS
        return self._create_engine("mode=rw", (*journal, "PRAGMA foreign_keys = ON"))

    def reader(self) -> Engine:
        """Return an engine that cannot write."""
        if self.has_foreign_log:
            return self._create_engine(IMMUTABLE_MODE, ())
        if not _is_writable(self.path.resolve().parent):
            # SQLite reads a database with files beside it; if it cannot create them, nobody can be writing.
            return self._create_engine(self._read_mode(), ())
        if self._has_journal():  # the next process undoes what a killed writer has left unfinished
            return self._create_engine("mode=rw", ("PRAGMA query_only = ON",))
        return self._create_engine("mode=ro", ())

    def schema_number(self) -> int | None:
        with self.translated_errors(), closing(self.connect(self._read_mode())) as connection:
            if strange := connection.execute(FOREIGN_OBJECTS_SQL).fetchone():
                raise StoreError(
                    f"{self.path}: it has a {strange[0]} '{strange[1]}', which fraexp does not make and which could "
                    "run whatever its author wished; drop it, or name another file"
                )
            found = connection.execute("SELECT name FROM sqlite_master WHERE name = 'fraexp_schema'").fetchone()
            row = connection.execute("SELECT number FROM fraexp_schema").fetchone() if found else None
        return row[0] if row else None

    def create(self) -> None:
        self.check_writable()
        with _locked_folder(self):
            if not self.exists():  # another process may have created it meanwhile
                # It is created under another name and moved: an incomplete database never has the name.
                path = self.path.resolve()
                draft = replace(self, path=path.with_name(f"{path.name}.new"))
                with self.translated_errors():
                    _remove_files(draft.path)
                    draft.path.touch()
                    draft._create_tables()
                    draft.path.replace(path)

    def restore(self, source: Database) -> str:
        if not isinstance(source, SqliteFile):
            return super().restore(source)
        path = self.path.resolve()
        draft = path.with_name(f"{path.name}.new")
        with _locked_folder(self), self.translated_errors():
            _remove_files(draft)
            try:
                with closing(source.connect(source._read_mode())) as whole, closing(sqlite3.connect(draft)) as copy:
                    whole.backup(copy)
                    copy.execute("PRAGMA journal_mode = DELETE")  # a single file
                with _sole_use(self.path):
                    aside = _set_aside(path)
                    draft.replace(path)
            finally:
                _remove_files(draft)
        return aside

    def tidy(self) -> None:
        with self.translated_errors(), closing(self.connect("mode=rw")) as connection:
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def size(self) -> int:
        with self.translated_errors():
            return self.path.stat().st_size

    def version(self, connection: Connection) -> int:
        return int(connection.exec_driver_sql("PRAGMA data_version").scalar_one())

    def health(self, connection: Connection) -> str:
        finding = str(connection.exec_driver_sql("PRAGMA integrity_check(1)").scalar_one())
        orphan = connection.exec_driver_sql("PRAGMA foreign_key_check").first()
        if finding != "ok":
            return " ".join(finding.removeprefix("*** in database main ***").split())
        return f"a row of {orphan[0]} refers to a {orphan[2]} that does not exist" if orphan else "sound"

    def _create_tables(self) -> None:
        engine = self.writer()
        try:
            with self.translated_errors(), engine.execution_options(**{WRITE_MODE: EXCLUSIVE}).begin() as connection:
                connection.exec_driver_sql(f"PRAGMA application_id = {APPLICATION_ID}")
                create_tables(connection)
        finally:
            engine.dispose()

    def connect(self, query: str) -> sqlite3.Connection:
        """Return a connection in which no version of Python begins transactions by itself."""
        uri = f"{self.path.resolve().as_uri()}?{query}"
        return sqlite3.connect(uri, uri=True, timeout=self.timeout, isolation_level=None, check_same_thread=False)

    def _read_mode(self) -> str:
        path = self.path.resolve()
        if self._has_journal():
            undo = Path(f"{path}-journal").exists() and _is_writable(path.parent) and _is_writable(path)
            return "mode=rw" if undo else "mode=ro"
        # Without a log nobody uses the database, and it can be read without leaving files beside it.
        has_log = Path(f"{path}-wal").exists() and not self.has_foreign_log
        return "mode=ro" if has_log else IMMUTABLE_MODE

    def _has_journal(self) -> bool:
        """Return whether the file is written with a rollback journal, not with a write-ahead log."""
        try:
            with self.path.open("rb") as stream:
                return stream.read(19)[18:] == b"\1"
        except OSError:  # the connection reports it
            return False

    def _create_engine(self, query: str, pragmas: Sequence[str]) -> Engine:
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
            pool_size=1,  # threads take turns: two connections never write or checkpoint at the same time
            max_overflow=0,
            pool_timeout=self.timeout,
            json_serializer=compact_json,
            json_deserializer=parse_json,
        )
        event.listen(engine, "begin", _begin)
        return engine

    @contextmanager
    def translated_errors(self) -> Iterator[None]:
        """Raise StoreError for the errors of the database and the file system in this context."""
        try:
            yield
        except StatementError as error:
            raise _error_kind(error.orig)(f"{self.path}: {_error_text(error.orig)}") from error
        except sqlite3.Error as error:
            raise _error_kind(error)(f"{self.path}: {_error_text(error)}") from error
        except UnicodeDecodeError as error:  # SQLite's message about a damaged file contains names from it
            raise StoreError(f"{self.path}: {DAMAGED_MESSAGE.format('a name in it is not a text')}") from error
        except OSError as error:
            raise StoreError(f"{self.path}: {error.strerror or error}; check the folder, or choose another") from error
        except PoolTimeoutError as error:
            raise UnavailableError(f"{self.path}: the database is busy in this process; try again") from error


def _remove_files(path: Path) -> None:
    """Remove what an interrupted attempt has left: the file, and a log that would be applied to the next one."""
    for suffix in FILE_SUFFIXES:
        Path(f"{path}{suffix}").unlink(missing_ok=True)


def _set_aside(path: Path) -> str:
    """Rename a database with its log, and return the new name; empty if there is none."""
    if not path.exists():
        return ""
    free = next(name for n in count(1) if not (name := path.with_name(f"{path.name}.before-{n}")).exists())
    for suffix in FILE_SUFFIXES:
        file = Path(f"{path}{suffix}")
        if file.exists():
            file.rename(f"{free}{suffix}")
    return str(free)


@contextmanager
def _sole_use(path: Path) -> Iterator[None]:
    """Keep other processes from opening a database; StoreError if one has it open."""
    if sys.platform == "win32" or not path.exists():  # Windows renames no file that is open
        yield
        return
    import fcntl

    with path.open("r+b") as stream:
        try:
            fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB, *LOCKED_BYTES)
        except BlockingIOError:
            remedy = "end the run ('fraexp stop'), or close the terminal UI"
            raise StoreError(f"{path}: another process has the database open; {remedy}") from None
        yield


def _begin(connection: Connection) -> None:
    # A deferred transaction that begins to write fails at once, whatever the timeout: the lock is requested first.
    writes = WRITE_MODE in connection.get_execution_options()
    # By the driver's cursor, because SQLAlchemy's way to execute a text takes longer than the whole transaction.
    connection.connection.cursor().execute("BEGIN IMMEDIATE" if writes else "BEGIN")


def _is_writable(path: Path) -> bool:
    return os.access(path, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


DAMAGED_MESSAGE = f"the database is damaged ({{}}); {RESTORE_HINT}"


def _error_code(error: BaseException | None) -> int:
    """Return the kind of an error, which is the low byte of SQLite's code."""
    return (getattr(error, "sqlite_errorcode", None) or 0) & 0xFF


def _error_kind(error: BaseException | None) -> type[StoreError]:
    is_locked = _error_code(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
    return UnavailableError if is_locked else StoreError


def _error_text(error: BaseException | None) -> str:
    match _error_code(error):
        case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
            return "the database is locked by another process that writes; wait until it has ended, or stop it"
        case sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM:
            return "the database is open for reading only; choose another, or make it writable"
        case sqlite3.SQLITE_CANTOPEN:
            return "the database cannot be opened; check that file and folder exist and may be written"
        case sqlite3.SQLITE_FULL | sqlite3.SQLITE_IOERR:
            return f"the disk is full or fails ({error}); make room and run again"
        case code if code in DAMAGE_CODES:
            return DAMAGED_MESSAGE.format(error)
    return " ".join(str(error).split()) or "the database failed"


@contextmanager
def _locked_folder(database: SqliteFile) -> Iterator[None]:
    """Hold the lock of the folder: the system releases it if the process dies, and no file is left."""
    if sys.platform == "win32":  # which opens no folder: only the transaction protects
        yield
        return
    with database.translated_errors():
        handle = os.open(database.path.resolve().parent, os.O_RDONLY)
    try:
        deadline = time.monotonic() + database.timeout
        while not try_lock(handle):
            if time.monotonic() > deadline:
                raise StoreError(f"{database.path}: another process is making the database; try again")
            time.sleep(0.02)
        yield
    finally:
        os.close(handle)


NETWORK_TYPES = ("nfs", "cifs", "smb", "9p", "fuse.sshfs", "afs", "lustre", "ceph")
"""Prefixes of the types of file systems that several computers can use at the same time."""


def file_system_type(folder: Path) -> str:
    """Return the type of the file system that holds a folder; ``unknown`` if the system does not report it."""
    import psutil  # only a process that writes asks

    path = folder.resolve()
    try:
        partitions = psutil.disk_partitions(all=True)
    except (OSError, psutil.Error):
        return "unknown"
    holding = [part for part in partitions if path.is_relative_to(part.mountpoint)]
    # The last one mounted at a place covers the earlier ones.
    return max(reversed(holding), key=lambda part: len(part.mountpoint)).fstype if holding else "unknown"


def is_on_network(folder: Path) -> bool:
    """Return whether a folder lies on a file system that several computers can use."""
    return file_system_type(folder).startswith(NETWORK_TYPES)
