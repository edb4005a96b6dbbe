"""Creation of a database, and migration of an older one to the current schema."""

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
    """The history of revisions and the folders with their scripts."""

    history: tuple[str, ...] = HISTORY
    folders: tuple[Path, ...] = (FOLDER / "versions",)

    @property
    def head(self) -> str:
        """The current revision."""
        return self.history[-1]

    def upgrade(self, connection: Connection, made: str | None = None) -> None:
        """Run the missing revisions; `made` is the revision of tables that were created without any."""
        from alembic import command  # its import is slow, and it is rarely needed
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


def prepare_database(database: Database, create: bool, schema: Schema) -> str:
    """Create a database of the current schema, or migrate it to that; StoreError if this is impossible.

    Return what a user should know about a migration; empty if there was none.
    """
    if not database.exists():
        if not create:
            raise _missing_database(database)
        database.create(HISTORY[-1], schema.upgrade)
    database.check_writable()
    revision = _checked_revision(database, schema)
    if revision != schema.head and not database.upgrades_itself:
        raise StoreError(
            f"{database.name}: its schema {revision} is older than {schema.head}; {_migrate_command(database)} brings "
            "it up to date for all who use it"
        )
    if revision == schema.head:
        return ""
    copy = database.migrate(schema.head, schema.upgrade)
    return f"{database.name}: migrated from schema {revision} to {schema.head}{f'; {copy}' if copy else ''}"


def migrate_database(database: Database, schema: Schema) -> tuple[str, str]:
    """Migrate a database to the current schema; return its former revision, and where a copy of it is."""
    if not database.exists():
        raise _missing_database(database)
    database.check_writable()
    revision = _checked_revision(database, schema)
    copy = database.migrate(schema.head, schema.upgrade) if revision != schema.head else ""
    return revision, copy


def check_readable(database: Database, schema: Schema) -> None:
    """Raise StoreError if there is no database of the current schema."""
    if not database.exists():
        raise _missing_database(database)
    revision = _checked_revision(database, schema)
    if revision != schema.head:
        remedy = f"{_migrate_command(database)} brings it up to date"
        raise StoreError(f"{database.name}: its schema {revision} is older than {schema.head}; {remedy}")


def _migrate_command(database: Database) -> str:
    return f"fraexp migrate --db {shlex.quote(database.location)}"


def _missing_database(database: Database) -> StoreError:
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
