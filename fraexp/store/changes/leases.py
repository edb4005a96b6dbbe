"""Leases: a lease reserves a sweep for a run that computes it.

A lease is valid as long as its run is alive: each heartbeat renews all leases of the run. A run that has ended, whose
process on this host has died, or that has sent no heartbeat for LEASE_DURATION has no valid lease.
"""

from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta

from sqlalchemy import Connection, bindparam, delete, func, select

from fraexp.store.liveness import Host, Process, host_of, now
from fraexp.store.tables import (
    Query,
    ResultRow,
    insert_or_ignore,
    is_one_of,
    key_chunks,
    lease,
    run,
    run_sweep,
    scalars_of,
    sweep,
)

LEASE_DURATION = timedelta(seconds=60)
"""Time without a heartbeat after which the leases of a run are invalid."""
OWNER_COLUMNS = (run.c.number, run.c.state, run.c.heartbeat, run.c.host, run.c.boot, run.c.pid, run.c.process_start)
START = select(run.c.started).where(run.c.number == bindparam("number"), run.c.state == "running")
OWNERS: Query = (
    select(sweep.c.key, sweep.c.outcome, sweep.c.created, *OWNER_COLUMNS)
    .select_from(sweep.outerjoin(lease, lease.c.key == sweep.c.key).outerjoin(run, run.c.number == lease.c.run))
    .where(is_one_of(sweep.c.key))
)
"""Sweeps with the runs that hold their leases, if there are any."""
HOLDERS = OWNERS.where(lease.c.run.is_not(None))
HELD = select(lease.c.key).where(lease.c.run == bindparam("number"), is_one_of(lease.c.key))
FINISHED = select(run_sweep.c.key).where(
    run_sweep.c.run == bindparam("number"), run_sweep.c.state == bindparam("state"), is_one_of(run_sweep.c.key)
)
RELEASE_ALL = delete(lease).where(lease.c.run == bindparam("number"))
RELEASE = RELEASE_ALL.where(is_one_of(lease.c.key))


def claim_sweeps(connection: Connection, number: int, keys: Iterable[str], again: bool = False) -> set[str]:
    """Lease sweeps to a run in one step, and return those that it must compute: no other living run holds them.

    Sweeps with a result are left out; with `again`, those with a result newer than the run. A heartbeat renews the
    leases; results, failures and the end of the run end them, and so does a dead process or a minute without heartbeat.
    """
    time_now = now(connection)
    started = connection.scalar(START, {"number": number})
    if started is None:  # the run has ended or does not exist: its leases would be invalid
        return set()
    alive: dict[int, bool] = {}
    host = host_of(connection)
    claimed: set[str] = set()
    for chunk in key_chunks(keys):
        free, abandoned = set(), []
        for row in connection.execute(OWNERS, {"keys": chunk}).all():
            fresh = row.outcome is not None and not (again and row.created < started)
            if fresh or (row.number not in (None, number) and _run_is_alive(row, time_now, alive, host)):
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


def find_holders(connection: Connection, keys: Iterable[str]) -> dict[str, int]:
    """Return the living run that holds each of the sweeps, for those that are held."""
    time_now = now(connection)
    alive: dict[int, bool] = {}
    host = host_of(connection)
    return {
        row.key: row.number
        for chunk in key_chunks(keys)
        for row in connection.execute(HOLDERS, {"keys": chunk})
        if _run_is_alive(row, time_now, alive, host)
    }


def held_sweeps(connection: Connection, number: int, keys: Iterable[str]) -> set[str]:
    """Return the sweeps whose lease a run holds: another run may have taken over those of a run that was silent."""
    return scalars_of(connection, HELD, keys, number=number)


def finished_sweeps(connection: Connection, number: int, keys: Iterable[str], state: str) -> set[str]:
    """Return the sweeps that a run has stored already, in a transaction whose success it may not have learnt of."""
    return scalars_of(connection, FINISHED, keys, number=number, state=state)


def count_leases(connection: Connection) -> dict[int, int]:
    """Return the number of leases of each run, dead or alive."""
    query = select(lease.c.run, func.count()).group_by(lease.c.run)
    return {row[0]: row[1] for row in connection.execute(query)}


def release_leases(connection: Connection, number: int, keys: Sequence[str] | None = None) -> None:
    """Delete the leases of a run: all, or those of some sweeps."""
    if keys is None:
        connection.execute(RELEASE_ALL, {"number": number})
        return
    for chunk in key_chunks(keys):
        connection.execute(RELEASE, {"number": number, "keys": chunk})


def _run_is_alive(row: ResultRow, time_now: datetime, alive: dict[int, bool], host: Host) -> bool:
    if row.number not in alive:
        silence = abs(time_now - row.heartbeat)  # a clock that was set back must not keep the leases of a dead run
        process = Process(row.host, row.boot, row.pid, row.process_start)
        alive[row.number] = row.state == "running" and silence < LEASE_DURATION and host.is_alive(process, silence)
    return alive[row.number]
