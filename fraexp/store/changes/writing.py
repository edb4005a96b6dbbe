"""Changes of the database, each within the transaction that it is given."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Connection, bindparam, delete, insert, select, update

from fraexp.data.results import Result
from fraexp.data.sweep import Sweep
from fraexp.errors import StoreError
from fraexp.store import shared_sections
from fraexp.store.changes import leases
from fraexp.store.clock import now
from fraexp.store.codec import result_rows
from fraexp.store.liveness import this_process
from fraexp.store.stored_records import RunProgress, Supplied
from fraexp.store.tables import LATEST, OVERTAKEN, REPEATED, RESULT_TABLES, chunks, metadata, run, run_sweep, sweep

ENDED = ("complete", "partial", "interrupted")
"""States in which a run can end."""
NAMED = ("plant", "friction", "controller", "excitation")


def begin_run(
    connection: Connection,
    study: str,
    study_file: str,
    command: str,
    provenance: Mapping[str, Any],
    grid: Sequence[Sweep],
) -> int:
    """Write a run and its sweeps, all pending; return its number."""
    moment = now(connection)
    row = {"study": study, "study_file": study_file, "command": command, "provenance": dict(provenance)}
    state = {"state": "running", "started": moment, "heartbeat": moment, **asdict(this_process())}
    number = int(connection.execute(insert(run).values(**row, **state).returning(run.c.number)).scalar_one())
    ensure(connection, grid)
    for chunk in chunks(item.key for item in grid):
        overtaken = update(run_sweep).where(run_sweep.c.key.in_(chunk), run_sweep.c.standing == LATEST)
        connection.execute(overtaken.values(standing=OVERTAKEN))
    first = {item.key: position for position, item in reversed(list(enumerate(grid)))}
    rows = [
        {
            "run": number,
            "position": position,
            "key": item.key,
            "labels": dict(item.labels),
            "standing": LATEST if first[item.key] == position else REPEATED,
        }
        for position, item in enumerate(grid)
    ]
    _insert(connection, run_sweep, rows)
    shared_sections.learn(connection, "label", {str(name) for item in grid for name in item.labels})
    return number


def beat(connection: Connection, number: int, progress: RunProgress | None) -> None:
    """Note that the run is still being worked on, and how far it came."""
    told = (
        {}
        if progress is None
        else {"progress": {name: value for name, value in asdict(progress).items() if value != ""}}
    )
    connection.execute(update(run).where(run.c.number == number).values(heartbeat=now(connection), **told))


def end_run(connection: Connection, number: int, state: str) -> None:
    """Note how a run ended."""
    if state not in ENDED:
        raise StoreError(f"a run cannot end as '{state}'; expected one of {', '.join(ENDED)}")
    started = connection.scalar(select(run.c.started).where(run.c.number == number))
    moment = max(now(connection), started or datetime.min.replace(tzinfo=UTC))  # the clock may have been set back
    connection.execute(update(run).where(run.c.number == number).values(state=state, ended=moment, heartbeat=moment))
    leases.release(connection, number)


def mark(connection: Connection, number: int, keys: Iterable[str], state: str) -> None:
    """Set the state of sweeps of a run that went well."""
    for chunk in chunks(keys):
        chosen = update(run_sweep).where(run_sweep.c.run == number, run_sweep.c.key.in_(chunk))
        connection.execute(chosen.values(state=state, message=""))


def fail(connection: Connection, number: int, key: str, message: str, log: str) -> None:
    """Note a failed attempt with its log; an older result stays."""
    chosen = update(run_sweep).where(run_sweep.c.run == number, run_sweep.c.key == key)
    connection.execute(chosen.values(state="failed", message=message, log=log))
    leases.release(connection, number, [key])


def save(connection: Connection, number: int, results: Sequence[tuple[Sweep, Result, Mapping[str, Supplied]]]) -> None:
    """Store results in place of older ones of the same sweeps."""
    if connection.scalar(select(run.c.number).where(run.c.number == number)) is None:
        raise StoreError(f"there is no run {number}; begin one before saving")
    latest = {item.key: (item, result, supplied) for item, result, supplied in results}
    ensure(connection, [item for item, _, _ in latest.values()])
    for chunk in chunks(latest):
        for table in RESULT_TABLES:
            connection.execute(delete(table).where(table.c.key.in_(chunk)))
    moment = now(connection)
    outcomes = [_outcome_row(key, result, moment) for key, (_, result, _) in latest.items()]
    if outcomes:
        connection.execute(update(sweep).where(sweep.c.key == bindparam("of")), outcomes)
    rows = [result_rows(key, result) for key, (_, result, _) in latest.items()]
    for name in ("frequency_response", "metric", "curve", "curve_column", "fit"):
        _insert(connection, metadata.tables[name], [row for tables in rows for row in tables[name]])
    shared_sections.learn(connection, "metric", {row["name"] for tables in rows for row in tables["metric"]})
    origins = [row for item, _, supplied in latest.values() for row in _origin_rows(item, supplied)]
    _insert(connection, metadata.tables["supplied_component"], origins)
    mark(connection, number, latest, "computed")
    leases.release(connection, number, list(latest))


def ensure(connection: Connection, grid: Sequence[Sweep]) -> None:
    """Write those sweeps that are not there yet, without a result."""
    missing = {item.key: item for item in grid}
    for chunk in chunks(list(missing)):
        for key in connection.scalars(select(sweep.c.key).where(sweep.c.key.in_(chunk))):
            del missing[key]
    new = list(missing.values())
    numbers = shared_sections.store(connection, new)
    rows = [_sweep_row(item) | of for item, of in zip(new, numbers, strict=True)]
    _insert(connection, sweep, rows)
    kinds = [f"{kind}_name" for kind in (*NAMED, "estimator")]
    shared_sections.learn(connection, "word", {row[kind] for row in rows for kind in kinds if row[kind] is not None})


def _insert(connection: Connection, table: Any, rows: list[dict[str, Any]]) -> None:
    if rows:
        connection.execute(insert(table), rows)


def _sweep_row(item: Sweep) -> dict[str, Any]:
    names = {f"{section}_name": _name(item.experiment.get(section)) for section in NAMED}
    return {
        "key": item.key,
        "experiment_key": item.experiment_key,
        "source": _text(item.experiment.get("source")),
        "estimator_name": _name(item.estimator),
        **names,
    }


def _name(spec: Any) -> str | None:
    return _text(spec.get("name")) if isinstance(spec, Mapping) else None


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _outcome_row(key: str, result: Result, created: datetime) -> dict[str, Any]:
    row = {"of": key, "outcome": result.outcome.name, "message": result.message, "numerics": result.numerics}
    return row | {"elapsed": float(result.elapsed), "created": created}


def _origin_rows(item: Sweep, supplied: Mapping[str, Supplied]) -> Iterator[dict[str, Any]]:
    specs = [*_specs("", item.experiment), *_specs("estimator", item.estimator)]
    for kind, _, name in (label.partition(":") for label in supplied):
        named = [(place == kind, spec["version"]) for place, spec in specs if spec["name"] == name]
        # A component within another one stands under its parameter's name, not under its kind.
        version = max(named, key=lambda entry: entry[0])[1] if named else None
        yield {"key": item.key, "kind": kind, "name": name, "version": version, **asdict(supplied[f"{kind}:{name}"])}


def _specs(place: str, data: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every component in plain data, with the name it stands under."""
    if isinstance(data, list | tuple):
        for entry in data:
            yield from _specs(place, entry)
    if not isinstance(data, Mapping):
        return
    if isinstance(data.get("name"), str) and isinstance(data.get("version"), int):
        yield place, data
    for key, value in data.items():
        yield from _specs(key, value)
