"""Changes of runs, sweeps and results, each within the transaction of its connection."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime, timedelta

from sqlalchemy import Connection, Delete, Table, and_, bindparam, delete, insert, or_, select, update

from fraexp.data.results import Result
from fraexp.data.sweep import Plain, Sweep
from fraexp.errors import StoreError
from fraexp.store import digests, shared_sections
from fraexp.store.changes import leases
from fraexp.store.codec import result_rows
from fraexp.store.liveness import Process, host_of, now
from fraexp.store.stored_records import ComponentOrigin, RunProgress
from fraexp.store.tables import (
    IN_RUNS,
    RESULT_TABLES,
    STANDING_LATEST,
    STANDING_OVERTAKEN,
    STANDING_REPEATED,
    WITHOUT_RUN,
    RowValues,
    TableRow,
    is_one_of,
    key_chunks,
    metadata,
    run,
    run_sweep,
    sweep,
)

FINAL_STATES = ("complete", "partial", "interrupted")
"""States in which a run can end."""
CLOCK_TOLERANCE = timedelta(seconds=1)
"""Difference between two clocks that is no sign of one that was set: clocks are adjusted by up to 0.1 %."""
FIND_RUNS = (
    select(run.c.number, run.c.provenance)
    .where(run.c.state == "running", run.c.host == bindparam("host"), run.c.pid == bindparam("pid"))
    .order_by(run.c.number.desc())
)
FIND_NUMBER = select(run.c.number).where(run.c.number == bindparam("of_run"))
READ_RUN = select(run).where(run.c.number == bindparam("of_run"))
INSERT_RUN = insert(run).returning(run.c.number)
UPDATE_RUN = update(run).where(run.c.number == bindparam("of_run"))
OVERTAKE = (
    update(run_sweep)
    .where(is_one_of(run_sweep.c.key), run_sweep.c.standing == STANDING_LATEST)
    .values(standing=STANDING_OVERTAKEN)
)
OF_RUN = and_(run_sweep.c.run == bindparam("of_run"), is_one_of(run_sweep.c.key))
MARK_SWEEPS = update(run_sweep).where(OF_RUN)
READ_SWEEPS = select(run_sweep).where(OF_RUN)
READ_FAILURES = READ_SWEEPS.where(or_(run_sweep.c.message != "", run_sweep.c.log != ""))
SET_FAILURE = update(run_sweep).where(
    run_sweep.c.run == bindparam("of_run"), run_sweep.c.position == bindparam("of_position")
)
ADD_DIGEST = UPDATE_RUN.values(sweep_digests=run.c.sweep_digests + bindparam("difference"))
FIND_SWEEPS = select(sweep.c.key).where(is_one_of(sweep.c.key))
SET_OUTCOME = update(sweep).where(sweep.c.key == bindparam("of"))
DELETE_RESULTS: list[Delete] = [delete(table).where(is_one_of(table.c.key)) for table in RESULT_TABLES]
NAMED_SECTIONS = ("plant", "friction", "controller", "excitation")


def begin_run(
    connection: Connection, study: str, study_file: str, command: str, provenance: Plain, grid: Sequence[Sweep]
) -> int:
    """Store a run with its sweeps, all pending, and return its number.

    With a `run_id` in its provenance it is stored once, also if the caller repeats a call whose answer was lost.
    """
    process = host_of(connection).this_process()
    if (stored := _find_run(connection, provenance.get("run_id"), process)) is not None:
        return stored
    time_now = now(connection)
    row: RowValues = {"study": study, "study_file": study_file, "command": command, "provenance": dict(provenance)}
    row |= {"state": "running", "started": time_now, "ended": None, "heartbeat": time_now, **asdict(process)}
    row |= {"sweeps": len(grid), "deleted": 0}
    number = int(connection.execute(INSERT_RUN, row).scalar_one())
    ensure_sweeps(connection, grid, IN_RUNS)
    for chunk in key_chunks(item.key for item in grid):
        connection.execute(OVERTAKE, {"keys": chunk})
    first = {item.key: position for position, item in reversed(list(enumerate(grid)))}
    rows = [
        digests.new_run_sweep(
            {
                "run": number,
                "position": position,
                "key": item.key,
                "labels": dict(item.labels),
                "standing": STANDING_LATEST if first[item.key] == position else STANDING_REPEATED,
            }
        )
        for position, item in enumerate(grid)
    ]
    _insert_rows(connection, run_sweep, rows)
    sealed = {"digest": digests.run_digest(row | {"number": number}), "sweep_digests": sum(of["digest"] for of in rows)}
    connection.execute(UPDATE_RUN, {"of_run": number, **sealed})
    shared_sections.add_field_names(connection, "label", {str(name) for item in grid for name in item.labels})
    return number


def _find_run(connection: Connection, run_id: object, process: Process) -> int | None:
    """Return the running run of a process that has an identifier; None if there is none."""
    if run_id is None:
        return None
    rows = connection.execute(FIND_RUNS, {"host": process.host, "pid": process.pid})
    return next((int(row.number) for row in rows if row.provenance.get("run_id") == run_id), None)


def record_heartbeat(connection: Connection, number: int, progress: RunProgress | None) -> None:
    """Store a heartbeat of a run, with its progress if that is given."""
    progress_column = (
        {}
        if progress is None
        else {"progress": {name: value for name, value in asdict(progress).items() if value != ""}}
    )
    connection.execute(UPDATE_RUN, {"of_run": number, "heartbeat": now(connection), **progress_column})


def end_run(connection: Connection, number: int, state: str, elapsed: float | None = None) -> None:
    """Store the final state of a run, and its end.

    If the system's clock has been set since, which the `elapsed` time [s] of a steady clock shows, the end is the
    start plus the elapsed time.
    """
    if state not in FINAL_STATES:
        raise StoreError(f"a run cannot end as '{state}'; expected one of {', '.join(FINAL_STATES)}")
    row = dict(connection.execute(READ_RUN, {"of_run": number}).mappings().one())
    ended = _end_time(connection, row["started"], elapsed)
    values = {"state": state, "ended": ended, "heartbeat": ended}
    # Damage stays visible.
    sealed = {"digest": digests.run_digest(row | values)} if digests.run_digest(row) == row["digest"] else {}
    connection.execute(UPDATE_RUN, {"of_run": number, **values, **sealed})
    leases.release_leases(connection, number)


def _end_time(connection: Connection, started: datetime, elapsed: float | None) -> datetime:
    ended = max(now(connection), started)
    if elapsed is None:
        return ended
    steady = started + timedelta(seconds=elapsed)
    return ended if abs(ended - steady) <= CLOCK_TOLERANCE + 1e-3 * timedelta(seconds=elapsed) else steady


def mark_sweeps(connection: Connection, number: int, keys: Iterable[str], state: str) -> None:
    """Set the state of a run's sweeps that did not fail."""
    for chunk in key_chunks(keys):
        of_run = {"of_run": number, "keys": chunk}
        connection.execute(MARK_SWEEPS, of_run | {"state": state})
        _set_failures(connection, connection.execute(READ_FAILURES, of_run).mappings().all(), "", "")


