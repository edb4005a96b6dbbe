"""The trash: deleted runs and sweeps keep their rows, in tables that no query of results reads, until it is emptied.

Rows move as they are, with their digests. A sweep that was computed again meanwhile keeps its newer result.
"""

from collections.abc import Iterable, Sequence
from datetime import datetime

from sqlalchemy import Connection, Table, and_, delete, exists, insert, literal, select, update

from fraexp.errors import StoreError
from fraexp.store import shared_sections
from fraexp.store.changes.merge_source import RESULT_COLUMNS
from fraexp.store.digests import seal_places, seal_sound_runs, seal_tags
from fraexp.store.liveness import Process, host_of, now
from fraexp.store.stored_records import Deletion
from fraexp.store.tables import (
    SWEEP_TABLES,
    TRASH,
    Expression,
    is_one_of,
    key_chunks,
    run,
    run_sweep,
    scalars_of,
    sweep,
)


def read_trash(connection: Connection) -> list[Deletion]:
    """Return what was deleted together and can be brought back, the latest deletion first."""
    found: dict[datetime, tuple[list[int], list[str]]] = {}
    for place, table, name in ((0, TRASH[run], "number"), (1, TRASH[sweep], "key")):
        for moment, identifier in connection.execute(select(table.c.deleted_at, table.c[name]).order_by(table.c[name])):
            found.setdefault(moment, ([], []))[place].append(identifier)
    return [Deletion(tuple(runs), tuple(keys)) for _, (runs, keys) in sorted(found.items(), reverse=True)]


def move_to_trash(connection: Connection, keys: Iterable[str], numbers: Sequence[int]) -> int:
    """Move sweeps, and runs with the sweeps that no other run has, to the trash; return the number of these sweeps."""
    moment = now(connection)
    _refuse_living(connection, numbers, "")
    of_runs = list(connection.scalars(select(run_sweep.c.key).where(run_sweep.c.run.in_(numbers)).distinct()))
    _move(connection, run_sweep, TRASH[run_sweep], run_sweep.c.run.in_(numbers))
    _move(connection, run, TRASH[run], run.c.number.in_(numbers), moment)
    shared = scalars_of(connection, select(run_sweep.c.key).where(is_one_of(run_sweep.c.key)), of_runs)
    seal_places(connection, shared)
    orphans = (key for key in of_runs if key not in shared)
    return sum(_move_sweeps(connection, chunk, moment) for chunk in key_chunks((*orphans, *keys)))


def _move_sweeps(connection: Connection, keys: list[str], moment: datetime) -> int:
    numbers = connection.scalars(select(run_sweep.c.run).where(run_sweep.c.key.in_(keys)).distinct()).all()
    _refuse_living(connection, numbers, " and uses these sweeps")
    _move(connection, run_sweep, TRASH[run_sweep], run_sweep.c.key.in_(keys))
    seal_sound_runs(connection, numbers)
    existing = list(connection.scalars(select(sweep.c.key).where(sweep.c.key.in_(keys))))
    for table in SWEEP_TABLES:  # what was deleted of these sweeps before is replaced
        connection.execute(delete(TRASH[table]).where(TRASH[table].c.key.in_(existing)))
        _copy(connection, table, TRASH[table], table.c.key.in_(existing), moment)
    connection.execute(delete(sweep).where(sweep.c.key.in_(existing)))  # with its rows in the other tables
    return len(existing)


def take_from_trash(connection: Connection, keys: Iterable[str], numbers: Sequence[int]) -> Deletion:
    """Bring sweeps back, and runs with their sweeps, and return those that came back.

    A sweep that has a newer result stays in the trash; its places in runs come back. A sweep whose runs are all in the
    trash brings them back without their other sweeps: they have its study.
    """
    places = TRASH[run_sweep]
    of_runs = connection.scalars(select(places.c.key).where(places.c.run.in_(numbers))).all()
    numbers = list(connection.scalars(select(TRASH[run].c.number).where(TRASH[run].c.number.in_(numbers))))
    _move(connection, TRASH[run], run, TRASH[run].c.number.in_(numbers))
    keys = list(keys)
    numbers += _restore_runs_of(connection, keys)
    restored: list[str] = []
    for chunk in key_chunks((*of_runs, *keys)):
        restored += _restore_sweeps(connection, chunk)
        there = (places.c.key.in_(select(sweep.c.key)), places.c.run.in_(select(run.c.number)))
        chosen = and_(places.c.key.in_(chunk), *there)
        touched = connection.scalars(select(places.c.run).where(chosen).distinct()).all()
        _move(connection, places, run_sweep, chosen)
        seal_sound_runs(connection, {*touched, *numbers})
        seal_places(connection, chunk)
    return Deletion(tuple(numbers), tuple(sorted(restored)))


