"""The time of a database: for a server, its own clock, because the clocks of its clients may differ."""

import time
from datetime import UTC, datetime

from sqlalchemy import Connection, func, select

from fraexp.store.liveness import host_of


def now(connection: Connection) -> datetime:
    """Return the current time in UTC."""
    if connection.dialect.name == "sqlite":
        return host_of(connection).clock().astimezone(UTC)
    moment: datetime = connection.execute(select(func.clock_timestamp())).scalar_one()
    return moment.astimezone(UTC)


def steady_time() -> float:
    """Return the time of a clock that nobody can set [s]; it also runs while the computer sleeps."""
    return time.clock_gettime(time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else time.monotonic()
