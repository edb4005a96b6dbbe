"""Whether what is stored is what fraexp writes: looked at in bulk, by first bytes and names; nothing is decoded."""

from sqlalchemy import ColumnElement, Connection, LargeBinary, Select, Table, bindparam, func, literal, or_, select

from fraexp.data.results import Outcome
from fraexp.store.codec import HEADER, MAGIC, SIDES
from fraexp.store.tables import RESULT_TABLES, sweep
from fraexp.store.validation import Bytes


def finding(connection: Connection) -> str:
    """Return what is wrong with the first sweep that has something wrong; nothing if all is well."""
    return _odd_array(connection) or _odd_outcome(connection)


def _odd_array(connection: Connection) -> str:
    first, *others = (_without_arrays(table) for table in RESULT_TABLES if _arrays(table))
    odd = connection.execute(first.union_all(*others).limit(1)).first()
    return f"sweep {odd.key[4:12]}: its {odd.what.replace('_', ' ')} has an array that is none" if odd else ""


def _odd_outcome(connection: Connection) -> str:
    unknown = sweep.c.outcome.not_in([outcome.name for outcome in Outcome])
    odd = connection.execute(select(sweep.c.key, sweep.c.outcome).where(unknown).limit(1)).first()
    return f"sweep {odd.key[4:12]}: it has an unknown outcome '{odd.outcome}'" if odd else ""


def _arrays(table: Table) -> list[ColumnElement[bytes]]:
    return [column for column in table.columns if isinstance(column.type, Bytes)]


def _without_arrays(table: Table) -> Select[tuple[str, str]]:
    """Return the query for sweeps with something in this table that does not begin as arrays do."""
    unlike = or_(*(_unlike(column) for column in _arrays(table)))
    return select(table.c.key, literal(table.name).label("what")).where(unlike)


def _unlike(column: ColumnElement[bytes]) -> ColumnElement[bool]:
    # SQLite reads the whole array to give its first bytes, but tells its length without: the longest must do with that.
    if column.key in SIDES:
        return func.length(column) <= HEADER
    return func.substr(column, 1, len(MAGIC), type_=LargeBinary) != bindparam(None, MAGIC, LargeBinary)
