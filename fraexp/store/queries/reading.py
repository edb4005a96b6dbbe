"""Questions to the database, each asked with a handful of statements however many sweeps there are."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, RowMapping, Select, and_, func, select

from fraexp.data.identity import TAG
from fraexp.data.results import Outcome, Result
from fraexp.errors import StoreError
from fraexp.store import codec, shared_sections
from fraexp.store.clock import now
from fraexp.store.liveness import Process, alive
from fraexp.store.queries import annotations
from fraexp.store.stored_records import RunProgress, RunSummary, StoredState, StoredSweep, Supplied
from fraexp.store.tables import (
    CHUNK,
    PARTS,
    chunks,
    curve,
    curve_column,
    fit,
    frequency_response,
    metric,
    run,
    run_sweep,
    sweep,
)
from fraexp.store.tables import supplied_component as supplied
from fraexp.store.validation import sound

LARGEST = 2**31 - 1
"""Largest integer of a database's column."""


def known(connection: Connection, keys: Iterable[str]) -> dict[str, StoredState]:
    """Return the state of those sweeps that have a result."""
    found: dict[str, StoredState] = {}
    wanted = set(keys)
    stored = select(sweep.c.key, sweep.c.outcome, sweep.c.elapsed).where(sweep.c.outcome.is_not(None))
    sources = select(supplied.c.key, supplied.c.kind, supplied.c.name, supplied.c.source_hash)
    # More than there are: all are read, which takes less than asking for each.
    few = len(wanted) <= CHUNK or len(wanted) < (connection.scalar(select(func.count()).select_from(sweep)) or 0)
    for chunk in chunks(wanted) if few else [None]:
        for key, outcome, elapsed in connection.execute(
            stored if chunk is None else stored.where(sweep.c.key.in_(chunk))
        ):
            if key in wanted:
                found[key] = StoredState(Outcome[outcome], {}, elapsed)
        asked = sources if chunk is None else sources.where(supplied.c.key.in_(chunk))
        for key, kind, name, source_hash in connection.execute(asked):
            if key in found:
                found[key].sources[f"{kind}:{name}"] = source_hash
    return found


def sources(connection: Connection) -> dict[str, dict[str, int]]:
    """Return how many sweeps each component has computed, by ``kind:name`` and by the hash of its source."""
    query = select(supplied.c.kind, supplied.c.name, supplied.c.source_hash, func.count())
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for kind, name, source, count in connection.execute(query.group_by(*query.selected_columns[:3])):
        found[f"{kind}:{name}"][source] = count
    return dict(found)


def runs(connection: Connection, number: int | None = None) -> list[RunSummary]:
    """Return all runs, newest first, or the one of a number."""
    counting = select(run_sweep.c.run, run_sweep.c.state, func.count()).group_by(run_sweep.c.run, run_sweep.c.state)
    listing = select(run).order_by(run.c.number.desc())
    if number is not None:
        counting, listing = counting.where(run_sweep.c.run == number), listing.where(run.c.number == number)
    counts: dict[int, dict[str, int]] = defaultdict(dict)
    for of, state, count in connection.execute(counting):
        counts[of][state] = count
    moment = now(connection)
    return [_summary(row, counts[row["number"]], moment) for row in connection.execute(listing).mappings()]


def one_run(connection: Connection, number: int) -> RunSummary:
    """Return the run of a number; StoreError tells which there are."""
    found = runs(connection, number) if 0 < number <= LARGEST else []
    if found:
        return found[0]
    newest = connection.scalar(select(func.max(run.c.number)))
    hint = f"the newest is run {newest}" if newest else "there is none yet, 'fraexp run STUDY' makes one"
    raise StoreError(f"there is no run {number}; {hint}")


def sweeps(connection: Connection, number: int) -> list[StoredSweep]:
    """Return the sweeps of a run in grid order, without arrays."""
    one_run(connection, number)
    query = _listing().where(run_sweep.c.run == number).order_by(run_sweep.c.position)
    keys = select(run_sweep.c.key).where(run_sweep.c.run == number)
    sources = _sources(connection, select(supplied).where(supplied.c.key.in_(keys)))
    return _stored(connection, connection.execute(query).mappings().all(), sources)


def find(connection: Connection, prefix: str) -> StoredSweep:
    """Return the one sweep whose key starts with a prefix, as its latest run saw it."""
    head = prefix.strip().lower()
    head = head if head.startswith(f"{TAG}-") else f"{TAG}-{head}"
    # Digits are hexadecimal, so everything that starts with the prefix lies below prefix + "g".
    query = select(sweep.c.key).where(sweep.c.key >= head, sweep.c.key < f"{head}g").order_by(sweep.c.key).limit(4)
    keys = list(connection.scalars(query))
    if not keys:
        remedy = "'fraexp list' shows the runs and their studies, 'fraexp show RUN' its sweeps"
        raise StoreError(f"no sweep's key starts with '{prefix}'; {remedy}")
    if len(keys) > 1:
        some = ", ".join(keys[:3]) + (", ..." if len(keys) > 3 else "")
        raise StoreError(f"several sweeps' keys start with '{prefix}': {some}; give more characters")
    latest = _listing().where(sweep.c.key == keys[0]).order_by(run_sweep.c.run.desc(), run_sweep.c.position).limit(1)
    sources = _sources(connection, select(supplied).where(supplied.c.key == keys[0]))
    return _stored(connection, connection.execute(latest).mappings().all(), sources)[0]


