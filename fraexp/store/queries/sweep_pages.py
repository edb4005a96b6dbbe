"""Pages of a listing of sweeps, which the database filters and sorts."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime

from sqlalchemy import ColumnElement, Connection, FromClause, Table, and_, func, or_, select
from sqlalchemy.sql.visitors import iterate

from fraexp.errors import StoreError
from fraexp.store.damage import RESTORE_HINT
from fraexp.store.queries import reading
from fraexp.store.queries.filter_sql import SWEEP_COLUMNS, SWEEP_KEY, condition_sql, run_view, split_parameter
from fraexp.store.queries.filters import parse_filter
from fraexp.store.queries.known_names import METRIC_PREFIX, KnownNames, UnitDeclarations, no_declared_units
from fraexp.store.stored_records import ListingPage
from fraexp.store.tables import STANDING_LATEST, STANDING_REPEATED, Expression, Query, metric, part, sweep

POSITION_ORDER, NEWEST_ORDER = "position", "-created"
"""Default orders: of a run's sweeps, and of all sweeps."""
INDEXES_CHECKED = "indexes checked"
"""What is noted of a connection whose indexes have all sweeps."""
OLDEST = datetime(1, 1, 2, tzinfo=UTC)
"""Before all moments, in any time zone."""


def read_page(
    connection: Connection,
    filter_text: str,
    order: str,
    offset: int,
    limit: int,
    number: int | None,
    declared: UnitDeclarations = no_declared_units,
) -> ListingPage:
    """Return a page of a listing, with the total number of rows."""
    if number is None:
        _check_indexes(connection)
    names = KnownNames.of(connection, declared)
    order = order or (NEWEST_ORDER if number is None else POSITION_ORDER)
    conditions = _filter_conditions(filter_text, names, number)
    query, by = _sorted_query(conditions, order, names, number)
    start, size = max(offset, 0), max(limit, 0)
    if conditions:  # the matching sweeps are found once, counted and sorted
        found = query.add_columns(*(item.label(f"by{index}") for index, item in enumerate(by))).cte("found")
        by = [found.c[f"by{index}"] for index in range(len(by))]
        count = select(func.count()).select_from(found)
        cut = select(found.c.key, count.scalar_subquery()).order_by(*_order_clauses(by, order, found.c.key))
        rows = connection.execute(cut.offset(start).limit(size)).all()
        total = int((rows[0][1] if rows else connection.scalar(count)) or 0)
        keys = [row[0] for row in rows]
    else:
        total = int(connection.scalar(_joined_query(select(func.count()), [], [], number)) or 0)
        keys = _page_keys(connection, query, by, order, total, start, size)
    expected = min(size, max(total - start, 0))
    if len(keys) != expected or len(set(keys)) != expected:  # an index has lost or doubled some
        raise _damaged_index_error()
    return ListingPage(tuple(reading.read_listed(connection, keys, number)), total)


def _check_indexes(connection: Connection) -> None:
    """Raise StoreError unless each index has all sweeps; a page and its count often come from the same one.

    Counting takes time: it is done at the first listing by a connection to the database.
    """
    if INDEXES_CHECKED in connection.info:
        return
    created, estimator = sweep.c.created, sweep.c.estimator_name
    each_index = (
        sweep.c.key >= "",
        or_(created.is_(None), created >= OLDEST),
        or_(estimator.is_(None), estimator >= ""),
    )
    counts = connection.execute(
        select(*(select(func.count()).select_from(sweep).where(one).scalar_subquery() for one in each_index))
    ).one()
    if len(set(counts)) > 1:
        raise _damaged_index_error()
    connection.info[INDEXES_CHECKED] = True


def _damaged_index_error() -> StoreError:
    return StoreError(f"the database is damaged (an index does not fit its table); {RESTORE_HINT}")


