"""Integrity of the stored data: the structure of the database, and every digest."""

from collections.abc import Iterator
from dataclasses import dataclass

from sqlalchemy import Connection, case, exists, func, select
from sqlalchemy.exc import StatementError

from fraexp.data.identity import TAG
from fraexp.errors import StoreError
from fraexp.store.changes.merge_source import SourceSweep, Transaction, find_keys, read_batches
from fraexp.store.damage import RESTORE_HINT, is_damage
from fraexp.store.digests import log_digest, read_run_rows, run_sweep_digest
from fraexp.store.queries import reading
from fraexp.store.queries.filter_sql import STATES
from fraexp.store.tables import IN_RUNS, STANDING_LATEST, WITHOUT_RUN, Query, run_sweep, sweep
from fraexp.store.validation import FOREIGN_DATA_ERRORS

BATCH_SIZE = 500
"""Sweeps that are read together."""
MAX_NAMED = 5
"""Maximum number of findings that a message names."""


@dataclass(frozen=True)
class Examination:
    """What was found in a database."""

    structure: str
    """Fault that the database's own check finds; empty if there is none."""
    sweeps: int
    """Number of sweeps."""
    damaged_sweeps: dict[str, str]
    """What is damaged, by key of the sweep."""
    runs: int
    """Number of runs."""
    damaged_runs: dict[int, str]
    """What is damaged, by number of the run."""

    def __str__(self) -> str:
        """Return ``sound``, or what is damaged and what helps."""
        findings = [f"sweep {key[4:12]}: {what}" for key, what in self.damaged_sweeps.items()]
        findings += [f"run {number}: {what}" for number, what in self.damaged_runs.items()]
        if not findings and not self.structure:
            return "sound"
        bad = f"{len(self.damaged_sweeps)} of {self.sweeps} sweeps and {len(self.damaged_runs)} of {self.runs} runs"
        more = [f"{len(findings) - MAX_NAMED} more"] if len(findings) > MAX_NAMED else []
        texts = [f"{bad} are damaged", *([self.structure] if self.structure else []), *findings[:MAX_NAMED], *more]
        return f"{'; '.join(texts)}; {RESTORE_HINT}"


def examine(source: Transaction, structure: str) -> Examination:
    """Return what is damaged in a database of which the own check has found `structure`."""
    keys = find_keys(source)
    damaged: dict[str, str] = {}
    for batch in read_batches(source, keys, BATCH_SIZE):
        damaged |= {key: what for key, found in batch.items() if (what := _damage_of(key, found))}
    with source() as connection:
        runs = reading.read_runs(connection)
        damaged_runs = {
            of.number: what
            for of in runs
            if (what := "damaged" if of.state == reading.DAMAGED_RUN else _first_fault(connection, of.number))
        }
        for key in (*_without_latest_run(connection), *_with_lost_runs(connection)):
            damaged.setdefault(key, "its latest run is unknown")
    return Examination(structure, len(keys), damaged, len(runs), damaged_runs)


def _damage_of(key: str, found: SourceSweep | None) -> str:
    """Return what is damaged of a sweep; empty if it is sound."""
    if found is None:
        return "it cannot be read, or its parameters are damaged"
    if found.damage:
        return f"{' and '.join(found.damage)} damaged"
    if key.startswith(TAG) and found.item.key != key:
        return "its key does not match its parameters"
    try:
        if found.result_columns:
            found.result()
    except (StoreError, *FOREIGN_DATA_ERRORS) as error:
        return f"its result is invalid ({' '.join(str(error).split())[:80]})"
    return ""


def _first_fault(connection: Connection, number: int) -> str:
    try:
        return next(_faults(connection, number), "")
    except (StatementError, *FOREIGN_DATA_ERRORS) as error:
        if not is_damage(error):
            raise
        return "its sweeps cannot be read"


def _faults(connection: Connection, number: int) -> Iterator[str]:
    for rows in read_run_rows(connection, number):
        for row in rows:
            is_sound = run_sweep_digest(row) == row["digest"] and log_digest(row["log"]) == row["log_digest"]
            if not is_sound or row["state"] not in STATES:
                yield f"damaged at position {row['position']}"


def _without_latest_run(connection: Connection) -> list[str]:
    """Return the keys of sweeps in runs of which not exactly one is the latest."""
    latest = func.sum(case((run_sweep.c.standing == STANDING_LATEST, 1), else_=0))
    return _read_keys(connection, select(run_sweep.c.key).group_by(run_sweep.c.key).having(latest != 1))


def _with_lost_runs(connection: Connection) -> list[str]:
    """Return the keys of sweeps that should be in a run and are not, or are in one and should not be."""
    expected = case((exists().where(run_sweep.c.key == sweep.c.key), IN_RUNS), else_=WITHOUT_RUN)
    return _read_keys(connection, select(sweep.c.key).where(sweep.c.in_runs != expected))


def _read_keys(connection: Connection, query: Query) -> list[str]:
    try:
        return [str(key) for key in connection.scalars(query)]
    except StatementError as error:
        if not is_damage(error):
            raise
        return []
