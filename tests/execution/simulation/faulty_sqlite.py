"""SQLite files whose driver reports each statement before and after it, so that it can fail."""

import sqlite3
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from fraexp.store.backends.sqlite import SqliteFile

Moment = Literal["before", "after", "wait"]


def unavailable() -> sqlite3.OperationalError:
    """Return the error of a database that another process has locked."""
    error = sqlite3.OperationalError("simulated: not available")
    error.sqlite_errorcode = sqlite3.SQLITE_BUSY
    return error


def ignore(moment: Moment, text: str) -> None:
    """Let a statement succeed."""


@dataclass(frozen=True)
class FaultyFile(SqliteFile):
    """A SQLite file with a function that is called before and after each statement."""

    hook: list[Callable[[Moment, str], None]] = field(default_factory=lambda: [ignore])
    connections: "list[_Connection]" = field(default_factory=list)

    def connect(self, query: str) -> sqlite3.Connection:
        uri = f"{self.path.as_uri()}?{query}"
        options: dict[str, Any] = {"isolation_level": None, "check_same_thread": False, "timeout": self.timeout}
        connection = sqlite3.connect(uri, uri=True, factory=_Connection, **options)
        connection.hook, connection.cursors = self.hook, []
        self.connections.append(connection)
        return connection

    def close_all(self) -> None:
        """Close all connections, as the system does when a process dies."""
        while self.connections:
            self.connections.pop().close()


class _Cursor(sqlite3.Cursor):
    def execute(self, text: str, *values: Any) -> "_Cursor":
        hook = self.connection.hook  # type: ignore[attr-defined]
        hook[0]("before", text)
        super().execute(text, *values)
        hook[0]("after", text)
        return self

    def executemany(self, text: str, *values: Any) -> "_Cursor":
        hook = self.connection.hook  # type: ignore[attr-defined]
        hook[0]("before", text)
        super().executemany(text, *values)
        hook[0]("after", text)
        return self


class _Connection(sqlite3.Connection):
    hook: list[Callable[[Moment, str], None]]
    cursors: list[sqlite3.Cursor]

    def cursor(self, *_: Any) -> sqlite3.Cursor:
        cursor = super().cursor(_Cursor)
        self.cursors.append(cursor)
        return cursor

    def close(self) -> None:
        while self.cursors:  # with an open cursor the connection would keep its locks
            self.cursors.pop().close()
        super().close()

    def commit(self) -> None:
        self.hook[0]("before", "COMMIT")
        super().commit()
        self.hook[0]("after", "COMMIT")