def _restore_runs_of(connection: Connection, keys: Sequence[str]) -> list[int]:
    """Bring back the runs of sweeps of which no run is left, and return their numbers."""
    places, other = TRASH[run_sweep], TRASH[run_sweep].alias()
    with_run = select(other.c.key).where(other.c.run.in_(select(run.c.number)))
    lone = (places.c.key.not_in(select(run_sweep.c.key)), places.c.key.not_in(with_run))
    found = scalars_of(connection, select(places.c.run).where(is_one_of(places.c.key), *lone).distinct(), keys)
    _move(connection, TRASH[run], run, TRASH[run].c.number.in_(found))
    return sorted(found)


def _restore_sweeps(connection: Connection, keys: list[str]) -> list[str]:
    """Bring back the data of the sweeps that have no result now, and return the keys of these."""
    trashed = TRASH[sweep]
    newer = select(sweep.c.key).where(sweep.c.outcome.is_not(None))
    wanted = select(trashed).where(trashed.c.key.in_(keys), trashed.c.key.not_in(newer))
    rows = {row["key"]: row for row in connection.execute(wanted).mappings()}
    waiting = list(connection.scalars(select(sweep.c.key).where(sweep.c.key.in_(rows))))
    for key in waiting:  # a run has them again, and has not computed them
        values = {name: rows[key][name] for name in RESULT_COLUMNS}
        connection.execute(update(sweep).where(sweep.c.key == key).values(**values))
    for table in SWEEP_TABLES:
        _move(connection, TRASH[table], table, TRASH[table].c.key.in_(rows))
    seal_tags(connection, waiting)
    return list(rows)


def empty_trash(connection: Connection) -> Deletion:
    """Delete what is in the trash for good, and return it."""
    gone = read_trash(connection)
    for table in TRASH.values():
        connection.execute(delete(table))
    shared_sections.delete_unused_parts(connection)
    return Deletion(tuple(number for of in gone for number in of.runs), tuple(key for of in gone for key in of.keys))


def _move(
    connection: Connection, source: Table, target: Table, condition: Expression, moment: datetime | None = None
) -> None:
    _copy(connection, source, target, condition, moment)
    connection.execute(delete(source).where(condition))


def _copy(connection: Connection, source: Table, target: Table, condition: Expression, moment: datetime | None) -> None:
    """Copy the rows that meet a condition, unless the other table has them; `moment` is when they were deleted."""
    names = [column.name for column in source.columns if column.name in target.columns]
    values: list[Expression] = [source.c[name] for name in names]
    if "deleted_at" in target.columns:
        names.append("deleted_at")
        values.append(literal(moment, target.c.deleted_at.type))
    same = and_(*(source.c[column.name] == column for column in target.primary_key.columns))
    rows = select(*values).where(condition, ~exists().where(same).correlate(source))
    connection.execute(insert(target).from_select(names, rows))


def _refuse_living(connection: Connection, numbers: Sequence[int], why: str) -> None:
    """Raise StoreError if one of the runs is alive."""
    running = select(run.c.number, run.c.host, run.c.boot, run.c.pid, run.c.process_start, run.c.heartbeat)
    rows = connection.execute(running.where(run.c.state == "running", run.c.number.in_(numbers))).all()
    moment, host = now(connection), host_of(connection)
    for number, *process, beat in rows:
        if host.is_alive(Process(*process), moment - beat):
            remedy = f"wait until it has ended, or stop it with 'fraexp stop {number}'"
            raise StoreError(f"run {number} is running{why}; {remedy}")
