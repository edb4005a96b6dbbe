"""From the URL of a database to the database."""

from pathlib import Path

from fraexp.errors import StoreError
from fraexp.store.backends.engine import Database, shown
from fraexp.store.backends.sqlite import SqliteFile


def locate(url: str, timeout: float) -> Database:
    """Return the database behind ``postgresql://...``, ``sqlite:///file`` or a plain path; StoreError for others."""
    scheme, separator, rest = url.partition("://")
    if separator and scheme in ("postgresql", "postgres", "postgresql+psycopg"):
        from fraexp.store.backends import postgresql

        return postgresql.PostgresqlServer(postgresql.parse(url.replace("postgres://", "postgresql://", 1)), timeout)
    if separator and scheme != "sqlite":
        raise StoreError(
            f"{shown(url)}: {scheme} databases are not supported; give a file such as sqlite:///results.db, or a "
            "server such as postgresql://user@host/database"
        )
    name = rest.removeprefix("/") if separator else url
    if not name or name == ":memory:" or "\0" in name:
        raise StoreError(f"{url!r} names no file; give one such as sqlite:///results.db")
    return SqliteFile(Path(name), timeout)