def _page_keys(
    connection: Connection, query: Query, by: Sequence[Expression], order: str,
    total: int, start: int, size: int,
) -> list[str]:  # fmt: skip
    """Return the keys of a page, read from the nearer end, because skipped rows take time."""
    if start <= total // 2:
        return list(connection.scalars(query.order_by(*_order_clauses(by, order, SWEEP_KEY)).offset(start).limit(size)))
    count = min(size, max(total - start, 0))
    turned = [(item.asc() if order.startswith("-") else item.desc()).nulls_first() for item in by]
    found = connection.scalars(query.order_by(*turned, SWEEP_KEY.desc()).offset(total - start - count).limit(count))
    return list(found)[::-1]


def matching_keys(
    connection: Connection, filter_text: str, number: int | None, declared: UnitDeclarations = no_declared_units
) -> list[str]:
    """Return the keys of all sweeps that match a filter: newest first, or in the order of a run."""
    if number is None:
        _check_indexes(connection)
    names = KnownNames.of(connection, declared)
    query, by = _sorted_query(_filter_conditions(filter_text, names, number), "", names, number)
    return list(connection.scalars(query.order_by(*_order_clauses(by, "" if number else NEWEST_ORDER, SWEEP_KEY))))


def field_names(connection: Connection) -> list[str]:
    """Return the names that a filter may use: columns, then parameters, labels and metrics."""
    return KnownNames.of(connection).all()


def _filter_conditions(filter_text: str, names: KnownNames, number: int | None) -> list[ColumnElement[bool]]:
    now = datetime.now().astimezone()
    return [condition_sql(condition, names, now, number) for condition in parse_filter(filter_text)]


def _sorted_query(
    conditions: list[ColumnElement[bool]], order: str, names: KnownNames, number: int | None
) -> tuple[Query, list[Expression]]:
    """Return the query of the keys, and the expressions by which they are sorted."""
    name = names.full_name(order.removeprefix("-")) or ("created" if number is None else POSITION_ORDER)
    query = select(SWEEP_KEY)
    if name not in names.parameters or name in SWEEP_COLUMNS:
        by = _sort_columns(name, names, number)
        return _joined_query(query, conditions, by, number), by
    section, place = split_parameter(name)
    by = names.json.sort_keys(part.c.content, place)
    return _joined_query(query, conditions, [], number, (part, part.c.number == sweep.c[f"{section}_part"])), by


def _order_clauses(by: Sequence[Expression], order: str, key: Expression) -> list[Expression]:
    falls = order.startswith("-")
    return [*((item.desc() if falls else item.asc()).nulls_last() for item in by), key]


def _sort_columns(name: str, names: KnownNames, number: int | None) -> list[Expression]:
    if name in SWEEP_COLUMNS:
        return [SWEEP_COLUMNS[name]]
    if name == POSITION_ORDER and number is not None:
        return [run_view.c.position]
    if name.startswith(METRIC_PREFIX) and name.removeprefix(METRIC_PREFIX) in names.metrics:
        chosen = (metric.c.key == SWEEP_KEY, metric.c.name == name.removeprefix(METRIC_PREFIX))
        return [select(func.min(metric.c.value)).where(*chosen).scalar_subquery()]
    if name in names.labels:
        return names.json.sort_keys(run_view.c.labels, [name])
    raise names.unknown_name_error(name, "order")


def _joined_query(
    query: Query,
    conditions: Sequence[ColumnElement[bool]],
    others: Sequence[Expression],
    number: int | None,
    beside: tuple[Table, ColumnElement[bool]] | None = None,
) -> Query:
    """Return the query on sweeps, joined with their run if an expression uses it."""
    source: FromClause = sweep
    if number is not None:
        source = run_view.join(sweep, sweep.c.key == run_view.c.key)
        query = query.where(run_view.c.run == number, run_view.c.standing != STANDING_REPEATED)
    elif any(
        element is run_view or getattr(element, "table", None) is run_view
        for element in _all_elements(conditions, others)
    ):
        source = sweep.outerjoin(run_view, and_(run_view.c.key == SWEEP_KEY, run_view.c.standing == STANDING_LATEST))
    if beside:
        source = source.outerjoin(*beside)
    return query.select_from(source).where(*conditions)


def _all_elements(*groups: Sequence[Expression]) -> Iterator[object]:
    return (element for group in groups for item in group for element in iterate(item))