def _set_failures(connection: Connection, rows: Iterable[TableRow], message: str, log: str) -> None:
    """Set the message and the log of sweeps in runs, with their digests."""
    for row in rows:
        sealed = digests.new_run_sweep(dict(row) | {"message": message, "log": log})
        values = {name: sealed[name] for name in ("message", "log", "log_digest", "digest")}
        connection.execute(SET_FAILURE, {"of_run": row["run"], "of_position": row["position"], **values})
        connection.execute(ADD_DIGEST, {"of_run": row["run"], "difference": values["digest"] - (row["digest"] or 0)})


def record_failure(
    connection: Connection, number: int, key: str, message: str, log: str, is_fenced: bool = False
) -> bool:
    """Store a failed attempt with its log, and return whether that is stored; an older result stays.

    With `is_fenced` it is stored only if the run holds the lease of the sweep.
    """
    if is_fenced and not leases.held_sweeps(connection, number, [key]):
        return bool(leases.finished_sweeps(connection, number, [key], "failed"))
    of_run = {"of_run": number, "keys": [key]}
    connection.execute(MARK_SWEEPS, of_run | {"state": "failed"})
    _set_failures(connection, connection.execute(READ_SWEEPS, of_run).mappings().all(), message, log)
    leases.release_leases(connection, number, [key])
    return True


def save_results(
    connection: Connection,
    number: int,
    results: Sequence[tuple[Sweep, Result, Mapping[str, ComponentOrigin]]],
    is_fenced: bool = False,
) -> set[str]:
    """Store results, which replace older ones of the same sweeps, and return the keys that this run has stored.

    Parameters
    ----------
    results : each sweep with its result and the origin of each of its components by ``kind:name``.
    is_fenced : store only sweeps whose lease the run holds, as after a silence. A call may be repeated.
    """
    if connection.scalar(FIND_NUMBER, {"of_run": number}) is None:
        raise StoreError(f"there is no run {number}; begin one before saving")
    latest = {item.key: (item, result, supplied) for item, result, supplied in results}
    stored = leases.finished_sweeps(connection, number, latest, "computed") if is_fenced else set()
    if is_fenced:
        held = leases.held_sweeps(connection, number, latest)
        latest = {key: value for key, value in latest.items() if key in held}
    ensure_sweeps(connection, [item for item, _, _ in latest.values()])
    for chunk in key_chunks(latest):
        for statement in DELETE_RESULTS:
            connection.execute(statement, {"keys": chunk})
    time_now = now(connection)
    rows = [result_rows(key, result) for key, (_, result, _) in latest.items()]
    origins = [list(_origin_rows(item, supplied)) for item, _, supplied in latest.values()]
    outcomes = [
        _outcome_row(item, result, time_now, tables, of)
        for (item, result, _), tables, of in zip(latest.values(), rows, origins, strict=True)
    ]
    if outcomes:
        connection.execute(SET_OUTCOME, outcomes)
    for name in ("frequency_response", "metric", "curve", "curve_column", "fit"):
        _insert_rows(connection, metadata.tables[name], [row for tables in rows for row in tables[name]])
    shared_sections.add_field_names(connection, "metric", {row["name"] for tables in rows for row in tables["metric"]})
    _insert_rows(connection, metadata.tables["supplied_component"], [row for of in origins for row in of])
    mark_sweeps(connection, number, latest, "computed")
    leases.release_leases(connection, number, list(latest))
    return stored | set(latest)


