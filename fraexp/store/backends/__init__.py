"""The databases that the store can be, by their URLs: SQLite files and PostgreSQL servers."""

import re
from pathlib import Path

from fraexp.errors import StoreError
from fraexp.store.backends.engine import Database, masked_url
from fraexp.store.backends.sqlite import SqliteFile


def locate_database(url: str, timeout: float) -> Database:
    """Return the database at ``postgresql://...``, ``sqlite:///file`` or a plain path; StoreError for other URLs."""
    scheme, separator, rest = url.strip().partition("://")
    if separator and scheme in ("postgresql", "postgres", "postgresql+psycopg"):
        from fraexp.store.backends import postgresql

        return postgresql.PostgresqlServer(
            postgresql.parse_url(url.strip().replace("postgres://", "postgresql://", 1)), timeout
        )
    if separator and scheme != "sqlite":
        raise StoreError(
            f"{masked_url(url)}: {scheme} databases are not supported; give a file such as sqlite:///results.db, or a "
            "server such as postgresql://user@host/database"
        )
    if not separator and re.match(r"\s*postgres[\w+]*[:/].*@", url):
        raise StoreError(f"{masked_url(url)}: this is not a URL; expected postgresql://user@host:5432/database")
    name = rest.removeprefix("/") if separator else url
    if not name or name == ":memory:" or "\0" in name:
        raise StoreError(f"{url!r} names no file; give one such as sqlite:///results.db")
    return SqliteFile(Path(name), timeout)
