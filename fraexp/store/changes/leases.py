"""Who computes what: a lease is a sweep that a living run has taken upon itself.

A lease lasts as long as its run gives signs of life: each heartbeat renews all leases of the run. A run that is over,
whose process on this host has died, or that has been silent for LEASE holds nothing any more.
"""

from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Connection, delete, func, select

from fraexp.store.clock import now
from fraexp.store.liveness import Process, alive
from fraexp.store.tables import chunks, insert_or_ignore, lease, run, sweep

LEASE = timedelta(seconds=60)
"""How long a run without a heartbeat keeps what it holds."""
OWNER = (run.c.number, run.c.state, run.c.heartbeat, run.c.host, run.c.boot, run.c.pid, run.c.process_start)


def claim(connection: Connection, number: int, keys: Iterable[str], again: bool) -> set[str]:
    """Take upon a run what has no result (`again`: none since it began) and no other living run holds."""
    moment = now(connection)
    started = connection.scalar(select(run.c.started).where(run.c.number == number, run.c.state == "running"))
    if started is None:  # it has ended, or there is no such run: what it claimed would be held by nobody
        return set()
    lives: dict[int, bool] = {}
    claimed: set[str] = set()
    for chunk in chunks(keys):
        free, abandoned = set(), []
        for row in connection.execute(_asked(chunk)).all():
            fresh = row.outcome is not None and not (again and row.created < started)
            if fresh or (row.number not in (None, number) and _lives(row, moment, lives)):
                continue
            free.add(row.key)
            if row.number not in (None, number):
                abandoned.append(row.key)
        if abandoned:
            connection.execute(delete(lease).where(lease.c.key.in_(abandoned)))
        rows = [{"key": key, "run": number} for key in chunk if key in free]
        if rows:
            connection.execute(insert_or_ignore(connection, lease), rows)
        claimed |= free
    return claimed


def held(connection: Connection, keys: Iterable[str]) -> dict[str, int]:
    """Return which living run holds each of those sweeps that one holds."""
    moment = now(connection)
    lives: dict[int, bool] = {}
    return {
        row.key: row.number
        for chunk in chunks(keys)
        for row in connection.execute(_asked(chunk).where(lease.c.run.is_not(None)))
        if _lives(row, moment, lives)
    }


def counts(connection: Connection) -> dict[int, int]:
    """Return how many leases each run has, dead or alive."""
    query = select(lease.c.run, func.count()).group_by(lease.c.run)
    return {row[0]: row[1] for row in connection.execute(query)}


def release(connection: Connection, number: int, keys: Sequence[str] | None = None) -> None:
    """Give up what a run holds: all of it, or some sweeps."""
    of_run = delete(lease).where(lease.c.run == number)
    for chunk in [None] if keys is None else chunks(keys):
        connection.execute(of_run if chunk is None else of_run.where(lease.c.key.in_(chunk)))


def _asked(keys: list[str]) -> Any:
    held_by = sweep.outerjoin(lease, lease.c.key == sweep.c.key).outerjoin(run, run.c.number == lease.c.run)
    return (
        select(sweep.c.key, sweep.c.outcome, sweep.c.created, *OWNER).select_from(held_by).where(sweep.c.key.in_(keys))
    )


def _lives(row: Any, moment: datetime, lives: dict[int, bool]) -> bool:
    if row.number not in lives:
        silence = moment - row.heartbeat
        process = Process(row.host, row.boot, row.pid, row.process_start)
        lives[row.number] = row.state == "running" and silence < LEASE and alive(process, silence)
    return lives[row.number]
