"""Listings of sweeps: filtered, sorted and cut into pages by the database."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, and_, func, select
from sqlalchemy.sql.visitors import iterate

from fraexp.data.results import Outcome
from fraexp.errors import StoreError
from fraexp.store.queries import annotations
from fraexp.store.queries.filter_sql import (
    COLUMNS,
    KEY,
    METRIC,
    NAMES,
    Declared,
    Names,
    holds,
    place_of,
    seen,
    undeclared,
)
from fraexp.store.queries.filters import parse
from fraexp.store.queries.json_sql import at, sorted_at, text_sorted_at
from fraexp.store.stored_records import Listed, ListingPage
from fraexp.store.tables import LATEST, REPEATED, chunks, metric, part, sweep
from fraexp.store.validation import sound

SHOWN = ("key", "state", "outcome", "message", *NAMES, "source", "elapsed", "created", "run", "study")
POSITION, NEWEST = "position", "-created"
"""How the sweeps of a run, and all sweeps, are sorted unless told otherwise."""
FAR = 10_000
"""Rows from which on it pays to count first, and to read a page from the nearer end."""


def page(
    connection: Connection,
    text: str,
    order: str,
    offset: int,
    limit: int,
    number: int | None,
    declared: Declared = undeclared,
) -> ListingPage:
    """Return some rows of a listing, and how many there are in all."""
    names = Names.of(connection, declared)
    order = order or (NEWEST if number is None else POSITION)
    conditions = _conditions(text, names, number)
    query, by = _asked(conditions, order, names, number)
    first, most = max(offset, 0), max(limit, 0)
    count = _from(select(func.count()), conditions, [], number)
    if conditions and (order.removeprefix("-") != "created" or _searches(text)):
        # What they let through is found once, to be counted and to be sorted. Sorting by an index stops at the page.
        found = query.add_columns(*(item.label(f"by{index}") for index, item in enumerate(by))).cte("found")
        by = [found.c[f"by{index}"] for index in range(len(by))]
        count = select(func.count()).select_from(found)
        cut = select(found.c.key, count.scalar_subquery()).order_by(*_sorting(by, order, found.c.key))
    elif conditions and first < FAR:  # what a condition finds first of all is found once for both
        cut = query.add_columns(count.correlate(None).scalar_subquery()).order_by(*_sorting(by, order, KEY))
    else:
        total = int(connection.scalar(count) or 0)
        return ListingPage(_rows(connection, _cut(connection, query, by, order, total, first, most), number), total)
    rows = connection.execute(cut.offset(first).limit(most)).all()
    total = int((rows[0][1] if rows else connection.scalar(count)) or 0)
    return ListingPage(_rows(connection, [row[0] for row in rows], number), total)


def _cut(
    connection: Connection, query: Select[Any], by: Sequence[ColumnElement[Any]], order: str,
    total: int, first: int, most: int,
) -> list[str]:  # fmt: skip
    """Return the keys of a page, read from the nearer end: rows that are left out take their time, too."""
    if first <= total // 2:
        return list(connection.scalars(query.order_by(*_sorting(by, order, KEY)).offset(first).limit(most)))
    count = min(most, max(total - first, 0))
    turned = [(item.asc() if order.startswith("-") else item.desc()).nulls_first() for item in by]
    found = connection.scalars(query.order_by(*turned, KEY.desc()).offset(total - first - count).limit(count))
    return list(found)[::-1]


def keys(connection: Connection, text: str, number: int | None, declared: Declared = undeclared) -> list[str]:
    """Return the keys of all sweeps that a filter lets through: newest first, or a run's in its order."""
    names = Names.of(connection, declared)
    query, by = _asked(_conditions(text, names, number), "", names, number)
    return list(connection.scalars(query.order_by(*_sorting(by, "" if number else NEWEST, KEY))))


def fields(connection: Connection) -> list[str]:
    """Return what a filter may name."""
    return Names.of(connection).all()


