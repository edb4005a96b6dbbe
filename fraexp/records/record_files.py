"""Files of records: what reads them, their contents, and several that are read as one."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.components.kinds import RecordReader
from fraexp.components.registry import Registry, create
from fraexp.data.signals import RecordTable
from fraexp.errors import RecordError, did_you_mean
from fraexp.records.channels import UNREADABLE, FileContent, clock_unit, guess_role, resolve_channel
from fraexp.records.timebase import ColumnReader, find_time_column

MAX_VALUE = 1e100
"""Magnitude of a sample from which a file is damaged: its square could not be computed."""
LFS_POINTER = b"version https://git-lfs.github.com/spec/"
"""How a file begins in whose place Git LFS keeps the data."""
FILE_SIGN = ":"
"""Separates the name of the file from that of the column, where several files have a column of that name."""
ContentLister = Callable[[Path], Mapping[str, tuple[tuple[int, ...], str]]]
"""Signature of a reader's optional `contents`: shape and unit of each variable of a file, by name."""


def existing_file(path: Path) -> Path:
    """Return the full path of a file; if it is missing, RecordError names the most similar one."""
    try:
        if path.is_file():
            _refuse_pointer(path)
            return path.resolve()
        if path.is_dir():
            raise RecordError(f"{path}: is a folder; expected a file")
        if not path.parent.is_dir():
            raise RecordError(f"{path}: there is no folder '{path.parent}'; correct record.file")
    except OSError as error:  # such as a name that is too long
        raise RecordError(f"record.file: {error.strerror}; expected the name of a file") from None
    others = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix]
    raise RecordError(f"{path}: there is no such file{did_you_mean(path.name, others)}")


def _refuse_pointer(path: Path) -> None:
    """Raise RecordError if a file only stands for the one that Git LFS keeps elsewhere."""
    with path.open("rb") as file:
        if file.read(len(LFS_POINTER)) == LFS_POINTER:
            raise RecordError(f"{path.name}: this is a pointer of Git LFS and not the data; fetch them: git lfs pull")


def find_reader(name: str, path: Path, registry: Registry) -> RecordReader:
    """Return the reader with a name, or if the name is empty the one for the suffix of the file."""
    fitting = [
        known
        for known in registry.names(RecordReader.kind)
        if path.suffix.lower() in getattr(registry.provider(RecordReader.kind, known).component, "suffixes", ())
    ]
    if not name and len(fitting) > 1:
        readers = {known: create(registry, RecordReader, {"name": known}, place=path.name) for known in fitting}
        fitting = [known for known in fitting if readers[known].recognises(path)] or [
            known for known in fitting if type(readers[known]).recognises is RecordReader.recognises
        ]
    if not name and len(fitting) != 1:
        which = f"readers {', '.join(fitting)} all read" if fitting else "no reader reads"
        ending = f"{which} '{path.suffix}'" if path.suffix else "its name has no ending that tells its format"
        known = ", ".join(registry.names(RecordReader.kind))
        raise RecordError(
            f"{path.name}: {ending}; give reader = one of {known}; rename it to .csv if it is text in columns, or "
            "export it as CSV"
        )
    return create(registry, RecordReader, {"name": name or fitting[0]}, place=path.name)


def read_columns(reader: ColumnReader, path: Path, columns: set[str]) -> RecordTable:
    """Return columns of a file; RecordError if their lengths differ, or they hold no plausible numbers."""
    try:
        table = reader.read(path, sorted(columns))
    except RecordError:
        held = _unreadable(reader, path)
        for name in sorted(columns & held.keys()):
            words = "expected numbers: save arrays, or choose another column"
            raise RecordError(f"{path.name}: '{name}' contains {held[name]}; {words}") from None
        raise
    lengths = {name: samples.size for name, samples in table.columns.items()}
    if len(set(lengths.values())) > 1 and not table.times:
        text = ", ".join(f"'{name}' {length}" for name, length in lengths.items())
        raise RecordError(
            f"{path.name}: the columns have different numbers of samples ({text}); expected equal ones: "
            "choose channels of one sample rate, or delete a last line that was cut off"
        )
    for name, samples in table.columns.items():
        bad = np.flatnonzero(~(np.abs(samples) < MAX_VALUE))
        if bad.size:
            raise RecordError(
                f"{path.name}: {bad.size} of {samples.size} samples in '{name}' are not finite numbers "
                f"below {MAX_VALUE:g}, the first is sample {bad[0] + 1}; mend or cut them out"
            )
    return table


class _JoinedFiles:
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
                units[column] = table.units.get(name, "")
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


def joined_reader(paths: Sequence[Path], first: RecordReader, registry: Registry) -> ColumnReader:
    """Return the reader of a file, or one for all files that are joined."""
    if len(paths) == 1:
        return first
    return _JoinedFiles(paths, [first, *(find_reader("", path, registry) for path in paths[1:])])


def list_contents(file: Path, registry: Registry) -> list[FileContent]:
    """Return the variables of a file; RecordError if its reader cannot list them, or it has none."""
    path = existing_file(file)
    found = find_reader("", path, registry)
    listing: ContentLister | None = getattr(found, "contents", None)
    if listing is None:
        raise RecordError(f"{path.name}: reader '{found.name}' cannot list a file; give --channel NAME=COLUMN")
    contents = []
    for name, (shape, unit) in listing(path).items():
        role = guess_role(name, unit, shape)
        contents.append(FileContent(name, shape, unit, role.name, role.score))
    for name, kind in _unreadable(found, path).items():
        contents.append(FileContent(name, (0,), "", f"{UNREADABLE}: {kind}"))
    if not contents:
        raise RecordError(f"{path.name}: nothing in the file can be read; expected columns or variables of numbers")
    return contents


def _unreadable(reader: ColumnReader, path: Path) -> Mapping[str, str]:
    """Return what the variables of a file contain that cannot be read, by name."""
    listing: Callable[[Path], Mapping[str, str]] | None = getattr(reader, "unreadable", None)
    return listing(path) if listing else {}


def list_remarks(file: Path, registry: Registry) -> list[str]:
    """Return in sentences what the reader of a file cannot know from it."""
    path = existing_file(file)
    remarks: Callable[[Path], list[str]] | None = getattr(find_reader("", path, registry), "remarks", None)
    return remarks(path) if remarks else []
