"""Making a new database, and bringing an older one up to date after a copy of it."""

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from sqlalchemy import Connection

from fraexp.errors import StoreError
from fraexp.store.engine import APPLICATION_ID, WRITE, Database
from fraexp.store.migrations import FOLDER, HISTORY


@dataclass(frozen=True)
class Schema:
    """A line of revisions and the folders that hold them."""

    history: tuple[str, ...] = HISTORY
    folders: tuple[Path, ...] = (FOLDER / "versions",)

    @property
    def head(self) -> str:
        """The current revision."""
        return self.history[-1]


def prepare(database: Database, create: bool, schema: Schema) -> None:
    """Make sure that there is a database of the current schema to write to; StoreError if there cannot be."""
    place = database.path
    if not database.exists():
        if not create:
            raise StoreError(f"{place}: there is no database yet; 'fraexp run STUDY' makes one")
        database.check_writable()
        with _locked_folder(database):
            if not database.exists():  # somebody else may have been quicker
                _create(database, schema)
    database.check_writable()
    if _checked_revision(database, schema) != schema.head:
        with _locked_folder(database):
            if _checked_revision(database, schema) != schema.head:
                _migrate(database, schema)


def check_readable(database: Database, schema: Schema) -> None:
    """Raise StoreError unless there is a database of the current schema."""
    if not database.exists():
        raise StoreError(f"{database.path}: there is no database yet; 'fraexp run STUDY' makes one")
    revision = _checked_revision(database, schema)
    if revision != schema.head:
        raise StoreError(
            f"{database.path}: its schema {revision} is older than {schema.head}; any 'fraexp run' brings it up to date"
        )


def _checked_revision(database: Database, schema: Schema) -> str:
    revision = database.revision()
    if revision is None:
        raise StoreError(f"{database.path}: the database is damaged (it has no schema); restore a copy of it")
    if revision not in schema.history:
        raise StoreError(
            f"{database.path}: its schema {revision} is newer than this fraexp ({schema.head}); update fraexp"
        )
    return revision


def _create(database: Database, schema: Schema) -> None:
    # Made beside and moved into place: a half-made database never bears the name.
    path = database.path.resolve()
    draft = replace(database, path=path.with_name(f"{path.name}.new"))
    with database.sentences():
        draft.path.unlink(missing_ok=True)
        draft.path.touch()
        _upgrade(draft, schema)
        draft.path.replace(path)


def _migrate(database: Database, schema: Schema) -> None:
    path = database.path.resolve()
    copy = path.with_name(f"{path.name}.bak-{database.revision()}")
    draft = replace(database, path=copy.with_name(f"{copy.name}.new"))
    with database.sentences():
        draft.path.unlink(missing_ok=True)
        with closing(database.connect("mode=ro")) as source, closing(draft.connect("mode=rwc")) as target:
            source.backup(target)
            target.execute("PRAGMA journal_mode = DELETE")  # one file, no companions
        draft.path.replace(copy)
    _upgrade(database, schema)


def _upgrade(database: Database, schema: Schema) -> None:
    # Foreign keys are off, as rebuilding a table would delete what refers to it; they are checked at the end.
    engine = database.writer(("PRAGMA foreign_keys = OFF", "PRAGMA journal_mode = WAL"))
    try:
        with database.sentences(), engine.execution_options(**{WRITE: True}).begin() as connection:
            connection.exec_driver_sql(f"PRAGMA application_id = {APPLICATION_ID}")
            _run_alembic(connection, schema)
            if connection.exec_driver_sql("PRAGMA foreign_key_check").first():
                raise StoreError(f"{database.path}: rows would lose what they refer to; the schema stays as it was")
    finally:
        engine.dispose()


def _run_alembic(connection: Connection, schema: Schema) -> None:
    from alembic import command  # slow to import, and needed once in a database's life
    from alembic.config import Config

    config = Config()
    folders = os.pathsep.join(str(folder) for folder in schema.folders)
    config.set_main_option("path_separator", "os")
    config.set_main_option("script_location", str(FOLDER).replace("%", "%%"))
    config.set_main_option("version_locations", folders.replace("%", "%%"))
    config.attributes["connection"] = connection
    command.upgrade(config, schema.head)


@contextmanager
def _locked_folder(database: Database) -> Iterator[None]:
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
