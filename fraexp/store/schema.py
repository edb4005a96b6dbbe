"""Making a new database, and bringing an older one up to date."""

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Connection

from fraexp.errors import StoreError
from fraexp.store.backends.engine import Database
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

    def upgrade(self, connection: Connection, made: str | None = None) -> None:
        """Run the revisions that the tables lack; `made` is that of tables which nobody has run revisions on."""
        from alembic import command  # slow to import, and needed once in a database's life
        from alembic.config import Config

        config = Config()
        folders = os.pathsep.join(str(folder) for folder in self.folders)
        config.set_main_option("path_separator", "os")
        config.set_main_option("script_location", str(FOLDER).replace("%", "%%"))
        config.set_main_option("version_locations", folders.replace("%", "%%"))
        config.attributes["connection"] = connection
        if made:
            command.stamp(config, made)
        command.upgrade(config, self.head)


def prepare(database: Database, create: bool, schema: Schema) -> None:
    """Make sure that there is a database of the current schema to write to; StoreError if there cannot be."""
    if not database.exists():
        if not create:
            raise _nothing(database)
        database.create(HISTORY[-1], schema.upgrade)
    database.check_writable()
    revision = _checked_revision(database, schema)
    if revision != schema.head and not database.upgrades_itself:
        raise StoreError(
            f"{database.name}: its schema {revision} is older than {schema.head}; 'fraexp migrate' brings it up "
            "to date for all who use it"
        )
    if revision != schema.head:
        database.migrate(schema.head, schema.upgrade)


def migrate(database: Database, schema: Schema) -> str:
    """Bring a database up to the current schema; return the revision that it had."""
    if not database.exists():
        raise _nothing(database)
    database.check_writable()
    revision = _checked_revision(database, schema)
    if revision != schema.head:
        database.migrate(schema.head, schema.upgrade)
    return revision


def check_readable(database: Database, schema: Schema) -> None:
    """Raise StoreError unless there is a database of the current schema."""
    if not database.exists():
        raise _nothing(database)
    revision = _checked_revision(database, schema)
    if revision != schema.head:
        remedy = f"'fraexp migrate --db {shlex.quote(database.name)}'"
        raise StoreError(
            f"{database.name}: its schema {revision} is older than {schema.head}; {remedy} brings it up to date"
        )


def _nothing(database: Database) -> StoreError:
    return StoreError(f"{database.name}: there is no database yet; 'fraexp run STUDY' makes one")


def _checked_revision(database: Database, schema: Schema) -> str:
    revision = database.revision()
    if revision is None:
        raise StoreError(f"{database.name}: the database is damaged (it has no schema); restore a copy of it")
    if revision not in schema.history:
        raise StoreError(
            f"{database.name}: its schema {revision} is newer than this fraexp ({schema.head}); update fraexp"
        )
    return revision
