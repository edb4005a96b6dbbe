"""Merging of databases: what the target lacks is added; where they differ, the target keeps its own.

Every sweep and every run that is read is counted once: as added, as already there, as a conflict, or as damaged. All
conflicts and all damage are listed; the computing time of a result and the time of its storing are not compared.
"""

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from sqlalchemy import Connection, bindparam, delete, insert, select, update

from fraexp.data.results import Outcome
from fraexp.store import shared_sections
from fraexp.store.changes import writing
from fraexp.store.changes.merge_source import SourceSweep, Transaction, find_keys, read_batches
from fraexp.store.damage import read_tolerantly
from fraexp.store.diff import describe_differences
from fraexp.store.digests import ORIGIN_COLUMNS, new_run_sweep, run_digest, run_sweep_digest
from fraexp.store.queries import annotations, reading, stored_results
from fraexp.store.queries.filter_sql import STATES
from fraexp.store.queries.reading import RUN_STATES
from fraexp.store.sealing import read_origin_rows, read_run_rows, seal_annotations, seal_run
from fraexp.store.stored_records import Conflict, MergeSummary
from fraexp.store.tables import (
    RESULT_TABLES,
    STANDING_LATEST,
    STANDING_OVERTAKEN,
    STANDING_REPEATED,
    WITHOUT_RUN,
    RowValues,
    insert_or_ignore,
    key_chunks,
    note,
    run,
    run_sweep,
    sweep,
    tag,
)

BATCH_SIZE = 500
"""Sweeps that are processed together."""
RUN_IDENTITY = ("host", "boot", "pid", "process_start", "started")
"""Columns that identify a run, whatever its number."""
COMPARED_COLUMNS = ("study", "study_file", "command", "state", "ended", "provenance")
COMPARED_SWEEP_COLUMNS = ("key", "labels", "state", "message", "log")
MAX_SHOWN_DIFFERENCES = 3


@dataclass
class _MergeCounts:
    """Counts of what has been merged."""

    read: int = 0
    sweeps: int = 0
    results: int = 0
    same: int = 0
    tags: int = 0
    notes: int = 0
    added: set[str] = field(default_factory=set)
    conflicts: dict[str, Conflict] = field(default_factory=dict)
    damaged: dict[str, Conflict] = field(default_factory=dict)
    read_runs: int = 0
    runs: int = 0
    known_runs: int = 0
    run_conflicts: list[Conflict] = field(default_factory=list)
    damaged_runs: list[Conflict] = field(default_factory=list)

    def add_conflict(self, key: str, what: tuple[str, ...], how: str) -> None:
        """Add a conflict of a sweep to those that are known."""
        if key in self.conflicts:
            known = self.conflicts[key]
            what, how = (*known.what, *what), f"{known.how}; {how}"
        self.conflicts[key] = Conflict(key, what, how)

    def summary(self) -> MergeSummary:
        """Return the counts as a summary."""
        conflicts = {key: of for key, of in self.conflicts.items() if key not in self.damaged}
        # Damage is reported with what else is to be said of the sweep, so that nothing is counted twice.
        damaged = tuple(_join_findings(of, self.conflicts.get(key)) for key, of in self.damaged.items())
        added = len(self.added - conflicts.keys() - self.damaged.keys())
        return MergeSummary(
            self.sweeps,
            self.results,
            self.same,
            self.runs,
            self.known_runs,
            tuple(conflicts.values()),
            read=self.read,
            added=added,
            there=self.read - added - len(conflicts) - len(damaged),
            tags=self.tags,
            notes=self.notes,
            damaged=damaged,
            read_runs=self.read_runs,
            run_conflicts=tuple(self.run_conflicts),
            damaged_runs=tuple(self.damaged_runs),
        )


def _join_findings(damage: Conflict, conflict: Conflict | None) -> Conflict:
    if conflict is None:
        return damage
    return Conflict(damage.key, (*damage.what, *conflict.what), f"{damage.how}; {conflict.how}")


