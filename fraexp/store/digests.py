"""Digests of stored rows: each is stored beside what it covers, and compared whenever that is read.

A digest is a CRC-32, which notices up to three changed bits in any row for certain and more of them with a probability
of 1 - 2⁻³². It protects from disks and memory, not from people. The columns that a digest covers are named here.

Not covered are a run's heartbeat and progress, which are only shown while it runs, the leases, and the names that a
filter suggests. States are words of which none becomes another one by a few bits.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from operator import itemgetter
from typing import Any
from zlib import crc32

from sqlalchemy import Connection, RowMapping, Table, bindparam, case, func, select, update

from fraexp.store.tables import (
    IN_RUNS,
    RESULT_TABLES,
    STANDING_LATEST,
    STANDING_OVERTAKEN,
    STANDING_REPEATED,
    WITHOUT_RUN,
    Expression,
    RowValues,
    TableRow,
    curve,
    curve_column,
    fit,
    frequency_response,
    key_chunks,
    metric,
    run,
    run_sweep,
    supplied_component,
    sweep,
    tag,
)

RESULT_COLUMNS = {
    table.name: tuple(column.name for column in table.columns if column.name != "key")
    for table in (frequency_response, metric, curve, curve_column, fit)
}
"""Columns of a result's tables that its digest covers, beside the key: all."""
STATE_COLUMNS = ("key", "outcome", "findings", "numerics", "elapsed")
"""Columns of a sweep that the digest of its result covers."""
LISTED_COLUMNS = (
    *("key", "outcome", "findings", "elapsed", "created", "source"),
    *("plant_name", "friction_name", "controller_name", "excitation_name", "estimator_name"),
)
"""Columns of a sweep that listings show, which have a digest of their own: listings do not read results."""
RUN_COLUMNS = (
    *("number", "study", "study_file", "command", "started", "ended", "host", "boot", "pid", "process_start"),
    *("provenance", "sweeps", "deleted"),
)
RUN_SWEEP_COLUMNS = ("run", "position", "key", "labels", "message", "log_digest")
ORIGIN_COLUMNS = ("kind", "name", "version", "source_hash", "distribution")
SEPARATOR = "\x1f"
_compact = json.JSONEncoder(separators=(",", ":")).encode
_listed_values = itemgetter(*LISTED_COLUMNS)
_run_values = itemgetter(*RUN_COLUMNS)
_run_sweep_values = itemgetter(*RUN_SWEEP_COLUMNS)
_origin_values = itemgetter(*ORIGIN_COLUMNS)
_result_values = {table: itemgetter(*columns) for table, columns in RESULT_COLUMNS.items()}


def _number_text(value: float) -> str:
    return repr(value + 0.0)  # a database may store -0 as 0


TEXTS: Mapping[type, Callable[[Any], str]] = {
    str: str,
    float: _number_text,
    datetime: lambda moment: moment.astimezone(UTC).isoformat(),
    dict: _compact,
    list: _compact,
}


def digest(values: Iterable[Any]) -> int:
    """Return the digest of values as a database returns them: texts, numbers, moments, plain data, bytes and None."""
    texts, blobs = [], []
    for value in values:
        if value.__class__ is bytes:
            blobs.append(value)
        else:
            texts.append(TEXTS.get(value.__class__, str)(value))
    # As free text is stored: with escapes for what no database accepts.
    text = SEPARATOR.join(texts).encode("utf-8", "backslashreplace").replace(b"\0", b"\\x00")
    return crc32(b"".join(blobs), crc32(text))


def listed_digest(row: TableRow) -> int:
    """Return the digest of what listings show of a sweep."""
    return digest(_listed_values(row))


def result_digest(state: TableRow, tables: Mapping[str, Sequence[TableRow]]) -> int:
    """Return the digest of a result by its sweep's row and the rows of its tables, in the order of their positions."""
    values = [state[name] for name in STATE_COLUMNS]
    for name, of_row in _result_values.items():
        for row in tables.get(name, ()):
            values += of_row(row)
    return digest(values)


def origins_digest(key: str, rows: Iterable[TableRow]) -> int:
    """Return the digest of the origins of a sweep's components, in whatever order."""
    found = sorted((_origin_values(row) for row in rows), key=itemgetter(0, 1))
    return digest([key, *(value for row in found for value in row)])


def parts_digest(key: str, digests: Iterable[str | None]) -> int:
    """Return the digest of a sweep's parts by their own digests in the order of PARTS, None for a part without."""
    return digest([key, *digests])


def tags_digest(key: str, tags: Iterable[str]) -> int | None:
    """Return the digest of a sweep's tags; None without any."""
    tags = sorted(tags)
    return digest([key, *tags]) if tags else None


def run_digest(row: TableRow) -> int:
    """Return the digest of a run."""
    return digest(_run_values(row))


def run_sweep_digest(row: TableRow) -> int:
    """Return the digest of a sweep's part in a run."""
    return digest(_run_sweep_values(row))


def log_digest(text: str) -> int:
    """Return the digest of a log; 0 for none."""
    return digest([text]) if text else 0


def new_run_sweep(row: RowValues) -> RowValues:
    """Return the row of a sweep in a run with its digests."""
    row = {"message": "", "log": "", **row}
    row["log_digest"] = log_digest(row["log"])
    return row | {"digest": run_sweep_digest(row)}


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


def seal_tags(connection: Connection, keys: Iterable[str]) -> None:
    """Compute the digests of the tags of sweeps anew."""
    for chunk in key_chunks(keys):
        tags = read_tags(connection, chunk)
        rows = [{"of": key, "tags": tags_digest(key, tags.get(key, ()))} for key in chunk]
        connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), rows)


def read_tags(connection: Connection, keys: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the tags of each sweep that has any, in alphabetical order."""
    tags: dict[str, tuple[str, ...]] = defaultdict(tuple)
    for chunk in key_chunks(keys):
        tagged = select(tag.c.key, tag.c.name).where(tag.c.key.in_(chunk)).order_by(tag.c.name)
        for key, name in connection.execute(tagged):
            tags[key] += (name,)
    return dict(tags)


def read_result_rows(
    connection: Connection, keys: Sequence[str], tables: Iterable[Table] = RESULT_TABLES
) -> dict[str, dict[str, list[RowValues]]]:
    """Return the rows of results by key of the sweep and name of the table, in the order of their positions."""
    found: dict[str, dict[str, list[RowValues]]] = defaultdict(lambda: defaultdict(list))
    for table in tables:
        query = select(table).where(table.c.key.in_(list(keys))).order_by(*table.primary_key.columns)
        for row in connection.execute(query).mappings():
            found[row["key"]][table.name].append(dict(row))
    return found


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
