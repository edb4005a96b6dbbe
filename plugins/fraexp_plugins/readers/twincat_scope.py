"""Text exports of TwinCAT 3 Scope: a block of properties, then columns of times and values side by side."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import check_size, only_one
from fraexp_plugins.readers._shared.text_lines import (
    column_position,
    is_number,
    split_cells,
    text_encoding,
    text_lines,
    unique_names,
)

SAMPLE_TIME_KEY, NAME_KEY, UNIT_KEY = "SampleTime[ms]", "Name", "Unit"
"""Properties that the first cell of a line names."""
DELIMITERS = "\t;,: "
MAX_PROPERTY_LINES = 64
"""Lines among which the properties must be."""
NO_UNIT = "(None)"
END_OF_FILE = "EOF"
BYTE_ORDER_MARKS = b"\xef\xbb\xbf\xff\xfe"
SCALINGS = (("ScaleFactor", "Offset"), ("Unit ScaleFactor", "Unit Offset"))
"""Factor and offset that a channel has, and those of its unit."""
TICK_S, LEAST_TICKS = 1e-7, 1e15
"""Full time stamps count ticks since 1601 [s]; numbers above the least are such."""
MAX_TIME_ERROR = 1e-3
"""Largest deviation of a time step from the stated sample time, relative to it, besides the rounding of its stamps."""


class TwinCatScope(RecordReader, name="twincat_scope", version=1):
    """An export of TwinCAT 3 Scope as text, with any delimiter, with a column of time for each channel or shared ones.

    A channel is asked for by its name; equal names are numbered, ``Position #2``. Channels of one record must have the
    same sample time, unless they are resampled. Units are those that Scope states, as it scales the values. Full time
    stamps are read as well; an export without columns of time has the clock that it states.
    """

    suffixes = (".csv", ".txt", ".tsv")

    def recognises(self, path: Path) -> bool:
        """Say whether the file begins with Scope's properties."""
        with path.open("rb") as stream:
            head = stream.read(1 << 16)
        text = head.replace(b"\0", b"").lstrip(BYTE_ORDER_MARKS + b'"')  # of UTF-16, too
        return text.startswith(NAME_KEY.encode()) and SAMPLE_TIME_KEY.encode() in text

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        export = _read_properties(path)
        positions = [column_position(path, column, export.plain_names, export.names) for column in columns]
        values, stamps = _read_values(path, export, positions)
        sample_time = only_one(export.sample_times[position] for position in positions)
        return RecordTable(
            columns=dict(zip(columns, values, strict=True)),
            sample_time=sample_time,
            times=dict(zip(columns, stamps, strict=True)),
            units={column: export.units[place] for column, place in zip(columns, positions, strict=True)},
        )

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every channel by its name."""
        export = _read_properties(path)
        lengths = [0] * len(export.names)
        for row, (_, cells) in enumerate(_value_rows(path, export), start=1):
            for position in range(min(len(cells), len(lengths))):
                lengths[position] = row if cells[position].strip() else lengths[position]
        found = zip(export.names, lengths, export.units, export.time_positions, strict=True)
        return {name: ((length,), unit) for place, (name, length, unit, time) in enumerate(found) if place != time}

    def remarks(self, path: Path) -> list[str]:
        """Return what the file leaves open: whether the values of a channel with a factor are scaled already.

        Scope exports scaled values unless its option "Scale values before export" is off, which the file does not say.
        """
        export = _read_properties(path)
        return [
            f"Scope states {scaling} for '{name}': its values count as scaled, unless 'Scale values before export' "
            "was off: then write its gain"
            for name, scaling in zip(export.names, export.scalings, strict=True)
            if name and scaling
        ]


@dataclass(frozen=True)
class _Export:
    """Properties of the columns of an export."""

    encoding: str
    delimiter: str
    start: int
    """Lines before the first line of values."""
    plain_names: list[str]
    sample_times: list[float]
    """Sample time of each column [s]."""
    units: list[str]
    time_positions: list[int]
    """Position of each column's time; its own for a column of time."""
    scalings: list[str]
    """Factors and offsets of each column as text; empty if they change nothing."""

    @property
    def names(self) -> list[str]:
        """Names of the columns; equal ones are numbered."""
        return unique_names(self.plain_names)