def merge_databases(
    source: Transaction, ours: Transaction, target: Transaction
) -> Generator[tuple[int, int], None, MergeSummary]:
    """Add to `target` what `source` has, each batch in one transaction; yield the numbers of done and of all sweeps.

    `ours` opens the same database as `target` for reading. A second merge adds nothing, so that it completes an
    interrupted one.
    """
    counts = _MergeCounts()
    keys = find_keys(source)
    for batch in read_batches(source, keys, BATCH_SIZE):
        sound = _count_damage(batch, counts)
        with target() as connection:
            both = _add_sweeps(connection, sound, counts)
        with source():  # its errors name the source's database
            theirs = {key: sound[key].result() for key in both}
        with ours() as connection:
            for key, mine in stored_results.read_results(connection, both).items():
                what, how = describe_differences(mine, theirs[key])
                if mine.outcome is Outcome.DAMAGED:
                    what, how = ("damaged",), "damaged here, sound there; fraexp delete it here, and merge again"
                if what:
                    counts.add_conflict(key, what, how)
                counts.same += not what
        yield counts.read, len(keys)
    with source() as connection:
        numbers = [summary.number for summary in reading.read_runs(connection)][::-1]
    for number in numbers:
        _merge_run(source, target, number, counts)
        yield counts.read, len(keys)
    return counts.summary()


def _count_damage(batch: Mapping[str, SourceSweep | None], counts: _MergeCounts) -> dict[str, SourceSweep]:
    """Return the sweeps that can be added, by key; report the damage, and keys that do not fit."""
    sound = {}
    counts.read += len(batch)
    for key, found in batch.items():
        if found is None:
            counts.damaged[key] = Conflict(
                key, ("sweep",), "it cannot be read, or its parameters are damaged; left out"
            )
        elif found.is_lost:
            counts.damaged[key] = Conflict(key, found.damage, "its row is damaged; it is left out")
        elif found.item.key != key:
            counts.add_conflict(key, ("key",), "its key does not match its parameters; it is left out")
        else:
            sound[key] = found
            if found.damage:
                counts.damaged[key] = Conflict(key, found.damage, f"{' and '.join(found.damage)} damaged and left out")
    return sound


def _add_sweeps(connection: Connection, sweeps_read: dict[str, SourceSweep], counts: _MergeCounts) -> list[str]:
    """Add missing sweeps and results, and return the keys of the sweeps with a result in both databases."""
    keys = list(sweeps_read)
    columns = (sweep.c.key, sweep.c.outcome, sweep.c.content)
    query = select(*columns).where(sweep.c.key.in_(keys))
    existing = {row.key: row.outcome is not None or row.content is not None for row in connection.execute(query)}
    writing.ensure_sweeps(connection, [of.item for of in sweeps_read.values()])
    new = [key for key in keys if key not in existing]
    missing = [key for key in keys if sweeps_read[key].result_columns and not existing.get(key)]
    _write_results(connection, sweeps_read, missing)
    counts.sweeps += len(new)
    counts.results += len(missing)
    counts.added.update(new, missing)
    both = [key for key in keys if sweeps_read[key].result_columns and existing.get(key)]
    _compare_origins(connection, sweeps_read, both, counts)
    _add_annotations(connection, sweeps_read, counts)
    return both


def _write_results(connection: Connection, sweeps_read: Mapping[str, SourceSweep], keys: Sequence[str]) -> None:
    if not keys:
        return
    result_columns = [{"of": key, **sweeps_read[key].result_columns} for key in keys]
    connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), result_columns)
    for table in reversed(RESULT_TABLES):  # parents first
        rows = [row for key in keys for row in sweeps_read[key].rows[table.name]]
        if rows:
            connection.execute(insert(table), rows)
    names = {row["name"] for key in keys for row in sweeps_read[key].rows["metric"]}
    shared_sections.add_field_names(connection, "metric", names)


def _compare_origins(
    connection: Connection, sweeps_read: Mapping[str, SourceSweep], keys: Sequence[str], counts: _MergeCounts
) -> None:
    ours: dict[str, list[RowValues]] = {}
    for chunk in key_chunks(keys):
        ours |= read_origin_rows(connection, chunk)
    for key in keys:
        here, there = (_origins(rows) for rows in (ours.get(key, ()), sweeps_read[key].rows["supplied_component"]))
        texts = [
            f"{name}: {here.get(name, 'none')} here, {there.get(name, 'none')} there"
            for name in sorted({*here, *there})
            if here.get(name) != there.get(name)
        ]
        if texts:
            counts.add_conflict(key, ("origins",), f"provided by {', '.join(texts)}")


