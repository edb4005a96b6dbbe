"""New databases without the migrations: seven of them in a row take a tenth of a second, in hundreds of tests."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import wraps

import pytest
from sqlalchemy import Connection

from fraexp.store.schema import Schema

OBJECTS_SQL = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL AND name NOT LIKE 'sqlite_%' ORDER BY rowid"
VERSION_SQL = "SELECT version_num FROM alembic_version"
MIGRATE = Schema.upgrade
"""What brings a database to the current schema in earnest."""


@contextmanager
def repeated_schema() -> Iterator[None]:
    """Run the migrations for the first new file of this process; others get the tables that are there afterwards."""
    statements: list[str] = []

    @wraps(MIGRATE)
    def upgrade(schema: Schema, connection: Connection, made: str | None = None) -> None:
        is_new = connection.dialect.name == "sqlite" and not connection.exec_driver_sql(OBJECTS_SQL).first()
        if not is_new or schema != Schema():
            MIGRATE(schema, connection, made)
        elif statements:
            for statement in statements:
                connection.exec_driver_sql(statement)
        else:
            MIGRATE(schema, connection, made)
            version = connection.exec_driver_sql(VERSION_SQL).scalar_one()
            statements.extend(connection.exec_driver_sql(OBJECTS_SQL).scalars())
            statements.append(f"INSERT INTO alembic_version VALUES ('{version}')")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Schema, "upgrade", upgrade)
        yield
