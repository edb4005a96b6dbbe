"""Queries of runs and sweeps; each takes a few statements for any number of sweeps."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from datetime import datetime

from sqlalchemy import Connection, RowMapping, and_, false, func, or_, select

from fraexp.data.findings import remarks
from fraexp.data.identity import TAG, key_heads
from fraexp.data.results import UNUSABLE_OUTCOMES, Outcome
from fraexp.errors import StoreError, did_you_mean
from fraexp.store import codec, shared_sections
from fraexp.store.damage import DAMAGED, RESTORE_HINT, read_tolerantly
from fraexp.store.digests import (
    LISTED_COLUMNS,
    digest,
    listed_digest,
    log_digest,
    origins_digest,
    read_origin_rows,
    read_tags,
    run_digest,
    sum_of_digests,
    tags_digest,
)
from fraexp.store.liveness import Host, Process, host_of, now
from fraexp.store.queries.filter_sql import STATES
from fraexp.store.stored_records import ComponentOrigin, RunProgress, RunSummary, StoredSweep
from fraexp.store.tables import (
    IN_RUNS,
    PARTS,
    STANDING_LATEST,
    STANDING_REPEATED,
    WITHOUT_RUN,
    Expression,
    Query,
    RowValues,
    TableRow,
    is_one_of,
    key_chunks,
    run,
    run_sweep,
    scalars_of,
    sweep,
)
from fraexp.store.validation import JsonTable, check_types

MIN_PREFIX = 4
"""Minimum number of characters that stand for a key: fewer are rather meant as a run."""
RUN_STATES = ("running", "complete", "partial", "interrupted")
DAMAGED_RUN = "damaged"
"""State of a run of which the stored row is damaged, or some of its sweeps are missing."""
MAX_COLUMN_INTEGER = 2**31 - 1
"""Largest integer that a column can store."""


def read_runs(connection: Connection, number: int | None = None) -> list[RunSummary]:
    """Return all runs, newest first, or the run with a number; one whose process died shows as ``interrupted``."""
    counting = select(run_sweep.c.run, run_sweep.c.state, func.count(), sum_of_digests())
    counting = counting.group_by(run_sweep.c.run, run_sweep.c.state)
    numbering = select(run.c.number)
    if number is not None:
        counting, numbering = counting.where(run_sweep.c.run == number), numbering.where(run.c.number == number)
    counts: dict[int, Counter[str]] = defaultdict(Counter)
    digests: Counter[int] = Counter()
    for of, state, count, total in connection.execute(counting):
        counts[of][state] += count
        digests[of] += int(total)
    unusable = {row.run: row.unusable for row in connection.execute(_unusable_query(number))}
    time_now, host = now(connection), host_of(connection)

    def summarise(row: RowMapping) -> RunSummary:
        of = row["number"]
        is_complete = (counts[of].total(), digests[of]) == (row["sweeps"], row["sweep_digests"])
        is_sound = is_complete and run_digest(row) == row["digest"] and set(counts[of]) <= set(STATES)
        if not is_sound or row["state"] not in RUN_STATES:
            return _damaged_run(of, counts[of].total(), time_now)
        return _run_summary(row, counts[of], unusable.get(of, 0), time_now, host)

    found = read_tolerantly(
        lambda chunk: {
            row["number"]: summarise(row)
            for row in connection.execute(select(run).where(run.c.number.in_(chunk))).mappings()
        },
        connection.scalars(numbering),
    )
    lost = [of for of in counts if of not in found]
    found |= {of: _damaged_run(of, counts[of].total(), time_now) for of in lost}
    return [found[of] for of in sorted(found, reverse=True)]


def _unusable_query(number: int | None) -> Query:
    """Return the query of how many results of each run, or of one, are unusable, damaged outcomes included."""
    names = [outcome.name for outcome in Outcome if outcome not in UNUSABLE_OUTCOMES]
    unusable = run_sweep.c.key.in_(select(sweep.c.key).where(sweep.c.outcome.not_in(names)))
    query = select(run_sweep.c.run, func.count().label("unusable")).where(unusable, run_sweep.c.state != "failed")
    return (query if number is None else query.where(run_sweep.c.run == number)).group_by(run_sweep.c.run)


def read_studies(connection: Connection, numbers: Iterable[int]) -> dict[int, str]:
    """Return the study of each run by its number; damaged runs are left out."""
    return read_tolerantly(
        lambda chunk: {
            row["number"]: row["study"]
            for row in connection.execute(select(run).where(run.c.number.in_(chunk))).mappings()
            if run_digest(row) == row["digest"]
        },
        numbers,
    )


def read_run(connection: Connection, number: int) -> RunSummary:
    """Return the run with a number; StoreError, with the newest number, if there is none."""
    check_run(connection, number)
    return read_runs(connection, number)[0]


def check_run(connection: Connection, number: int) -> None:
    """Raise StoreError, with the newest number, if there is no run with a number."""
    known = (select(column).where(column == number).limit(1) for column in (run.c.number, run_sweep.c.run))
    if 0 < number <= MAX_COLUMN_INTEGER and any(connection.scalar(query) is not None for query in known):
        return
    newest = connection.scalar(select(func.max(run.c.number)))
    hint = f"the newest is run {newest}" if newest else "there is none yet, 'fraexp run STUDY' makes one"
    raise StoreError(f"there is no run {number}; {hint}")


def read_sweeps(connection: Connection, number: int) -> list[StoredSweep]:
    """Return the sweeps of a run in grid order, without arrays."""
    check_run(connection, number)
    places = select(run_sweep.c.position).where(run_sweep.c.run == number)
    found = read_tolerantly(
        lambda chunk: dict(
            _stored_sweeps(
                connection, _listing_query().where(run_sweep.c.run == number, run_sweep.c.position.in_(chunk))
            )
        ),
        connection.scalars(places.order_by(run_sweep.c.position)),
    )
    lost = select(run_sweep.c.position, run_sweep.c.key).where(run_sweep.c.run == number)
    for row in connection.execute(lost) if len(found) < _count_sweeps(connection, number) else ():
        found.setdefault(row.position, damaged_sweep(str(row.key), number))
    return [found[position] for position in sorted(found)]


def _count_sweeps(connection: Connection, number: int) -> int:
    query = select(func.count()).select_from(run_sweep).where(run_sweep.c.run == number)
    return int(connection.scalar(query) or 0)


def find_sweep(connection: Connection, prefix: str) -> StoredSweep:
    """Return the sweep whose key starts with a prefix, with or without ``fx2-``, as in its latest run."""
    if len(prefix.removeprefix(f"{TAG}-")) < MIN_PREFIX and key_heads(prefix):
        raise StoreError(f"'{prefix}' is too short for the key of a sweep; give {MIN_PREFIX} characters or more")
    # Digits are hexadecimal, so everything that starts with the prefix lies below prefix + "g".
    ranges = [and_(sweep.c.key >= head, sweep.c.key < f"{head}g") for head in key_heads(prefix)]
    query = select(sweep.c.key).where(or_(false(), *ranges)).order_by(sweep.c.key).limit(4)
    keys = list(connection.scalars(query))
    if not keys:
        raise StoreError(
            f"no sweep's key starts with '{prefix}', and no study of this name has been run; 'fraexp list' shows the "
            "runs and their studies, 'fraexp show RUN' its sweeps, and 'fraexp run STUDY' computes a study"
            + did_you_mean(prefix, connection.scalars(select(run.c.study).distinct()))
        )
    if len(keys) > 1:
        some = ", ".join(keys[:3]) + (", ..." if len(keys) > 3 else "")
        raise StoreError(f"several sweeps' keys start with '{prefix}': {some}; give more characters")
    return read_listed(connection, keys)[0]


def find_sweeps(connection: Connection, keys: Iterable[str]) -> dict[str, StoredSweep]:
    """Return the sweeps with these keys, as in their latest runs, in the order of the keys."""
    wanted = list(dict.fromkeys(keys))
    known = scalars_of(connection, select(sweep.c.key).where(is_one_of(sweep.c.key)), wanted)
    return {of.key: of for of in read_listed(connection, [key for key in wanted if key in known])}


def read_listed(connection: Connection, keys: Sequence[str], number: int | None = None) -> list[StoredSweep]:
    """Return sweeps that exist in the order of their keys, as in a run, or in their latest ones.

    One that cannot be read, or of which the run has several rows, is damaged.
    """
    of_run = run_sweep.c.standing == STANDING_LATEST
    if number is not None:
        of_run = and_(run_sweep.c.run == number, run_sweep.c.standing != STANDING_REPEATED)
    query = _listing_query(of_run)

    def read(chunk: list[str]) -> dict[str, StoredSweep]:
        rows = [of for _, of in _stored_sweeps(connection, query.where(sweep.c.key.in_(chunk)))]
        counts = Counter(of.key for of in rows)
        return {of.key: of for of in rows if counts[of.key] == 1}

    found = read_tolerantly(read, keys)
    return [found.get(key) or damaged_sweep(key, number) for key in keys]


def read_log(connection: Connection, key: str) -> str:
    """Return the log of a sweep's latest attempt; empty if it did not fail."""
    columns = (run_sweep.c.log, run_sweep.c.log_digest)
    query = select(*columns).where(run_sweep.c.key == key, run_sweep.c.standing == STANDING_LATEST).limit(1)
    text, stored = connection.execute(query).first() or ("", 0)
    if not isinstance(text, str):
        raise TypeError(f"a log is a {type(text).__name__}")
    return text if log_digest(text) == stored else f"the stored log is damaged; {RESTORE_HINT}"


