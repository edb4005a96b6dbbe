"""A file of samples that grows while they are recorded: a line of JSON, then rows of float64, little endian.

It is readable at any moment, whatever ends the process that writes it: a row that was not finished is not read. With
NumPy alone: ``np.fromfile(path, "<f8", offset=first_line_length).reshape(-1, columns)``.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.errors import RecordError

FORMAT = "fraexp samples 1"
MAX_HEADER_SIZE = 1 << 20
"""Bytes of the first line: anything longer is another kind of file."""


@dataclass(frozen=True)
class SampleHeader:
    """What the first line of a file of samples says."""

    sample_time: float
    """Sample time [s]."""
    units: Mapping[str, str]
    """Unit of each column by its name, in their order."""

    def as_line(self) -> bytes:
        """Return the first line of the file."""
        content = {"format": FORMAT, "sample_time": self.sample_time, "units": dict(self.units)}
        return json.dumps(content, ensure_ascii=False).encode() + b"\n"


def create_sample_file(path: Path, header: SampleHeader) -> None:
    """Write a file without samples; OSError if it cannot be written."""
    path.write_bytes(header.as_line())


def read_header(path: Path) -> tuple[SampleHeader, int]:
    """Return the header of a file and its length in bytes; RecordError if it is no file of samples."""
    with path.open("rb") as stream:
        line = stream.readline(MAX_HEADER_SIZE)
    try:
        content = json.loads(line)
        if content["format"] != FORMAT:
            raise ValueError
        units = {str(name): str(unit) for name, unit in content["units"].items()}
        return SampleHeader(float(content["sample_time"]), units), len(line)
    except (ValueError, KeyError, TypeError, AttributeError):
        raise RecordError(f"{path.name}: its first line is not that of a file of samples ('{FORMAT}')") from None


def read_samples(path: Path, columns: Sequence[int], header: SampleHeader, length: int) -> NDArray[np.float64]:
    """Return whole rows of some columns, shape (columns, n)."""
    width = len(header.units)
    rows = (path.stat().st_size - length) // (8 * width)
    table = np.memmap(path, "<f8", "r", length, (rows, width)) if rows else np.empty((0, width))
    return np.array([table[:, column] for column in columns], dtype=float)


class SampleWriter:
    """Appends rows to a file of samples; a row that was cut off by the end of an earlier process is removed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.header, length = read_header(path)
        self._width = len(self.header.units)
        self.rows = (path.stat().st_size - length) // (8 * self._width)
        """Whole rows in the file."""
        os.truncate(path, length + 8 * self._width * self.rows)
        self._stream = path.open("ab", buffering=0)

    def last_play(self) -> int:
        """Return what the first column holds in the last row; 0 in a file without rows."""
        header, length = read_header(self._path)
        return int(read_samples(self._path, [0], header, length)[0, -1]) if self.rows else 0

    def append(self, rows: NDArray[np.float64]) -> None:
        """Append rows, shape (n, columns), and hand them to the operating system; OSError if there is no room."""
        self._stream.write(np.ascontiguousarray(rows, "<f8").tobytes())
        self.rows += len(rows)

    def close(self) -> None:
        """Bring all rows to the disk."""
        os.fsync(self._stream.fileno())
        self._stream.close()