def _origins(rows: Sequence[RowValues]) -> dict[str, str]:
    kind, name, *others = ORIGIN_COLUMNS
    return {f"{row[kind]} {row[name]}": " ".join(str(row[column])[:32] for column in others) for row in rows}


def _add_annotations(connection: Connection, sweeps_read: Mapping[str, SourceSweep], counts: _MergeCounts) -> None:
    """Add tags and notes; a note that differs is a conflict."""
    annotated = [key for key, of in sweeps_read.items() if of.tags or of.note]
    if not annotated:
        return
    tags = annotations.tags_of_sweeps(connection, annotated)
    notes = annotations.notes_of_sweeps(connection, annotated)
    new_tags = [
        {"key": key, "name": name}
        for key in annotated
        for name in sweeps_read[key].tags
        if name not in tags.get(key, ())
    ]
    new_notes = [{"key": key, "text": sweeps_read[key].note} for key in annotated if sweeps_read[key].note]
    for row in new_notes:
        here, there = notes.get(row["key"], ""), row["text"]
        if here and here != there:
            counts.add_conflict(row["key"], ("note",), f'note: "{here}" here, "{there}" there')
    new_notes = [row for row in new_notes if row["key"] not in notes]
    for table, rows in ((tag, new_tags), (note, new_notes)):
        if rows:
            connection.execute(insert_or_ignore(connection, table), rows)
    changed = [row["key"] for row in (*new_tags, *new_notes)]
    seal_annotations(connection, changed)
    counts.tags += len(new_tags)
    counts.notes += len(new_notes)
    counts.added.update(changed)


class _RunMerge:
    """What became of one run."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.is_new = False
        self.damage: list[str] = []
        self.differences: list[str] = []

    def describe(self, findings: Sequence[str], what: str) -> Conflict:
        """Return findings as a line of the merge's report."""
        more = len(findings) - MAX_SHOWN_DIFFERENCES
        texts = [*findings[:MAX_SHOWN_DIFFERENCES], *([f"{more} more"] if more > 0 else [])]
        return Conflict(f"run {self.number}", (what,), "; ".join(texts))


def _add_run(reader: Connection, writer: Connection, number: int) -> _RunMerge:
    """Add a run under a new number, or update one that was added while it was running."""
    found = _RunMerge(number)
    row = dict(reader.execute(select(run).where(run.c.number == number)).mappings().first() or {})
    if not row or run_digest(row) != row["digest"] or row["state"] not in RUN_STATES:
        found.damage.append("its row is damaged; it is left out")
        return found
    same = (run.c[name].is_(None) if row[name] is None else run.c[name] == row[name] for name in RUN_IDENTITY)
    known = writer.execute(select(run).where(*same)).mappings().first()
    expected = row["sweeps"]
    del row["number"]
    if known is not None and known["state"] != "running":
        _compare_runs(reader, writer, row, dict(known), found)
        return found
    if known is None:
        new_number = int(writer.execute(insert(run).values(**row).returning(run.c.number)).scalar_one())
        found.is_new = True
    else:
        new_number = known["number"]
        writer.execute(update(run).where(run.c.number == new_number).values(**row))
        _remove_run_sweeps(writer, new_number)
    added = 0
    for rows in _read_run_sweeps(reader, number):
        added += _add_run_sweeps(writer, new_number, row["started"], rows)
    if added < expected:
        found.damage.append(f"{expected - added} of its {expected} sweeps are damaged and left out")
    seal_run(writer, new_number)
    return found


def _compare_runs(reader: Connection, writer: Connection, theirs: RowValues, ours: RowValues, found: _RunMerge) -> None:
    """Add to what was found in what a run differs that both databases have, and what of it is damaged."""
    found.differences += [
        f"{name.replace('_', ' ')}: {_quote(ours[name])} here, {_quote(theirs[name])} there"
        for name in COMPARED_COLUMNS
        if theirs[name] != ours[name]
    ]
    here = {row["position"]: row for rows in _read_run_sweeps(writer, ours["number"]) for row in rows}
    lost_here, read, only_there = ours["sweeps"] - len(here), 0, []
    for rows in _read_run_sweeps(reader, found.number):
        read += len(rows)
        for row in rows:
            mine = here.pop(row["position"], None)
            only_there += [row["key"]] if mine is None else []
            found.differences += [] if mine is None else _sweep_differences(row, mine)
    if lost_here > 0:
        found.differences.append(f"{lost_here} of its sweeps are damaged here")
    elif only_there:
        found.differences += [f"sweep {key[4:12]} only there" for key in only_there]
    if theirs["sweeps"] > read:
        found.damage.append(f"{theirs['sweeps'] - read} of its {theirs['sweeps']} sweeps are damaged and not compared")
    elif here:
        found.differences.append(f"{len(here)} of its sweeps only here")