def damaged_sweep(key: object, number: int | None = None) -> StoredSweep:
    """Return what is shown instead of a damaged sweep; SQLite may hold even bytes where its key should be."""
    name = key if isinstance(key, str) else f"key-{key!r}"
    return StoredSweep(name, {}, {}, {}, Outcome.DAMAGED, remarks(DAMAGED), 0.0, None, "computed", run=number)


def _listing_query(*conditions: Expression) -> Query:
    """Return the query of sweeps with the runs that meet conditions."""
    return select(
        *(sweep.c[name] for name in LISTED_COLUMNS),
        sweep.c.digest,
        sweep.c.in_runs,
        *(sweep.c[name] for name in ("origins", "parts", "tags")),
        *(sweep.c[f"{name}_part"] for name in PARTS),
        run_sweep.c.run,
        run_sweep.c.position,
        run_sweep.c.key.label("run_key"),
        run_sweep.c.labels,
        run_sweep.c.state,
        run_sweep.c.message.label("failure"),
        run_sweep.c.log_digest,
        run_sweep.c.digest.label("run_digest"),
    ).select_from(sweep.outerjoin(run_sweep, and_(run_sweep.c.key == sweep.c.key, *conditions)))


def _stored_sweeps(connection: Connection, query: Query) -> list[tuple[int, StoredSweep]]:
    """Return the sweeps of a listing query with their positions."""
    rows = connection.execute(query).mappings().all()
    keys = [row["key"] for row in rows]
    resolved = shared_sections.load_parts(connection, rows)
    tags = read_tags(connection, keys)
    origins = {key: of for chunk in key_chunks(keys) for key, of in read_origin_rows(connection, chunk).items()}
    studies = read_studies(connection, {row["run"] for row in rows} - {None})
    found = []
    for row in rows:
        key = row["key"]
        own, of_tags = origins.get(key, []), tags.get(key, ())
        is_sound = key in resolved and _is_listing_sound(row, of_tags)
        if is_sound and origins_digest(key, own) == row["origins"]:
            study = None if row["run"] is None else studies.get(row["run"], DAMAGED_RUN)
            listed = check_types(_stored_sweep(row, *resolved[key], own, of_tags, study))
        else:
            listed = damaged_sweep(key, row["run"])
        found.append((row["position"] or 0, listed))
    return found


