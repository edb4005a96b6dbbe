"""SQL of values in stored JSON, in the language of each kind of database."""

from collections.abc import Sequence

from sqlalchemy import ColumnElement, Connection, Float, Text, case, cast, func

from fraexp.store.tables import Expression


class JsonSql:
    """SQL of what is at a place in a JSON column: keys and list indices, from outside to inside."""

    def __init__(self, connection: Connection) -> None:
        self._is_sqlite = connection.dialect.name == "sqlite"

    def number(self, column: Expression, place: Sequence[str]) -> ColumnElement[float]:
        """Return the SQL of a number; NULL if something else is there, or nothing."""
        if self._is_sqlite:
            kind, found = (function(column, _path(place)) for function in (func.json_type, func.json_extract))
            return case((kind.in_(("integer", "real")), found))
        kind = func.json_typeof(func.json_extract_path(column, *place))
        return case((kind == "number", cast(self.text(column, place), Float(53))))

    def text(self, column: Expression, place: Sequence[str]) -> ColumnElement[str]:
        """Return the SQL of a value as text, including ``true`` and ``false``; NULL if there is none."""
        if not self._is_sqlite:
            return func.json_extract_path_text(column, *place)
        kind, found = (function(column, _path(place)) for function in (func.json_type, func.json_extract))
        return case((kind.in_(("true", "false")), kind), else_=cast(found, Text))

    def sort_keys(self, column: Expression, place: Sequence[str]) -> list[Expression]:
        """Return the SQL of what sorts by a value: numbers, then texts."""
        if self._is_sqlite:
            return [func.json_extract(column, _path(place))]
        return [self.number(column, place), self.text(column, place)]


def _path(place: Sequence[str]) -> str:
    return "$" + "".join(f"[{part}]" if part.isdecimal() else f'."{part}"' for part in place)
