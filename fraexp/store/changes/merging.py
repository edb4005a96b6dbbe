"""Joining two databases: what one has and the other lacks is added; what both have and differs is told, and stays."""

from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, bindparam, delete, func, insert, select, update

from fraexp.data.results import Outcome, Result
from fraexp.data.sweep import Sweep
from fraexp.store import codec, shared_sections
from fraexp.store.changes import writing
from fraexp.store.diff import differences
from fraexp.store.queries import annotations, reading
from fraexp.store.stored_records import Conflict, Merged
from fraexp.store.tables import (
    LATEST,
    OVERTAKEN,
    PARTS,
    REPEATED,
    RESULT_TABLES,
    curve_column,
    frequency_response,
    insert_or_ignore,
    note,
    run,
    run_sweep,
    sweep,
    tag,
)

AT_ONCE = 500
"""Sweeps, or rows of a run, that are looked at together."""
MOST = 2**25
"""Bytes of arrays that are held at once, apart from a single sweep with more."""
POINT = 400
"""Bytes that a frequency takes, about."""
IDENTITY = ("host", "boot", "pid", "process_start", "started")
"""What tells a run from every other, whichever number it has."""
LEARNT = ("outcome", "message", "elapsed", "numerics", "created")
Opened = Callable[[], AbstractContextManager[Connection]]


@dataclass
class _Tally:
    """What has been found so far."""

    sweeps: int = 0
    results: int = 0
    same: int = 0
    runs: int = 0
    known_runs: int = 0
    conflicts: list[Conflict] = field(default_factory=list)

    def told(self) -> Merged:
        """Return it as it is told."""
        return Merged(self.sweeps, self.results, self.same, self.runs, self.known_runs, tuple(self.conflicts))


def merge(source: Opened, ours: Opened, target: Opened) -> Generator[tuple[int, int], None, Merged]:
    """Add to `target` what `source` has: each batch in a transaction; yield how many of how many sweeps are done.

    `ours` opens the same database as `target`, for reading. Doing it again adds nothing, so that an interrupted merge
    is completed by another one.
    """
    tally = _Tally()
    with source() as connection:
        total = connection.scalar(select(func.count()).select_from(sweep)) or 0
        numbers = list(connection.scalars(select(run.c.number).order_by(run.c.number)))
    done, begin = 0, ""
    while batch := _following(source, begin):
        for keys in batch:
            with source() as connection:
                bundle = _Bundle.of(connection, keys)
            with target() as connection:
                both = _add(connection, bundle, tally)
            with source():  # which names its database where something in it cannot be read
                theirs = {key: bundle.result(key) for key in both}
            with ours() as connection:
                _compare(reading.results(connection, both), theirs, tally)
            begin, done = keys[-1], done + len(keys)
            yield done, total
    for number in numbers:
        with source() as reader, target() as writer:
            _add_run(reader, writer, number, tally)
        yield done, total
    return tally.told()


def _following(source: Opened, begin: str) -> list[list[str]]:
    """Return the next keys, in lists whose arrays fit into memory."""
    with source() as connection:
        keys = list(
            connection.scalars(select(sweep.c.key).where(sweep.c.key > begin).order_by(sweep.c.key).limit(AT_ONCE))
        )
        sizes: dict[str, int] = defaultdict(int)
        of_columns = select(curve_column.c.key, func.sum(func.length(curve_column.c.samples)).label("bytes"))
        of_points = select(frequency_response.c.key, (frequency_response.c.points * POINT).label("bytes"))
        for query in (
            of_columns.where(curve_column.c.key.in_(keys)).group_by(curve_column.c.key),
            of_points.where(frequency_response.c.key.in_(keys)),
        ):
            for row in connection.execute(query):
                sizes[row.key] += int(row.bytes or 0)
    lists: list[list[str]] = []
    room = 0
    for key in keys:
        if not lists or sizes[key] > room:
            lists.append([])
            room = MOST
        lists[-1].append(key)
        room -= sizes[key]
    return lists


@dataclass(frozen=True)
class _Bundle:
    """Sweeps with everything that belongs to them, by key."""

    grid: dict[str, Sweep]
    learnt: dict[str, dict[str, Any]]
    """Columns of the results that there are."""
    rows: dict[str, dict[str, list[dict[str, Any]]]]
    """Rows of their tables, by key and table."""
    tags: dict[str, tuple[str, ...]]
    notes: dict[str, str]

    @classmethod
    def of(cls, connection: Connection, keys: Sequence[str]) -> "_Bundle":
        """Read them."""
        columns = [sweep.c[name] for name in ("key", *LEARNT, *(f"{part}_part" for part in PARTS))]
        found = connection.execute(select(*columns).where(sweep.c.key.in_(keys))).mappings().all()
        resolved = shared_sections.load(connection, found)
        return cls(
            {key: Sweep(*resolved[key], {}) for key in keys},
            {row["key"]: _learnt(row) for row in found if row["outcome"] is not None},
            _rows(connection, keys),
            annotations.tags_of(connection, keys),
            annotations.notes(connection, keys),
        )

    def result(self, key: str) -> Result:
        """Return the result of a sweep that has one."""
        rows, learnt = self.rows[key], self.learnt[key]
        columns = rows["curve_column"]
        return Result(
            Outcome[learnt["outcome"]],
            learnt["message"],
            next((codec.response_of(row) for row in rows["frequency_response"]), None),
            tuple(codec.metric_of(row) for row in rows["metric"]),
            tuple(
                codec.curve_of(row["name"], [column for column in columns if column["curve"] == row["position"]])
                for row in rows["curve"]
            ),
            tuple(codec.fit_of(row) for row in rows["fit"]),
        )