def _read_properties(path: Path) -> _Export:
    check_size(path, "the file", path.stat().st_size)
    encoding = text_encoding(path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = list(itertools.islice(text_lines(path, stream), MAX_PROPERTY_LINES))
    line = next((line for line in lines if line.strip('"').startswith(SAMPLE_TIME_KEY)), "")
    after = line.strip('"')[len(SAMPLE_TIME_KEY) :].lstrip('"')[:1]
    if not after or after not in DELIMITERS:
        raise RecordError(f"{path.name}: no line '{SAMPLE_TIME_KEY}'; expected an export of TwinCAT Scope as text")
    rows = [split_cells(line, after) for line in lines]
    at = next(number for number, row in enumerate(rows) if row and row[0] == SAMPLE_TIME_KEY)
    name_row = _property_row(path, rows[:at], NAME_KEY, len(rows[at]))
    start = next((at + number for number, row in enumerate(rows[at:]) if not any(row)), None)
    if start is None:
        raise RecordError(f"{path.name}: no empty line ends the properties; expected values below one: export it again")
    times = [number for number, cell in enumerate(name_row) if cell == NAME_KEY]
    properties = {row[0]: row for row in rows[at:start] if row}
    units = [_unit(cell) for cell in properties.get(UNIT_KEY, [])]
    owner = [max(time for time in times if time <= number) for number in range(len(name_row))]
    steps = [_sample_time(path, rows[at], number) for number in range(len(name_row))]
    plain = [cell if number != owner[number] else "" for number, cell in enumerate(name_row)]
    units = (units + [""] * len(plain))[: len(plain)]
    scalings = [_scaling(properties, number) for number in range(len(plain))]
    return _Export(encoding, after, start + 1, plain, steps, units, owner, scalings)


def _property_row(path: Path, rows: Sequence[list[str]], key: str, width: int) -> list[str]:
    """Return the last line above with this key, which must be as wide as the table."""
    found = [row for row in rows if row and row[0] == key]
    if not found or len(found[-1]) != width:
        raise RecordError(
            f"{path.name}: the names of the channels and their sample times do not match "
            f"({len(found[-1]) if found else 0} and {width} columns); export it again, with another delimiter"
        )
    return found[-1]


def _unit(cell: str) -> str:
    """Return the symbol of a unit, such as V of ``V (Voltage)``."""
    return "" if cell in (NO_UNIT, UNIT_KEY) else cell.partition(" (")[0].strip()


def _scaling(properties: Mapping[str, Sequence[str]], position: int) -> str:
    """Return the factors and offsets of a column as text; empty if they change nothing."""
    parts = []
    for keys in SCALINGS:
        cells = [properties[key][position] if position < len(properties.get(key, ())) else key for key in keys]
        if any(
            is_number(cell, True) and _as_float(cell) != neutral for cell, neutral in zip(cells, (1, 0), strict=True)
        ):
            parts += [f"{key} {cell}" for key, cell in zip(keys, cells, strict=True) if cell != key]
    return ", ".join(parts)


def _as_float(cell: str) -> float:
    return float(cell.replace(",", "."))


def _seconds(stamps: Sequence[str]) -> NDArray[np.float64]:
    """Return time stamps [s]: of milliseconds, or of ticks since 1601 as seconds since the first one."""
    if stamps and _as_float(stamps[0]) >= LEAST_TICKS and all(stamp.isdigit() for stamp in stamps):
        first = int(stamps[0])  # a tick is lost in the number as a whole
        return np.array([int(stamp) - first for stamp in stamps], dtype=float) * TICK_S
    return np.array(stamps, dtype=float) * 1e-3


def _sample_time(path: Path, row: Sequence[str], position: int) -> float:
    """Return the sample time [s] of a column; that of the next one for a column of time."""
    cell = row[position] if row[position] != SAMPLE_TIME_KEY else row[min(position + 1, len(row) - 1)]
    value = _as_float(cell) * 1e-3 if is_number(cell, decimal_comma=True) else 0.0
    if not value > 0:
        raise RecordError(f"{path.name}: the sample time of column {position + 1} is '{cell}'; expected milliseconds")
    return value


def _value_rows(path: Path, export: _Export) -> Iterator[tuple[int, list[str]]]:
    with path.open(encoding=export.encoding, errors="replace") as stream:
        for number, line in enumerate(text_lines(path, stream), start=1):
            if number > export.start and line.strip() and line.strip() != END_OF_FILE:
                yield number, split_cells(line, export.delimiter)


def _read_values(
    path: Path, export: _Export, positions: Sequence[int]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return the values of columns, and the time stamps of each [s], which are checked."""
    wanted = sorted({*positions, *(export.time_positions[position] for position in positions)})
    cells: dict[int, list[str]] = {position: [] for position in wanted}
    ended: set[int] = set()
    for number, row in _value_rows(path, export):
        for position in wanted:
            cell = row[position] if position < len(row) else ""
            if not cell:
                ended.add(position)
                continue
            if position in ended:
                raise _cell_error(path, number, export, position, "after an empty cell; expected no gap")
            if not is_number(cell, decimal_comma=True):
                raise _cell_error(path, number, export, position, f"is '{cell}'; expected a number")
            cells[position].append(cell.replace(",", "."))
    for position in positions:
        _check_column(path, export, position, cells)
    stamps = [_stamps(export, position, cells) for position in positions]
    return [np.array(cells[position], dtype=float) for position in positions], stamps


def _stamps(export: _Export, position: int, cells: Mapping[int, Sequence[str]]) -> NDArray[np.float64]:
    """Return the time stamps [s] of a column; those of its sample time in an export without columns of time."""
    stamps = cells[export.time_positions[position]]
    if not any(cells[time] for time in export.time_positions if time in cells):
        return np.arange(len(cells[position]), dtype=np.float64) * export.sample_times[position]
    return _seconds(stamps)


def _cell_error(path: Path, number: int, export: _Export, position: int, finding: str) -> RecordError:
    name = export.names[position]
    where = f"channel '{name}'" if name else "a time"
    return RecordError(f"{path.name}, line {number}: {where} {finding}: export it again")


def _check_column(path: Path, export: _Export, position: int, cells: dict[int, list[str]]) -> None:
    """Raise RecordError unless a channel has a value at each time, and the times are those of its sample time."""
    name, step = export.names[position], export.sample_times[position]
    values, time = cells[position], _stamps(export, position, cells)
    if len(values) != time.size or time.size < 2:
        raise RecordError(
            f"{path.name}: channel '{name}' has {len(values)} values at {time.size} times; expected as many: "
            "export it again"
        )
    stamps = cells[export.time_positions[position]]
    last_digit = 1e-3 * 10.0 ** -max(len(stamp.partition(".")[2]) for stamp in stamps or [""])
    allowed = MAX_TIME_ERROR * step + (last_digit if last_digit < step else 0.0)
    uneven = np.flatnonzero(~(np.abs(np.diff(time) - step) <= allowed))
    if uneven.size:
        raise RecordError(
            f"{path.name}: channel '{name}' steps by {np.diff(time)[uneven[0]]:.6g} s after sample {uneven[0] + 1}, "
            f"but its sample time is {step:.6g} s; export it with double time stamps, or a part without gaps"
        )
