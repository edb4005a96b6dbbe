"""Queries of results: which sweeps have one, from which sources, and the results with their arrays."""

import math
from collections import defaultdict
from collections.abc import Iterable

from sqlalchemy import Connection, func, or_, select

from fraexp.data.findings import remarks
from fraexp.data.results import Outcome, Result
from fraexp.store import codec, digests
from fraexp.store.damage import DAMAGED, read_tolerantly
from fraexp.store.digests import LISTED_COLUMNS, digest
from fraexp.store.stored_records import Likeness, StoredState
from fraexp.store.tables import MAX_KEYS_PER_QUERY, is_one_of, key_chunks, metadata, sweep
from fraexp.store.tables import supplied_component as supplied

HAS_RESULT = or_(sweep.c.outcome.is_not(None), sweep.c.content.is_not(None))
"""A sweep has a result, or had one before its outcome was damaged."""
STORED = select(*(sweep.c[name] for name in (*LISTED_COLUMNS, "digest"))).where(HAS_RESULT)
STORED_OF_KEYS = STORED.where(is_one_of(sweep.c.key))
MAX_NEWEST_TIMES = 2000
"""Number of results whose computing times are read: the index on their age makes that quick in any database."""
LIKENESS = tuple(sweep.c[f"{kind}_name"] for kind in ("plant", "friction", "controller", "excitation", "estimator"))
NEWEST_TIMES = (
    select(sweep.c.source, *LIKENESS, sweep.c.elapsed)
    .where(sweep.c.created.is_not(None))
    .order_by(sweep.c.created.desc())
    .limit(MAX_NEWEST_TIMES)
)
SOURCES = select(supplied.c.key, supplied.c.kind, supplied.c.name, supplied.c.source_hash)
SOURCES_OF_KEYS = SOURCES.where(is_one_of(supplied.c.key))


def stored_states(connection: Connection, keys: Iterable[str]) -> dict[str, StoredState]:
    """Return the state of each sweep that has a result."""
    found: dict[str, StoredState] = {}
    wanted = set(keys)
    # If more are wanted than exist, all are read, which is faster than many queries.
    few = len(wanted) <= MAX_KEYS_PER_QUERY or len(wanted) < (
        connection.scalar(select(func.count()).select_from(sweep)) or 0
    )
    for chunk in key_chunks(wanted) if few else [None]:
        chosen = {} if chunk is None else {"keys": chunk}
        for row in connection.execute(STORED_OF_KEYS if chosen else STORED, chosen):
            *values, row_digest = row
            if row.key in wanted:
                is_sound = digest(values) == row_digest
                found[row.key] = StoredState(Outcome[row.outcome] if is_sound else Outcome.DAMAGED, {}, row.elapsed)
        sources = connection.execute(SOURCES_OF_KEYS if chosen else SOURCES, chosen) if found else ()
        for key, kind, name, source_hash in sources:
            if key in found:
                found[key].sources[f"{kind}:{name}"] = source_hash
    return found


def like_times(connection: Connection) -> dict[Likeness, list[float]]:
    """Return the computing times [s] of the newest results by the components of their sweeps, newest first."""
    found: dict[Likeness, list[float]] = defaultdict(list)
    for *names, elapsed in connection.execute(NEWEST_TIMES):
        if isinstance(elapsed, float) and 0 <= elapsed < math.inf:  # it may be damaged
            found[tuple(names)].append(elapsed)
    return dict(found)


def count_sources(connection: Connection) -> dict[str, dict[str, int]]:
    """Return the number of sweeps of each component, by ``kind:name`` and by the hash of its source."""
    query = select(supplied.c.kind, supplied.c.name, supplied.c.source_hash, func.count())
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for kind, name, source, count in connection.execute(query.group_by(*query.selected_columns[:3])):
        found[f"{kind}:{name}"][source] = count
    return dict(found)


def read_results(connection: Connection, keys: Iterable[str]) -> dict[str, Result]:
    """Return the result of each sweep that has one, with arrays; a damaged one has this outcome and nothing else."""
    wanted = list(dict.fromkeys(keys))
    found = read_tolerantly(lambda chunk: _read_results(connection, chunk), wanted)
    lost = [key for key in wanted if key not in found]
    return found | {
        key: damaged_result() for key in read_tolerantly(lambda chunk: _with_result(connection, chunk), lost)
    }


def _with_result(connection: Connection, keys: list[str]) -> dict[str, bool]:
    """Return the keys of the sweeps that have a result, or should have one."""
    return dict.fromkeys(connection.scalars(select(sweep.c.key).where(sweep.c.key.in_(keys), HAS_RESULT)), True)


def _read_results(connection: Connection, keys: list[str]) -> dict[str, Result]:
    rows = digests.read_result_rows(connection, keys, [metadata.tables[name] for name in digests.RESULT_COLUMNS])
    query = select(*(sweep.c[name] for name in (*digests.STATE_COLUMNS, "content")))
    found = {}
    for state in connection.execute(query.where(sweep.c.key.in_(keys), HAS_RESULT)).mappings():
        tables = rows[state["key"]]
        is_sound = digests.result_digest(state, tables) == state["content"]
        found[state["key"]] = codec.parse_result(state, tables) if is_sound else damaged_result()
    return found


def damaged_result() -> Result:
    """Return what is shown instead of a damaged result."""
    return Result(Outcome.DAMAGED, remarks(DAMAGED))
