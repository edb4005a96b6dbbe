"""MDF files (ASAM), version 3 and 4, through the package asammdf."""

import traceback
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import (
    NUMERIC_KINDS,
    check_size,
    format_errors,
    load_package,
    pick_columns,
    real_vector,
)
from fraexp_plugins.readers._shared.text_lines import unique_names

MAGIC = b"MDF "
OPEN_STREAMS = ("_tempfile", "_file", "_mapped_file")
"""Attributes of the package's class that hold open files."""


class MdfReader(RecordReader, name="mdf", version=1):
    """An MDF file; a column is a channel by name, and equal names are numbered, ``Torque #2``.

    Each channel keeps the time stamps of its group, and the unit that the file states after conversion.
    """

    suffixes = (".mf4", ".mdf", ".dat")

    def recognises(self, path: Path) -> bool:
        """Say whether the file begins as MDF does: text files end in ``.dat`` as well."""
        with path.open("rb") as stream:
            return stream.read(len(MAGIC)) == MAGIC

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        values, units, times = {}, {}, {}
        with format_errors(path, "MDF"), closing(_open(path)) as file:
            for column, (group, index) in pick_columns(path, columns, dict(_places(file))).items():
                signal = file.get(group=group, index=index)
                values[column] = real_vector(path, column, np.asarray(signal.samples))
                times[column] = np.asarray(signal.timestamps, dtype=float)
                units[column] = str(signal.unit or "")
        return RecordTable(values, None, units, times)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every channel of numbers, by name."""
        found = {}
        with format_errors(path, "MDF"), closing(_open(path)) as file:
            for name, (group, index) in _places(file):
                signal = file.get(group=group, index=index)
                if np.asarray(signal.samples).dtype.kind in NUMERIC_KINDS:
                    found[name] = (np.asarray(signal.samples).shape, str(signal.unit or ""))
        return found


def _open(path: Path) -> Any:
    check_size(path, "the file", path.stat().st_size)
    package = load_package(path, "asammdf", "mdf")
    try:
        return package.MDF(path)
    except Exception as error:
        for frame, _ in traceback.walk_tb(error.__traceback__):
            _close_unfinished(frame.f_locals.get("self"))
        raise RecordError(f"{path.name}: this is damaged, or no MDF file; export it again") from None


def _close_unfinished(file: Any) -> None:
    """Close a file of which the constructor failed: its own finaliser would fail as well, and print a traceback."""
    if hasattr(file, "_from_filelike"):
        file._closed = True
        for stream in (getattr(file, name, None) for name in OPEN_STREAMS):
            if stream is not None:
                stream.close()


def _places(file: Any) -> Iterator[tuple[str, tuple[int, int]]]:
    """Yield name, and number of group and channel, of every channel but the time of each group."""
    masters = set(file.masters_db.items())
    found = [
        (channel.name, (number, index))
        for number, group in enumerate(file.groups)
        for index, channel in enumerate(group.channels)
        if (number, index) not in masters
    ]
    yield from zip(unique_names([name for name, _ in found]), [place for _, place in found], strict=True)
