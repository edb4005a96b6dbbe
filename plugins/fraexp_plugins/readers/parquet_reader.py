"""Parquet files, through the package pyarrow."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordReader, RecordTable
from fraexp_plugins.readers._shared.heading_rows import name_and_unit
from fraexp_plugins.readers._shared.record_arrays import (
    NUMERIC_KINDS,
    check_size,
    format_errors,
    load_package,
    pick_columns,
    real_vector,
)

UNIT_KEYS = (b"unit", b"units")
"""Keys of a column's metadata."""


class ParquetReader(RecordReader, name="parquet", version=1):
    """A Parquet file; a column by its name, with or without a unit in it, such as ``force [N]``.

    A unit may also be the metadata ``unit`` of a column. Dates and times become seconds after the first one.
    """

    suffixes = (".parquet", ".pq")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        with format_errors(path, "Parquet"):
            fields = _fields(path)
            names = {column: field.name for column, field in pick_columns(path, columns, fields).items()}
            table = load_package(path, "pyarrow.parquet", "parquet").read_table(path, columns=list(names.values()))
            values = {
                column: real_vector(path, column, _seconds(table[name].to_numpy())) for column, name in names.items()
            }
        return RecordTable(values, None, {name: _unit(field) for name, field in fields.items()})

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every column of numbers, by name."""
        with format_errors(path, "Parquet"):
            rows = load_package(path, "pyarrow.parquet", "parquet").read_metadata(path).num_rows
            return {name: ((rows,), _unit(field)) for name, field in _fields(path).items() if _is_numeric(field)}


def _fields(path: Path) -> dict[str, Any]:
    """Return the columns by their names without units."""
    check_size(path, "the file", path.stat().st_size)
    schema = load_package(path, "pyarrow.parquet", "parquet").read_schema(path)
    return {name_and_unit(field.name)[0]: field for field in schema}


def _unit(field: Any) -> str:
    if "timestamp" in str(field.type):
        return "s"
    for key in UNIT_KEYS:
        if field.metadata and key in field.metadata:
            return str(field.metadata[key].decode("utf-8", "replace"))
    return name_and_unit(field.name)[1] or ""


def _is_numeric(field: Any) -> bool:
    return str(field.type).startswith(("int", "uint", "float", "double", "halffloat", "timestamp", "decimal"))


def _seconds(values: NDArray[Any]) -> NDArray[Any]:
    """Return dates and times as seconds after the first one; other values as they are."""
    if values.dtype.kind != "M":
        return values if values.dtype.kind in NUMERIC_KINDS else np.asarray(values)
    return np.asarray((values - values[0]) / np.timedelta64(1, "s"))
