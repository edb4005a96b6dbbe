"""The runs of a database that is merged into another one."""

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime

from sqlalchemy import Connection, delete, insert, select, update

from fraexp.store import shared_sections
from fraexp.store.changes.writing import mark_in_runs
from fraexp.store.digests import new_run_sweep, run_digest, run_sweep_digest
from fraexp.store.queries.filter_sql import STATES
from fraexp.store.queries.reading import RUN_STATES
from fraexp.store.sealing import read_run_rows, seal_run
from fraexp.store.stored_records import Conflict
from fraexp.store.tables import (
    STANDING_LATEST,
    STANDING_OVERTAKEN,
    STANDING_REPEATED,
    WITHOUT_RUN,
    RowValues,
    run,
    run_sweep,
    sweep,
)

RUN_IDENTITY = ("host", "boot", "pid", "process_start", "started")
"""Columns that identify a run, whatever its number."""
COMPARED_COLUMNS = ("study", "study_file", "command", "state", "ended", "provenance")
COMPARED_SWEEP_COLUMNS = ("key", "labels", "state", "message", "log")
MAX_SHOWN_DIFFERENCES = 3


class RunMerge:
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


def merge_run(reader: Connection, writer: Connection, number: int) -> RunMerge:
    """Add a run under a new number, or update one that was added while it was running."""
    found = RunMerge(number)
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


def _compare_runs(reader: Connection, writer: Connection, theirs: RowValues, ours: RowValues, found: RunMerge) -> None:
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
        mark_in_runs(writer, {row["key"] for row in added})
    shared_sections.add_field_names(writer, "label", {str(name) for row in added for name in row["labels"]})
    return len(added)


def _standing(row: Mapping[str, object], later: set[str]) -> int:
    if row["standing"] == STANDING_REPEATED:
        return STANDING_REPEATED
    return STANDING_OVERTAKEN if row["key"] in later else STANDING_LATEST
