"""Merging of databases: what the target lacks is added; where they differ, the target keeps its own.

Every sweep and every run that is read is counted once: as added, as already there, as a conflict, or as damaged. All
conflicts and all damage are listed; the computing time of a result and the time of its storing are not compared.
"""

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, bindparam, delete, insert, select, update

from fraexp.data.results import Outcome, Result
from fraexp.store import shared_sections
from fraexp.store.changes import writing
from fraexp.store.changes.merge_source import SourceSweep, Transaction, find_keys, read_batches
from fraexp.store.damage import read_tolerantly
from fraexp.store.digests import (
    ORIGIN_COLUMNS,
    new_run_sweep,
    read_origin_rows,
    read_run_rows,
    read_tags,
    run_digest,
    run_sweep_digest,
    seal_places,
    seal_run,
    seal_tags,
)
from fraexp.store.queries import reading, stored_results
from fraexp.store.queries.filter_sql import STATES
from fraexp.store.queries.reading import RUN_STATES
from fraexp.store.stored_records import Conflict, MergeSummary
from fraexp.store.tables import RESULT_TABLES, RowValues, insert_or_ignore, key_chunks, run, run_sweep, sweep, tag

BATCH_SIZE = 500
"""Sweeps that are processed together."""
RUN_IDENTITY = ("host", "boot", "pid", "process_start", "started")
"""Columns that identify a run, whatever its number."""
COMPARED_COLUMNS = ("study", "study_file", "command", "state", "ended", "provenance")
COMPARED_SWEEP_COLUMNS = ("key", "labels", "state", "message", "log")
MAX_SHOWN_DIFFERENCES = 3


def merge_databases(
    source: Transaction, ours: Transaction, target: Transaction
) -> Generator[tuple[int, int], None, MergeSummary]:
    """Add to `target` what `source` has, each batch in one transaction; yield the numbers of done and of all sweeps.

    `ours` opens the same database as `target` for reading. A second merge adds nothing, so that it completes an
    interrupted one.
    """
    merge, keys = _Merge(), find_keys(source)
    for batch in read_batches(source, keys, BATCH_SIZE):
        sound = merge.take_sound(batch)
        with target() as connection:
            both = merge.add_sweeps(connection, sound)
        with source():  # its errors name the source's database
            theirs = {key: sound[key].result() for key in both}
        with ours() as connection:
            for key, mine in stored_results.read_results(connection, both).items():
                merge.note_differences(key, *_compare_results(mine, theirs[key]))
        yield merge.summary.read, len(keys)
    with source() as connection:
        numbers = [summary.number for summary in reading.read_runs(connection)][::-1]
    for number in numbers:
        merge.merge_run(source, target, number)
        yield merge.summary.read, len(keys)
    return merge.close()