def _is_listing_sound(row: RowMapping, tags: Iterable[str]) -> bool:
    """Return whether what a listing shows of a sweep and of its run is as it was stored."""
    if listed_digest(row) != row["digest"] or tags_digest(row["key"], tags) != row["tags"]:
        return False
    if row["run"] is None:
        return bool(row["in_runs"] == WITHOUT_RUN)
    if row["state"] not in STATES or row["in_runs"] != IN_RUNS:
        return False
    in_run = (row["run"], row["position"], row["run_key"], row["labels"], row["failure"], row["log_digest"])
    return digest(in_run) == row["run_digest"]


def _stored_sweep(
    row: RowMapping,
    experiment: JsonTable,
    estimator: JsonTable,
    origins: Iterable[TableRow],
    tags: tuple[str, ...],
    study: str | None,
) -> StoredSweep:
    return StoredSweep(
        key=row["key"],
        experiment=experiment,
        estimator=estimator,
        labels=row["labels"] or {},
        outcome=Outcome[row["outcome"]] if row["outcome"] else None,
        findings=codec.parse_findings(row["findings"]),
        failure=row["failure"] or "",
        elapsed=row["elapsed"],
        created=row["created"],
        state=row["state"] or "computed",
        sources={
            f"{of['kind']}:{of['name']}": check_types(ComponentOrigin(of["source_hash"], of["distribution"]))
            for of in origins
        },
        tags=tags,
        run=row["run"],
        study=study,
    )


def _run_summary(row: RowMapping, counts: Counter[str], unusable: int, time_now: datetime, host: Host) -> RunSummary:
    process = check_types(Process(row["host"], row["boot"], row["pid"], row["process_start"]))
    silence = time_now - row["heartbeat"]
    dead = row["state"] == "running" and not host.is_alive(process, silence)
    names = ("number", "study", "study_file", "command", "started", "ended", "heartbeat", "provenance", "deleted")
    values: RowValues = {name: row[name] for name in names}
    return check_types(
        RunSummary(
            **values,
            state="interrupted" if dead else row["state"],
            total=counts.total(),
            computed=counts["computed"],
            reused=counts["reused"],
            failed=counts["failed"],
            unusable=unusable,
            process=process,
            silence=silence.total_seconds() if row["state"] == "running" and not dead else 0.0,
            progress=check_types(RunProgress(**row["progress"])) if row["progress"] else None,
        )
    )


def _damaged_run(number: int, total: int, time_now: datetime) -> RunSummary:
    """Return what is shown instead of a damaged run."""
    blank: RowValues = {
        "study": "",
        "study_file": "",
        "command": "",
        "provenance": {},
        "process": Process("", "", 0, None),
    }
    blank |= dict.fromkeys(("computed", "reused", "failed"), 0) | dict.fromkeys(
        ("started", "ended", "heartbeat"), time_now
    )
    return RunSummary(number=number, state=DAMAGED_RUN, total=total, **blank)