def log(connection: Connection, key: str) -> str:
    """Return the log of a sweep's latest attempt; empty if it did not fail."""
    query = select(run_sweep.c.log).where(run_sweep.c.key == key).order_by(run_sweep.c.run.desc()).limit(1)
    text = connection.scalar(query) or ""
    if not isinstance(text, str):
        raise TypeError(f"a log is a {type(text).__name__}")
    return text


def results(connection: Connection, keys: Iterable[str]) -> dict[str, Result]:
    """Return the results of those sweeps that have one, with arrays."""
    found: dict[str, Result] = {}
    for chunk in chunks(keys):
        responses = {
            row["key"]: codec.response_of(row) for row in connection.execute(_of(frequency_response, chunk)).mappings()
        }
        metrics = defaultdict(list)
        for row in connection.execute(_of(metric, chunk).order_by(metric.c.position)).mappings():
            metrics[row["key"]].append(codec.metric_of(row))
        curves = _curves(connection, chunk)
        fits = defaultdict(list)
        for row in connection.execute(_of(fit, chunk).order_by(fit.c.position)).mappings():
            fits[row["key"]].append(codec.fit_of(row))
        query = select(sweep.c.key, sweep.c.outcome, sweep.c.message, sweep.c.elapsed, sweep.c.numerics)
        for row in connection.execute(query.where(sweep.c.key.in_(chunk), sweep.c.outcome.is_not(None))).mappings():
            key = row["key"]
            parts = (responses.get(key), tuple(metrics[key]), tuple(curves[key]), tuple(fits[key]))
            state = {"numerics": row["numerics"], "elapsed": row["elapsed"]}
            found[key] = sound(Result(Outcome[row["outcome"]], row["message"], *parts, **state))
    return found


def _curves(connection: Connection, keys: list[str]) -> dict[str, list[Any]]:
    columns = defaultdict(list)
    for row in connection.execute(_of(curve_column, keys).order_by(curve_column.c.position)).mappings():
        columns[row["key"], row["curve"]].append(row)
    found = defaultdict(list)
    for row in connection.execute(_of(curve, keys).order_by(curve.c.position)).mappings():
        found[row["key"]].append(codec.curve_of(row["name"], columns[row["key"], row["position"]]))
    return found


def _of(table: Any, keys: list[str]) -> Select[Any]:
    return select(table).where(table.c.key.in_(keys))


def _listing() -> Select[Any]:
    return select(
        *(sweep.c[name] for name in ("key", "outcome", "elapsed", "created", "message")),
        *(sweep.c[f"{name}_part"] for name in PARTS),
        run_sweep.c.labels,
        run_sweep.c.state,
        run_sweep.c.message.label("failure"),
    ).select_from(sweep.outerjoin(run_sweep, and_(run_sweep.c.key == sweep.c.key)))


def _sources(connection: Connection, query: Select[Any]) -> dict[str, dict[str, Supplied]]:
    found: dict[str, dict[str, Supplied]] = defaultdict(dict)
    for row in connection.execute(query):
        found[row.key][f"{row.kind}:{row.name}"] = sound(Supplied(row.source_hash, row.distribution))
    return found


def _stored(
    connection: Connection, rows: Sequence[RowMapping], sources: dict[str, dict[str, Supplied]]
) -> list[StoredSweep]:
    keys = [row["key"] for row in rows]
    resolved, tags, notes = (
        shared_sections.load(connection, rows),
        annotations.tags_of(connection, keys),
        annotations.notes(connection, keys),
    )
    return [
        sound(replace(_one(row, *resolved[key], sources), tags=tags.get(key, ()), note=notes.get(key, "")))
        for key, row in zip(keys, rows, strict=True)
    ]


def _one(row: RowMapping, experiment: Any, estimator: Any, sources: dict[str, dict[str, Supplied]]) -> StoredSweep:
    return StoredSweep(
        key=row["key"],
        experiment=experiment,
        estimator=estimator,
        labels=row["labels"] or {},
        outcome=Outcome[row["outcome"]] if row["outcome"] else None,
        message=row["failure"] or row["message"],
        elapsed=row["elapsed"],
        created=row["created"],
        state=row["state"] or "computed",
        sources=dict(sources.get(row["key"], {})),
    )


def _summary(row: RowMapping, counts: dict[str, int], moment: datetime) -> RunSummary:
    process = sound(Process(row["host"], row["boot"], row["pid"], row["process_start"]))
    dead = row["state"] == "running" and not alive(process, moment - row["heartbeat"])
    names = ("number", "study", "study_file", "command", "started", "ended", "provenance")
    values: dict[str, Any] = {name: row[name] for name in names}
    return sound(
        RunSummary(
            **values,
            state="interrupted" if dead else row["state"],
            total=sum(counts.values()),
            computed=counts.get("computed", 0),
            reused=counts.get("reused", 0),
            failed=counts.get("failed", 0),
            process=process,
            heartbeat=row["heartbeat"],
            progress=sound(RunProgress(**row["progress"])) if row["progress"] else None,
        )
    )
