"""Digests of rows that are stored already, computed anew after changes of several rows."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

from sqlalchemy import Connection, RowMapping, Table, bindparam, case, func, select, update

from fraexp.store.digests import (
    ORIGIN_COLUMNS,
    RESULT_COLUMNS,
    annotations_digest,
    run_digest,
)
from fraexp.store.tables import (
    IN_RUNS,
    STANDING_LATEST,
    STANDING_OVERTAKEN,
    STANDING_REPEATED,
    WITHOUT_RUN,
    Expression,
    Query,
    RowValues,
    key_chunks,
    note,
    run,
    run_sweep,
    supplied_component,
    sweep,
    tag,
)

ROWS_AT_ONCE = 500
DIGEST_RANGE = 2**32
"""Number of values of a digest; a damaged one may be larger, and must not let the sum overflow."""


def seal_places(connection: Connection, keys: Iterable[str]) -> None:
    """Note whether a run has each of the sweeps, and which run of each is its latest one."""
    in_runs = case((sweep.c.key.in_(select(run_sweep.c.key)), IN_RUNS), else_=WITHOUT_RUN)
    of = run_sweep.alias()
    by_start = select(of.c.run).join(run, run.c.number == of.c.run).where(of.c.key == run_sweep.c.key)
    latest = by_start.order_by(run.c.started.desc(), run.c.number.desc()).limit(1).scalar_subquery()
    standing = case((run_sweep.c.run == latest, STANDING_LATEST), else_=STANDING_OVERTAKEN)
    for chunk in key_chunks(keys):
        connection.execute(update(sweep).where(sweep.c.key.in_(chunk)).values(in_runs=in_runs))
        chosen = (run_sweep.c.key.in_(chunk), run_sweep.c.standing != STANDING_REPEATED)
        connection.execute(update(run_sweep).where(*chosen).values(standing=standing))


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