def ensure_sweeps(connection: Connection, grid: Sequence[Sweep], in_runs: str = WITHOUT_RUN) -> None:
    """Store the sweeps that do not exist yet, without a result; with IN_RUNS a run is going to have all of them."""
    missing = {item.key: item for item in grid}
    for chunk in key_chunks(list(missing)):
        existing = list(connection.scalars(FIND_SWEEPS, {"keys": chunk}))
        if in_runs == IN_RUNS:
            mark_in_runs(connection, existing)
        for key in existing:
            del missing[key]
    new = list(missing.values())
    numbers = shared_sections.store_parts(connection, new)
    rows = [_new_sweep_row(item) | of | {"in_runs": in_runs} for item, of in zip(new, numbers, strict=True)]
    _insert_rows(connection, sweep, rows)
    kinds = [f"{kind}_name" for kind in (*NAMED_SECTIONS, "estimator")]
    shared_sections.add_field_names(
        connection, "word", {row[kind] for row in rows for kind in kinds if row[kind] is not None}
    )


def mark_in_runs(connection: Connection, keys: Iterable[str]) -> None:
    """Note that a run has sweeps which had none before."""
    for chunk in key_chunks(keys):
        chosen = (sweep.c.key.in_(chunk), sweep.c.in_runs == WITHOUT_RUN)
        connection.execute(update(sweep).where(*chosen).values(in_runs=IN_RUNS))


def _insert_rows(connection: Connection, table: Table, rows: list[RowValues]) -> None:
    if rows:
        connection.execute(insert(table), rows)


def _sweep_row(item: Sweep) -> RowValues:
    names = {f"{section}_name": _component_name(item.experiment.get(section)) for section in NAMED_SECTIONS}
    return {
        "key": item.key,
        "experiment_key": item.experiment_key,
        "source": _text_or_none(item.experiment.get("source")),
        "estimator_name": _component_name(item.estimator),
        **names,
    }


def _new_sweep_row(item: Sweep) -> RowValues:
    """Return the row of a sweep without a result."""
    row = _sweep_row(item)
    empty: RowValues = {"outcome": None, "findings": [], "elapsed": 0.0, "created": None}
    return row | {"digest": digests.listed_digest(row | empty), "origins": digests.origins_digest(item.key, ())}


def _component_name(spec: object) -> str | None:
    return _text_or_none(spec.get("name")) if isinstance(spec, Mapping) else None


def _text_or_none(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _outcome_row(
    item: Sweep, result: Result, created: datetime, tables: Mapping[str, list[RowValues]], origins: list[RowValues]
) -> RowValues:
    row: RowValues = {"outcome": result.outcome.name, "numerics": result.numerics}
    row["findings"] = [found.plain() for found in result.findings]
    row |= {"elapsed": float(result.elapsed), "created": created}
    whole = _sweep_row(item) | row
    row |= {"digest": digests.listed_digest(whole), "content": digests.result_digest(whole, tables)}
    return row | {"of": item.key, "origins": digests.origins_digest(item.key, origins)}


def _origin_rows(item: Sweep, supplied: Mapping[str, ComponentOrigin]) -> Iterator[RowValues]:
    specs = [*_component_specs("", item.experiment), *_component_specs("estimator", item.estimator)]
    for kind, _, name in (label.partition(":") for label in supplied):
        named = [(place == kind, spec["version"]) for place, spec in specs if spec["name"] == name]
        # A nested component has its parameter's name as place, not its kind.
        version = max(named, key=lambda entry: entry[0])[1] if named else None
        yield {"key": item.key, "kind": kind, "name": name, "version": version, **asdict(supplied[f"{kind}:{name}"])}


def _component_specs(place: str, data: object) -> Iterator[tuple[str, Plain]]:
    """Yield each component in plain data with the key under which it stands."""
    if isinstance(data, list | tuple):
        for entry in data:
            yield from _component_specs(place, entry)
    if not isinstance(data, Mapping):
        return
    if isinstance(data.get("name"), str) and isinstance(data.get("version"), int):
        yield place, data
    for key, value in data.items():
        yield from _component_specs(key, value)