def _sweep_differences(theirs: RowValues, ours: RowValues) -> Iterator[str]:
    name = theirs["key"][4:12]
    for column in COMPARED_SWEEP_COLUMNS:
        if theirs[column] != ours[column]:
            yield f"sweep {name}, {column}: {_quote(ours[column])} here, {_quote(theirs[column])} there"


def _quote(value: object) -> str:
    text = str(value)
    return f'"{text}"' if len(text) <= 80 else f'"{text[:80]}..."'


def _read_run_sweeps(reader: Connection, number: int) -> Iterator[list[RowValues]]:
    """Yield the sound rows of a run in lists."""
    for rows in read_run_rows(reader, number):
        yield [dict(row) for row in rows if run_sweep_digest(row) == row["digest"] and row["state"] in STATES]


def _remove_run_sweeps(writer: Connection, number: int) -> None:
    """Remove the rows of a run that are going to be replaced; damaged ones will not be."""
    others = select(run_sweep.c.key).where(run_sweep.c.run != number)
    lone = select(run_sweep.c.key).where(run_sweep.c.run == number, run_sweep.c.key.not_in(others))
    writer.execute(update(sweep).where(sweep.c.key.in_(lone)).values(in_runs=WITHOUT_RUN))
    writer.execute(delete(run_sweep).where(run_sweep.c.run == number))


def _add_run_sweeps(writer: Connection, number: int, started: datetime, rows: Sequence[RowValues]) -> int:
    """Add rows of a run, and return their number: those of damaged sweeps are left out."""
    keys = list({row["key"] for row in rows})
    existing = set(writer.scalars(select(sweep.c.key).where(sweep.c.key.in_(keys))))
    seen = select(run_sweep.c.key, run_sweep.c.run, run.c.started).join(run, run.c.number == run_sweep.c.run)
    latest = writer.execute(seen.where(run_sweep.c.key.in_(keys), run_sweep.c.standing == STANDING_LATEST)).all()
    later = {row.key for row in latest if row.started > started}
    overtaken = [row.key for row in latest if row.started <= started and row.run != number]
    if overtaken:
        earlier = update(run_sweep).where(run_sweep.c.key.in_(overtaken), run_sweep.c.standing == STANDING_LATEST)
        writer.execute(earlier.values(standing=STANDING_OVERTAKEN))
    added = [
        new_run_sweep(row | {"run": number, "standing": _standing(row, later)})
        for row in rows
        if row["key"] in existing
    ]
    if added:
        writer.execute(insert(run_sweep), added)
        writing.mark_in_runs(writer, {row["key"] for row in added})
    shared_sections.add_field_names(writer, "label", {str(name) for row in added for name in row["labels"]})
    return len(added)


def _standing(row: Mapping[str, object], later: set[str]) -> int:
    if row["standing"] == STANDING_REPEATED:
        return STANDING_REPEATED
    return STANDING_OVERTAKEN if row["key"] in later else STANDING_LATEST


def _undoable(reader: Connection, writer: Connection, number: int) -> _RunMerge:
    with writer.begin_nested():
        return _add_run(reader, writer, number)


def _merge_run(source: Transaction, target: Transaction, number: int, counts: _MergeCounts) -> None:
    """Merge a run, and count it once: as damaged, as a conflict, as added, or as already there."""
    counts.read_runs += 1
    with source() as reader, target() as writer:
        found = read_tolerantly(lambda _: {number: _undoable(reader, writer, number)}, [number]).get(number)
    if found is None:
        counts.damaged_runs.append(Conflict(f"run {number}", ("run",), "it cannot be read; it is left out"))
    elif found.damage:
        counts.damaged_runs.append(found.describe([*found.damage, *found.differences], "run"))
    elif found.differences:
        counts.run_conflicts.append(found.describe(found.differences, "run"))
    else:
        counts.runs += found.is_new
        counts.known_runs += not found.is_new
