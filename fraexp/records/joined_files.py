"""Several files whose columns are channels of one record, read as if they were one file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import RecordReader
from fraexp.data.record_table import RecordTable
from fraexp.errors import RecordError, did_you_mean
from fraexp.records.clocks import find_time_column
from fraexp.records.quantities import clock_unit, resolve_channel

FILE_SIGN = ":"
"""Separates the name of the file from that of the column, where several files have a column of that name."""


class JoinedFiles:
    """Readers of several files, which answer as one reader: a column is ``name``, or ``file.csv:name``."""

    def __init__(self, paths: Sequence[Path], readers: Sequence[RecordReader]) -> None:
        """Keep the files with their readers, and look up the columns that the readers can list."""
        self._files = dict(zip(paths, readers, strict=True))
        self._names = {path: _column_names(reader, path) for path, reader in self._files.items()}

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        """Return the columns with the time stamps of the file that each is in; `path` is that of the first file."""
        owners = {column: self._owner(path, column) for column in columns}
        values: dict[str, NDArray[np.float64]] = {}
        units: dict[str, str] = {}
        times: dict[str, NDArray[np.float64]] = {}
        for file, reader in self._files.items():
            own = {column: name for column, (of, name) in owners.items() if of == file}
            if not own:
                continue
            table = reader.read(file, sorted(set(own.values())))
            stamps = _file_times(reader, table, file)
            for column, name in own.items():
                values[column] = table.columns[name]
                units |= {column: table.units[name]} if table.units.get(name) else {}
                times |= {column: stamps[name]} if name in stamps else {}
        return RecordTable(values, None, units, times if len(times) == len(values) else {})

    def _owner(self, path: Path, column: str) -> tuple[Path, str]:
        """Return file and name of a column."""
        prefix, sign, name = column.partition(FILE_SIGN)
        named = [file for file in self._files if prefix in (file.name, file.stem)] if sign else []
        if len(named) == 1:
            return named[0], name
        owners = [file for file, names in self._names.items() if column in names]
        if len(owners) > 1:
            raise RecordError(
                f"{owners[0].name} and {owners[1].name} both have a column '{column}'; give "
                f"'{owners[0].name}{FILE_SIGN}{column}' or '{owners[1].name}{FILE_SIGN}{column}'"
            )
        if not owners:
            known = [name for names in self._names.values() for name in names]
            raise RecordError(f"{path.name} and others: no column is called '{column}'{did_you_mean(column, known)}")
        return owners[0], column


def _column_names(reader: RecordReader, path: Path) -> set[str]:
    listing = getattr(reader, "contents", None)
    return set(listing(path)) if listing else set()


def _file_times(reader: RecordReader, table: RecordTable, path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the time stamps [s] of the columns of one file, if it has a clock."""
    if table.times:
        return dict(table.times)
    column = find_time_column(reader, table, path)
    if column is not None:
        stamps = reader.read(path, [column.column])
        scale = resolve_channel("time", column, stamps, path, clock_unit(column.column, stamps.columns[column.column]))[
            "scale"
        ]
        return dict.fromkeys(table.columns, stamps.columns[column.column] * scale)
    if table.sample_time:
        return {name: np.arange(values.size, dtype=float) * table.sample_time for name, values in table.columns.items()}
    return {}
