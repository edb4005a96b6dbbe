"""Digests of a database computed anew, as if fraexp had written what a test or a benchmark has changed in it."""

from collections.abc import Iterable, Sequence

from sqlalchemy import Connection, bindparam, select, update

from fraexp.store.digests import (
    listed_digest,
    log_digest,
    origins_digest,
    parts_digest,
    read_origin_rows,
    read_result_rows,
    read_run_rows,
    result_digest,
    run_sweep_digest,
    seal_places,
    seal_run,
    seal_tags,
)
from fraexp.store.tables import PARTS, key_chunks, part, run, run_sweep, sweep


def seal_database(connection: Connection) -> None:
    """Compute all digests anew, and which sweeps runs have."""
    keys = list(connection.scalars(select(sweep.c.key)))
    seal_places(connection, keys)
    seal_sweeps(connection, keys)
    for number in list(connection.scalars(select(run.c.number))):
        _seal_run_sweeps(connection, number)
        seal_run(connection, number)


def seal_sweeps(connection: Connection, keys: Sequence[str]) -> None:
    """Compute the digests of sweeps and of their results anew."""
    for chunk in key_chunks(keys):
        tables = read_result_rows(connection, chunk)
        origins = read_origin_rows(connection, chunk)
        states = connection.execute(select(sweep).where(sweep.c.key.in_(chunk))).mappings().all()
        parts = _part_digests(connection, (row[f"{name}_part"] for row in states for name in PARTS))
        rows = []
        for row in states:
            key = row["key"]
            content = None if row["outcome"] is None else result_digest(row, tables[key])
            own = (parts.get(row[f"{name}_part"] or 0) for name in PARTS)
            digests = {"digest": listed_digest(row), "content": content, "parts": parts_digest(key, own)}
            rows.append({"of": key, **digests, "origins": origins_digest(key, origins[key])})
        if rows:
            connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), rows)
        seal_tags(connection, chunk)


def _part_digests(connection: Connection, numbers: Iterable[int | None]) -> dict[int, str]:
    """Return the digests of parts by their numbers."""
    wanted = [number for number in numbers if number is not None]
    return {
        row.number: row.digest
        for chunk in key_chunks(wanted)
        for row in connection.execute(select(part.c.number, part.c.digest).where(part.c.number.in_(chunk)))
    }


def _seal_run_sweeps(connection: Connection, number: int) -> None:
    chosen = update(run_sweep).where(run_sweep.c.run == number, run_sweep.c.position == bindparam("at"))
    for rows in read_run_rows(connection, number):
        sealed = [dict(row) | {"log_digest": log_digest(row["log"])} for row in rows]
        digests = [
            {"at": row["position"], "log_digest": row["log_digest"], "digest": run_sweep_digest(row)} for row in sealed
        ]
        connection.execute(chosen, digests)
