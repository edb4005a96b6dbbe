"""The sweeps of a database that is merged into another one: what is damaged is found, and the rest is read."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from sqlalchemy import Connection, RowMapping, func, select
from sqlalchemy.exc import StatementError

from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import codec, shared_sections
from fraexp.store.damage import is_damage, read_tolerantly
from fraexp.store.digests import listed_digest, origins_digest, read_result_rows, read_tags, result_digest, tags_digest
from fraexp.store.tables import Query, RowValues, curve_column, frequency_response, run_sweep, sweep
from fraexp.store.validation import FOREIGN_DATA_ERRORS

MAX_ARRAY_BYTES = 2**25
"""Maximum size of the arrays in memory, except for a single sweep with more."""
BYTES_PER_FREQUENCY = 400
"""Approximate size of the arrays of a response."""
RESULT_COLUMNS = ("outcome", "findings", "elapsed", "numerics", "created", "digest", "content", "origins")
"""Columns of a sweep that a result has set."""
Transaction = Callable[[], AbstractContextManager[Connection]]
Rows = dict[str, list[RowValues]]
"""Rows of a sweep by the name of their table."""


@dataclass(frozen=True)
class SourceSweep:
    """A sweep with all its data."""

    item: Sweep
    result_columns: RowValues
    """Columns of the result; empty without one."""
    rows: Rows
    tags: tuple[str, ...]
    damage: tuple[str, ...] = ()
    """What is damaged and left out, in words; the rest is sound."""

    @property
    def is_lost(self) -> bool:
        """Whether nothing of it can be used."""
        return "sweep" in self.damage

    def result(self) -> Result:
        """Return the result of a sweep that has one."""
        return codec.parse_result(self.result_columns, self.rows)


def find_keys(source: Transaction) -> list[str]:
    """Return the keys of all sweeps, also of those that an index or a table has lost, in their order."""
    by_key = select(sweep.c.key).order_by(sweep.c.key)
    unused_index = select(sweep.c.key, sweep.c.findings)
    in_runs = select(run_sweep.c.key, run_sweep.c.message)
    found: set[str] = set()
    with source() as connection:
        for query in (by_key, select(sweep.c.key).order_by(sweep.c.key.desc()), unused_index, in_runs):
            found.update(key for key in _scan(connection, query) if isinstance(key, str))
    return sorted(found)


def _scan(connection: Connection, query: Query) -> Iterator[object]:
    """Yield the first column of rows, as far as they can be read."""
    try:
        for row in connection.execution_options(yield_per=100).execute(query):
            yield row[0]
    except (StatementError, *FOREIGN_DATA_ERRORS) as error:
        if not is_damage(error):
            raise


def read_batches(source: Transaction, keys: Sequence[str], size: int) -> Iterator[dict[str, SourceSweep | None]]:
    """Yield the sweeps in batches whose arrays fit into memory; None for one that cannot be read."""
    for start in range(0, len(keys), size):
        chunk = list(keys[start : start + size])
        for some in _fitting_lists(source, chunk):
            with source() as connection:
                found = read_tolerantly(lambda asked: _read_sweeps(connection, asked), some)
            yield {key: found.get(key) for key in some}


def _fitting_lists(source: Transaction, keys: list[str]) -> list[list[str]]:
    sizes: dict[str, int] = defaultdict(int)
    of_columns = select(curve_column.c.key, func.sum(func.length(curve_column.c.samples)).label("bytes"))
    of_points = select(frequency_response.c.key, (frequency_response.c.points * BYTES_PER_FREQUENCY).label("bytes"))
    with source() as connection:
        for query in (
            of_columns.where(curve_column.c.key.in_(keys)).group_by(curve_column.c.key),
            of_points.where(frequency_response.c.key.in_(keys)),
        ):
            try:
                for row in connection.execute(query):
                    sizes[row.key] += int(row.bytes or 0)
            except (StatementError, *FOREIGN_DATA_ERRORS) as error:
                if not is_damage(error):
                    raise
                return [[key] for key in keys]
    lists: list[list[str]] = []
    room = 0
    for key in keys:
        if not lists or sizes[key] > room:
            lists.append([])
            room = MAX_ARRAY_BYTES
        lists[-1].append(key)
        room -= sizes[key]
    return lists


def _read_sweeps(connection: Connection, keys: list[str]) -> dict[str, SourceSweep]:
    found = connection.execute(select(sweep).where(sweep.c.key.in_(keys))).mappings().all()
    resolved = shared_sections.load_parts(connection, found)
    rows, tags = read_result_rows(connection, keys), read_tags(connection, keys)
    return {
        key: _source_sweep(row, resolved[key], rows[key], tags.get(key, ()))
        for row in found
        if (key := row["key"]) in resolved
    }


def _source_sweep(
    row: RowMapping, sections: tuple[RowValues, RowValues], rows: Rows, tags: tuple[str, ...]
) -> SourceSweep:
    damage = list(_find_damage(row, rows))
    if tags_digest(row["key"], tags) != row["tags"]:
        damage.append("tags")
        tags = ()
    has_result = row["outcome"] is not None and {"sweep", "result"}.isdisjoint(damage)
    outcome = Outcome[row["outcome"]].name if row["outcome"] else None  # of an unknown one nothing is read
    columns = {name: row[name] for name in RESULT_COLUMNS} | {"outcome": outcome}
    return SourceSweep(Sweep(*sections, {}), columns if has_result else {}, rows, tags, tuple(damage))


def _find_damage(row: RowMapping, rows: Rows) -> Iterator[str]:
    if listed_digest(row) != row["digest"] or origins_digest(row["key"], rows["supplied_component"]) != row["origins"]:
        yield "sweep"
    if row["outcome"] is None:
        if row["content"] is not None or any(rows.values()):
            yield "result"
    elif result_digest(row, rows) != row["content"]:
        yield "result"