class _Merge:
    """A merge in progress: what has been added, and what was found."""

    def __init__(self) -> None:
        self.summary = MergeSummary()
        self._added: set[str] = set()
        self._conflicts: dict[str, Conflict] = {}
        self._damaged: dict[str, Conflict] = {}

    def close(self) -> MergeSummary:
        """Return the summary, in which each sweep is counted once: damage comes before conflicts."""
        found = self.summary
        for key in self._damaged.keys() & self._conflicts.keys():
            self._damaged[key] = self._damaged[key].joined(self._conflicts.pop(key))
        found.conflicts, found.damaged = tuple(self._conflicts.values()), tuple(self._damaged.values())
        found.added = len(self._added - self._conflicts.keys() - self._damaged.keys())
        found.there = found.read - found.added - len(found.conflicts) - len(found.damaged)
        return found

    def _add_conflict(self, key: str, what: tuple[str, ...], how: str) -> None:
        conflict = Conflict(key, what, how)
        self._conflicts[key] = self._conflicts[key].joined(conflict) if key in self._conflicts else conflict

    def note_differences(self, key: str, what: tuple[str, ...], how: str) -> None:
        """Count a result that both databases have: as the same, or as a conflict if it differs."""
        if what:
            self._add_conflict(key, what, how)
        self.summary.same += not what

    def take_sound(self, batch: Mapping[str, SourceSweep | None]) -> dict[str, SourceSweep]:
        """Return the sweeps that can be added, by key; report the damage, and keys that do not fit."""
        sound = {}
        self.summary.read += len(batch)
        for key, found in batch.items():
            if found is None:
                how = "it cannot be read, or its parameters are damaged; left out"
                self._damaged[key] = Conflict(key, ("sweep",), how)
            elif found.is_lost:
                self._damaged[key] = Conflict(key, found.damage, "its row is damaged; it is left out")
            elif found.item.key != key:
                self._add_conflict(key, ("key",), "its key does not match its parameters; it is left out")
            else:
                sound[key] = found
                if found.damage:
                    how = f"{' and '.join(found.damage)} damaged and left out"
                    self._damaged[key] = Conflict(key, found.damage, how)
        return sound

    def add_sweeps(self, connection: Connection, sweeps_read: dict[str, SourceSweep]) -> list[str]:
        """Add missing sweeps and results, and return the keys of the sweeps with a result in both databases."""
        keys = list(sweeps_read)
        query = select(sweep.c.key, sweep.c.outcome, sweep.c.content).where(sweep.c.key.in_(keys))
        existing = {row.key: row.outcome is not None or row.content is not None for row in connection.execute(query)}
        writing.ensure_sweeps(connection, [of.item for of in sweeps_read.values()])
        new = [key for key in keys if key not in existing]
        missing = [key for key in keys if sweeps_read[key].result_columns and not existing.get(key)]
        _write_results(connection, sweeps_read, missing)
        self.summary.sweeps += len(new)
        self.summary.results += len(missing)
        self._added.update(new, missing)
        both = [key for key in keys if sweeps_read[key].result_columns and existing.get(key)]
        self._compare_origins(connection, sweeps_read, both)
        self._add_tags(connection, sweeps_read)
        return both

    def _compare_origins(
        self, connection: Connection, sweeps_read: Mapping[str, SourceSweep], keys: Sequence[str]
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
                self._add_conflict(key, ("origins",), f"provided by {', '.join(texts)}")

    def _add_tags(self, connection: Connection, sweeps_read: Mapping[str, SourceSweep]) -> None:
        tagged = {key: of.tags for key, of in sweeps_read.items() if of.tags}
        known = read_tags(connection, tagged)
        added = [
            {"key": key, "name": name}
            for key, tags in tagged.items()
            for name in tags
            if name not in known.get(key, ())
        ]
        if added:
            connection.execute(insert_or_ignore(connection, tag), added)
        changed = [row["key"] for row in added]
        seal_tags(connection, changed)
        self.summary.tags += len(added)
        self._added.update(changed)

    def merge_run(self, source: Transaction, target: Transaction, number: int) -> None:
        """Merge a run, and count it once: as damaged, as a conflict, as added, or as already there."""
        summary = self.summary
        summary.read_runs += 1
        with source() as reader, target() as writer:
            found = read_tolerantly(lambda _: {number: _undoable(reader, writer, number)}, [number]).get(number)
        if found is None:
            lost = Conflict(f"run {number}", ("run",), "it cannot be read; it is left out")
            summary.damaged_runs = (*summary.damaged_runs, lost)
        elif found.damage:
            summary.damaged_runs = (*summary.damaged_runs, found.describe())
        elif found.differences:
            summary.run_conflicts = (*summary.run_conflicts, found.describe())
        else:
            summary.runs += found.is_new
            summary.known_runs += not found.is_new


def _compare_results(mine: Result, theirs: Result) -> tuple[tuple[str, ...], str]:
    if mine.outcome is Outcome.DAMAGED:
        return ("damaged",), "damaged here, sound there; fraexp delete it here, and merge again"
    return describe_differences(mine, theirs)


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


def _origins(rows: Sequence[RowValues]) -> dict[str, str]:
    kind, name, *others = ORIGIN_COLUMNS
    return {f"{row[kind]} {row[name]}": " ".join(str(row[column])[:32] for column in others) for row in rows}


class _RunMerge:
    """What became of one run."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.is_new = False
        self.damage: list[str] = []
        self.differences: list[str] = []

    def describe(self) -> Conflict:
        """Return what was found as a line of the merge's report."""
        findings = [*self.damage, *self.differences]
        more = len(findings) - MAX_SHOWN_DIFFERENCES
        texts = [*findings[:MAX_SHOWN_DIFFERENCES], *([f"{more} more"] if more > 0 else [])]
        return Conflict(f"run {self.number}", ("run",), "; ".join(texts))


def _undoable(reader: Connection, writer: Connection, number: int) -> _RunMerge:
    with writer.begin_nested():
        return _add_run(reader, writer, number)


def _add_run(reader: Connection, writer: Connection, number: int) -> _RunMerge:
    """Add a run under a new number, or update one that was added while it was running."""
    found = _RunMerge(number)
    row = dict(reader.execute(select(run).where(run.c.number == number)).mappings().first() or {})
    if not row or run_digest(row) != row["digest"] or row["state"] not in RUN_STATES:
        found.damage.append("its row is damaged; it is left out")
        return found
    same = (run.c[name].is_(None) if row[name] is None else run.c[name] == row[name] for name in RUN_IDENTITY)
    known = writer.execute(select(run).where(*same)).mappings().first()
    del row["number"]
    if known is not None and known["state"] != "running":
        _compare_runs(reader, writer, row, dict(known), found)
        return found
    replaced: list[str] = []
    if known is None:
        new_number = int(writer.execute(insert(run).values(**row).returning(run.c.number)).scalar_one())
        found.is_new = True
    else:
        new_number = known["number"]
        writer.execute(update(run).where(run.c.number == new_number).values(**row))
        replaced += writer.scalars(select(run_sweep.c.key).where(run_sweep.c.run == new_number))
        writer.execute(delete(run_sweep).where(run_sweep.c.run == new_number))
    added = sum(_add_run_sweeps(writer, new_number, rows) for rows in _read_run_sweeps(reader, number))
    if added < row["sweeps"]:
        found.damage.append(f"{row['sweeps'] - added} of its {row['sweeps']} sweeps are damaged and left out")
    seal_places(writer, replaced)
    seal_run(writer, new_number)
    return found


def _compare_runs(reader: Connection, writer: Connection, theirs: RowValues, ours: RowValues, found: _RunMerge) -> None:
    """Add in what a run differs that both databases have, and what of it is damaged."""
    found.differences += _differences(COMPARED_COLUMNS, ours, theirs)
    here, there = (
        {row["position"]: row for rows in _read_run_sweeps(connection, number) for row in rows}
        for connection, number in ((writer, ours["number"]), (reader, found.number))
    )
    lost_here, lost_there = ours["sweeps"] - len(here), theirs["sweeps"] - len(there)
    if lost_there > 0:
        found.damage.append(f"{lost_there} of its {theirs['sweeps']} sweeps are damaged and not compared")
    if lost_here > 0:
        found.differences.append(f"{lost_here} of its sweeps are damaged here")
    for position in sorted({*here, *there}):
        mine, other = here.get(position), there.get(position)
        if mine and other:
            found.differences += _differences(COMPARED_SWEEP_COLUMNS, mine, other, f"sweep {other['key'][4:12]}, ")
        elif other and lost_here <= 0:
            found.differences.append(f"sweep {other['key'][4:12]} only there")
        elif mine and lost_there <= 0:
            found.differences.append(f"sweep {mine['key'][4:12]} only here")


def _differences(columns: Sequence[str], ours: RowValues, theirs: RowValues, what: str = "") -> Iterator[str]:
    for name in columns:
        if ours[name] != theirs[name]:
            yield f"{what}{name.replace('_', ' ')}: {_quote(ours[name])} here, {_quote(theirs[name])} there"


def _quote(value: object) -> str:
    text = str(value)
    return f'"{text}"' if len(text) <= 80 else f'"{text[:80]}..."'


def _read_run_sweeps(reader: Connection, number: int) -> Iterator[list[RowValues]]:
    """Yield the sound rows of a run in lists."""
    for rows in read_run_rows(reader, number):
        yield [dict(row) for row in rows if run_sweep_digest(row) == row["digest"] and row["state"] in STATES]


def _add_run_sweeps(writer: Connection, number: int, rows: Sequence[RowValues]) -> int:
    """Add rows of a run, and return their number: those of damaged sweeps are left out."""
    keys = list({row["key"] for row in rows})
    existing = set(writer.scalars(select(sweep.c.key).where(sweep.c.key.in_(keys))))
    added = [new_run_sweep(row | {"run": number}) for row in rows if row["key"] in existing]
    if added:
        writer.execute(insert(run_sweep), added)
    seal_places(writer, existing)
    shared_sections.add_field_names(writer, "label", {str(name) for row in added for name in row["labels"]})
    return len(added)


PARTS = ("outcome", "findings", "response", "metrics", "curves", "fits", "numerics")
MAX_NAMED = 3
"""Maximum number of differences of a part that are named."""


def describe_differences(ours: Result, theirs: Result) -> tuple[tuple[str, ...], str]:
    """Return the names of the parts in which two results differ, and a description; both empty if they are equal."""
    found = {name: list(_value_differences("", getattr(ours, name), getattr(theirs, name))) for name in PARTS}
    differing = {name: how for name, how in found.items() if how}
    return tuple(differing), "; ".join(f"{name}: {_short_list(how)}" for name, how in differing.items())


def _value_differences(name: str, here: Any, there: Any) -> Iterator[str]:
    """Yield how two values of a name differ, and the values inside them."""
    if isinstance(here, np.ndarray) and isinstance(there, np.ndarray):
        text = _array_difference(here, there)
        if text:
            yield f"{name} {text}"
    elif is_dataclass(here) and is_dataclass(there):
        inner = getattr(here, "name", name)
        for item in fields(here):
            label = inner if item.name in ("value", "columns") else f"{inner} {item.name}".strip()
            yield from _value_differences(label, getattr(here, item.name), getattr(there, item.name))
    elif isinstance(here, Mapping) and isinstance(there, Mapping) and list(here) == list(there):
        for key in here:
            yield from _value_differences(f"{name} {key}".strip(), here[key], there[key])
    elif _is_list(here) and _is_list(there) and len(here) == len(there):
        for one, other in zip(here, there, strict=True):
            yield from _value_differences(name, one, other)
    elif here is None or there is None or _is_list(here) or isinstance(here, Mapping):
        if here is not there:
            yield f"{name} in one alone".strip()
    elif here != there and not (_is_nan(here) and _is_nan(there)):
        yield f"{name} {_text(here)} here, {_text(there)} there".strip()


def _array_difference(one: NDArray[np.generic], other: NDArray[np.generic]) -> str:
    """Return how two arrays differ: how far, relative to the largest value; empty if they are equal."""
    if one.shape != other.shape:
        return f"has {one.shape} here, {other.shape} there"
    if one.tobytes() == other.tobytes() or np.array_equal(one, other, equal_nan=True):
        return ""
    here, there = (np.asarray(values, complex).ravel() for values in (one, other))
    finite = np.isfinite(here) & np.isfinite(there)
    if not np.array_equal(here[~finite], there[~finite], equal_nan=True):
        return "by values that are not finite in one alone"
    scale = float(np.abs(here[finite]).max(initial=0.0)) or 1.0
    return f"by {float(np.abs(here[finite] - there[finite]).max(initial=0.0)) / scale:.1e}"


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _text(value: object) -> str:
    if isinstance(value, Enum):
        return value.name.lower()
    return f"{value:g}" if isinstance(value, float) else f'"{value}"'


def _short_list(found: Sequence[str]) -> str:
    return ", ".join(found[:MAX_NAMED]) + (f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else "")
