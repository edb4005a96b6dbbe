"""Digests of rows that are stored already: after changes of several rows, and for a database without digests."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

from sqlalchemy import Connection, RowMapping, Table, bindparam, case, func, select, update

from fraexp.store.digests import (
    ORIGIN_COLUMNS,
    RESULT_COLUMNS,
    STATE_COLUMNS,
    annotations_digest,
    content_digest,
    listed_digest,
    log_digest,
    origins_digest,
    parts_digest,
    run_digest,
    run_sweep_digest,
)
from fraexp.store.tables import (
    IN_RUNS,
    PARTS,
    WITHOUT_RUN,
    Expression,
    Query,
    RowValues,
    key_chunks,
    metadata,
    note,
    part,
    run,
    run_sweep,
    supplied_component,
    sweep,
    tag,
)

ROWS_AT_ONCE = 500
DIGEST_RANGE = 2**32
"""Number of values of a digest; a damaged one may be larger, and must not let the sum overflow."""


def seal_database(connection: Connection) -> None:
    """Compute all digests anew, and which sweeps runs have."""
    keys = list(connection.scalars(select(sweep.c.key)))
    seal_membership(connection, keys)
    seal_sweeps(connection, keys)
    for number in list(connection.scalars(select(run.c.number))):
        _seal_run_sweeps(connection, number)
        seal_run(connection, number)


def seal_membership(connection: Connection, keys: Iterable[str]) -> None:
    """Note whether a run has each of the sweeps."""
    in_runs = case((sweep.c.key.in_(select(run_sweep.c.key)), IN_RUNS), else_=WITHOUT_RUN)
    for chunk in key_chunks(keys):
        connection.execute(update(sweep).where(sweep.c.key.in_(chunk)).values(in_runs=in_runs))


def seal_sound_runs(connection: Connection, numbers: Iterable[int]) -> None:
    """Compute the digests of runs anew after sweeps were deleted or brought back, and count the deleted ones.

    A run that shows damage keeps its digest: the damage must not be hidden.
    """
    left = select(func.count()).where(run_sweep.c.run == run.c.number).scalar_subquery()
    for chunk in key_chunks(numbers):
        for row in connection.execute(select(run).where(run.c.number.in_(chunk))).mappings().all():
            if row["digest"] == run_digest(row):
                chosen = update(run).where(run.c.number == row["number"])
                connection.execute(chosen.values(deleted=run.c.deleted + run.c.sweeps - left))
                seal_run(connection, row["number"])


def seal_run(connection: Connection, number: int) -> None:
    """Compute the digest of a run anew, with the number of its sweeps and the sum of their digests."""
    query = select(func.count(), sum_of_digests()).where(run_sweep.c.run == number)
    count, total = connection.execute(query).one()
    row = dict(connection.execute(select(run).where(run.c.number == number)).mappings().one()) | {"sweeps": count}
    chosen = update(run).where(run.c.number == number)
    connection.execute(chosen.values(sweeps=count, sweep_digests=int(total), digest=run_digest(row)))


def sum_of_digests() -> Expression:
    """Return the expression of the sum of the digests of rows of runs: it shows rows that are lost or read twice."""
    return func.coalesce(func.sum(run_sweep.c.digest % DIGEST_RANGE), 0)


def seal_sweeps(connection: Connection, keys: Sequence[str]) -> None:
    """Compute the digests of sweeps and of their results anew."""
    for chunk in key_chunks(keys):
        tables = read_result_values(connection, chunk)
        origins = read_origin_rows(connection, chunk)
        states = connection.execute(select(sweep).where(sweep.c.key.in_(chunk))).mappings().all()
        parts = part_digests(connection, (row[f"{name}_part"] for row in states for name in PARTS))
        rows = []
        for row in states:
            key = row["key"]
            state = (row[name] for name in STATE_COLUMNS)
            content = None if row["outcome"] is None else content_digest(state, tables[key])
            own = (parts.get(row[f"{name}_part"] or 0) for name in PARTS)
            digests = {"digest": listed_digest(row), "content": content, "parts": parts_digest(key, own)}
            rows.append({"of": key, **digests, "origins": origins_digest(key, origins[key])})
        if rows:
            connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), rows)
        seal_annotations(connection, chunk)


def seal_annotations(connection: Connection, keys: Iterable[str]) -> None:
    """Compute the digests of the tags and notes of sweeps anew."""
    for chunk in key_chunks(keys):
        tags: dict[str, list[str]] = defaultdict(list)
        for row in connection.execute(select(tag).where(tag.c.key.in_(chunk))):
            tags[row.key].append(row.name)
        notes = {row.key: row.text for row in connection.execute(select(note).where(note.c.key.in_(chunk)))}
        rows = [
            {"of": key, "annotations": annotations_digest(key, tags.get(key, ()), notes.get(key, ""))} for key in chunk
        ]
        connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), rows)


def read_result_values(connection: Connection, keys: list[str]) -> dict[str, dict[str, list[Sequence[object]]]]:
    """Return the values that the digests of results cover, by key and table."""
    found: dict[str, dict[str, list[Sequence[object]]]] = defaultdict(lambda: defaultdict(list))
    for name in RESULT_COLUMNS:
        for row in connection.execute(covered_rows(metadata.tables[name], keys)):
            found[row[0]][name].append(row[1:])
    return found


def covered_rows(table: Table, keys: list[str]) -> Query:
    """Return the query of the rows of a result's table: the key, then the covered columns, in their order."""
    order = [table.c[name] for name in ("curve", "position") if name in table.c]
    columns = (table.c[name] for name in RESULT_COLUMNS[table.name])
    return select(table.c.key, *columns).where(table.c.key.in_(keys)).order_by(*order)


def read_origin_rows(connection: Connection, keys: list[str]) -> dict[str, list[RowValues]]:
    """Return the origins of the components of sweeps, by key."""
    found: dict[str, list[RowValues]] = defaultdict(list)
    columns = (supplied_component.c[name] for name in ("key", *ORIGIN_COLUMNS))
    for row in connection.execute(select(*columns).where(supplied_component.c.key.in_(keys))).mappings():
        found[row["key"]].append(dict(row))
    return found


def part_digests(connection: Connection, numbers: Iterable[int | None]) -> dict[int, str]:
    """Return the digests of parts by their numbers."""
    wanted = [number for number in numbers if number is not None]
    return {
        row.number: row.digest
        for chunk in key_chunks(wanted)
        for row in connection.execute(select(part.c.number, part.c.digest).where(part.c.number.in_(chunk)))
    }


def read_run_rows(connection: Connection, number: int) -> Iterator[Sequence[RowMapping]]:
    """Yield the rows of a run in lists, by position."""
    position = -1
    query = select(run_sweep).where(run_sweep.c.run == number).order_by(run_sweep.c.position).limit(ROWS_AT_ONCE)
    while rows := connection.execute(query.where(run_sweep.c.position > position)).mappings().all():
        yield rows
        last = max(row["position"] for row in rows)
        if last <= position:  # a damaged index is not in order: it would lead in a circle
            return
        position = last


def _seal_run_sweeps(connection: Connection, number: int) -> None:
    chosen = update(run_sweep).where(run_sweep.c.run == number, run_sweep.c.position == bindparam("at"))
    for rows in read_run_rows(connection, number):
        sealed = [dict(row) | {"log_digest": log_digest(row["log"])} for row in rows]
        digests = [
            {"at": row["position"], "log_digest": row["log_digest"], "digest": run_sweep_digest(row)} for row in sealed
        ]
        connection.execute(chosen, digests)