def _conditions(text: str, names: Names, number: int | None) -> list[ColumnElement[bool]]:
    now = datetime.now().astimezone()
    return [holds(condition, names, now, number) for condition in parse(text)]


def _searches(text: str) -> bool:
    """Return whether a filter has a word that is searched everywhere, which takes its time."""
    return any(not condition.field for condition in parse(text))


def _asked(
    conditions: list[ColumnElement[bool]], order: str, names: Names, number: int | None
) -> tuple[Select[Any], list[ColumnElement[Any]]]:
    """Return the query of the keys, and what they are sorted by."""
    name = order.removeprefix("-") or ("created" if number is None else POSITION)
    query = select(KEY)
    if name not in names.parameters or name in COLUMNS:
        by = _sorted_by(name, names, number)
        return _from(query, conditions, by, number), by
    section, place = place_of(name)
    by = [at(kind, part.c.content, place) for kind in (sorted_at, text_sorted_at)]
    return _from(query, conditions, [], number, (part, part.c.number == sweep.c[f"{section}_part"])), by


def _sorting(by: Sequence[ColumnElement[Any]], order: str, key: ColumnElement[Any]) -> list[ColumnElement[Any]]:
    falls = order.startswith("-")
    return [*((item.desc() if falls else item.asc()).nulls_last() for item in by), key]


def _sorted_by(name: str, names: Names, number: int | None) -> list[ColumnElement[Any]]:
    if name in COLUMNS:
        return [COLUMNS[name]]
    if name == POSITION and number is not None:
        return [seen.c.position]
    if name.startswith(METRIC) and name.removeprefix(METRIC) in names.metrics:
        chosen = (metric.c.key == KEY, metric.c.name == name.removeprefix(METRIC))
        return [select(func.min(metric.c.value)).where(*chosen).scalar_subquery()]
    if name in names.labels:
        return [at(kind, seen.c.labels, [name]) for kind in (sorted_at, text_sorted_at)]
    error = names.unknown(name)
    raise StoreError(str(error).replace("filter:", "order:", 1))


def _from(
    query: Select[Any],
    conditions: Sequence[ColumnElement[bool]],
    others: Sequence[ColumnElement[Any]],
    number: int | None,
    beside: tuple[Any, ColumnElement[bool]] | None = None,
) -> Select[Any]:
    """Return the query on sweeps, joined with the run that saw them where something asks for it."""
    source: Any = sweep
    if number is not None:
        source = seen.join(sweep, sweep.c.key == seen.c.key)
        query = query.where(seen.c.run == number, seen.c.standing != REPEATED)
    elif any(element is seen or getattr(element, "table", None) is seen for element in _inside(conditions, others)):
        source = sweep.outerjoin(seen, and_(seen.c.key == KEY, seen.c.standing == LATEST))
    if beside:
        source = source.outerjoin(*beside)
    return query.select_from(source).where(*conditions)


def _inside(*groups: Sequence[ColumnElement[Any]]) -> Any:
    return (element for group in groups for item in group for element in iterate(item))


def _rows(connection: Connection, wanted: Sequence[str], number: int | None) -> tuple[Listed, ...]:
    columns = [COLUMNS[name].label(name) for name in SHOWN]
    query = select(*columns, seen.c.labels)
    found: dict[str, Mapping[Any, Any]] = {}
    for chunk in chunks(wanted):
        asked = _from(query, [KEY.in_(chunk)], [seen.c.run], number)
        found |= {row["key"]: row for row in connection.execute(asked).mappings()}
    tags, notes = annotations.tags_of(connection, wanted), annotations.notes(connection, wanted)
    return tuple(_listed(found[key], tags.get(key, ()), notes.get(key, "")) for key in wanted)


def _listed(row: Mapping[Any, Any], tags: tuple[str, ...], text: str) -> Listed:
    values: dict[str, Any] = {name: row[name] for name in SHOWN if name != "outcome"}
    outcome = Outcome[row["outcome"]] if row["outcome"] else None
    return sound(Listed(**values, outcome=outcome, labels=row["labels"] or {}, tags=tags, note=text))