def _learnt(row: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the columns of a result; KeyError if its outcome is none."""
    return {name: row[name] for name in LEARNT} | {"outcome": Outcome[row["outcome"]].name}


def _rows(connection: Connection, keys: Iterable[str]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    found: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for table in RESULT_TABLES:
        query = select(table).where(table.c.key.in_(list(keys))).order_by(*table.primary_key.columns)
        for row in connection.execute(query).mappings():
            found[row["key"]][table.name].append(dict(row))
    return found


def _add(connection: Connection, bundle: _Bundle, tally: _Tally) -> list[str]:
    """Add what is lacking, and return the keys of those sweeps of which both have a result."""
    wrong = [key for key, item in bundle.grid.items() if item.key != key]
    tally.conflicts += [
        Conflict(key, ("key",), "its key is not that of its parameters; it is left out") for key in wrong
    ]
    keys = [key for key in bundle.grid if key not in wrong]
    query = select(sweep.c.key, sweep.c.outcome).where(sweep.c.key.in_(keys))
    there = {row.key: row.outcome for row in connection.execute(query)}
    writing.ensure(connection, [bundle.grid[key] for key in keys])
    tally.sweeps += len(keys) - len(there)
    fresh = [key for key in keys if key in bundle.learnt and there.get(key) is None]
    _write_results(connection, bundle, fresh)
    tally.results += len(fresh)
    _write_marks(connection, bundle, keys)
    return [key for key in keys if key in bundle.learnt and there.get(key) is not None]


def _compare(ours: Mapping[str, Result], theirs: Mapping[str, Result], tally: _Tally) -> None:
    for key in (key for key in theirs if key in ours):
        what, how = differences(ours[key], theirs[key])
        if what:
            tally.conflicts.append(Conflict(key, what, how))
        tally.same += not what


def _write_results(connection: Connection, bundle: _Bundle, keys: Sequence[str]) -> None:
    if not keys:
        return
    learnt = [{"of": key, **bundle.learnt[key]} for key in keys]
    connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), learnt)
    for table in reversed(RESULT_TABLES):  # parents first
        rows = [row for key in keys for row in bundle.rows[key][table.name]]
        if rows:
            connection.execute(insert(table), rows)
    shared_sections.learn(connection, "metric", {row["name"] for key in keys for row in bundle.rows[key]["metric"]})


def _write_marks(connection: Connection, bundle: _Bundle, keys: Sequence[str]) -> None:
    tags = [{"key": key, "name": name} for key in keys for name in bundle.tags.get(key, ())]
    notes = [{"key": key, "text": bundle.notes[key]} for key in keys if key in bundle.notes]
    for table, rows in ((tag, tags), (note, notes)):
        if rows:
            connection.execute(insert_or_ignore(connection, table), rows)


def _add_run(reader: Connection, writer: Connection, number: int, tally: _Tally) -> None:
    """Add a run under a new number, or what became of it since it was added."""
    row = dict(reader.execute(select(run).where(run.c.number == number)).mappings().one())
    same = (run.c[name].is_(None) if row[name] is None else run.c[name] == row[name] for name in IDENTITY)
    known = writer.execute(select(run.c.number, run.c.state).where(*same)).first()
    del row["number"]
    if known is None:
        given = int(writer.execute(insert(run).values(**row).returning(run.c.number)).scalar_one())
        tally.runs += 1
    else:
        tally.known_runs += 1
        given = known.number
        if known.state != "running":
            return
        writer.execute(update(run).where(run.c.number == given).values(**row))
        writer.execute(delete(run_sweep).where(run_sweep.c.run == given))
    for rows in _of_run(reader, number):
        _add_rows(writer, given, row["started"], rows)


def _of_run(reader: Connection, number: int) -> Iterator[list[dict[str, Any]]]:
    position = -1
    query = select(run_sweep).where(run_sweep.c.run == number).order_by(run_sweep.c.position).limit(AT_ONCE)
    while rows := [dict(row) for row in reader.execute(query.where(run_sweep.c.position > position)).mappings()]:
        yield rows
        position = rows[-1]["position"]


def _add_rows(writer: Connection, number: int, started: Any, rows: Sequence[dict[str, Any]]) -> None:
    keys = list({row["key"] for row in rows})
    there = set(writer.scalars(select(sweep.c.key).where(sweep.c.key.in_(keys))))  # some may have been left out
    seen = select(run_sweep.c.key, run_sweep.c.run, run.c.started).join(run, run.c.number == run_sweep.c.run)
    latest = writer.execute(seen.where(run_sweep.c.key.in_(keys), run_sweep.c.standing == LATEST)).all()
    later = {row.key for row in latest if row.started > started}
    overtaken = [row.key for row in latest if row.started <= started and row.run != number]
    if overtaken:
        former = update(run_sweep).where(run_sweep.c.key.in_(overtaken), run_sweep.c.standing == LATEST)
        writer.execute(former.values(standing=OVERTAKEN))
    added = [row | {"run": number, "standing": _standing(row, later)} for row in rows if row["key"] in there]
    if added:
        writer.execute(insert(run_sweep), added)
    shared_sections.learn(writer, "label", {str(name) for row in added for name in row["labels"]})


def _standing(row: Mapping[str, Any], later: set[str]) -> int:
    if row["standing"] == REPEATED:
        return REPEATED
    return OVERTAKEN if row["key"] in later else LATEST
