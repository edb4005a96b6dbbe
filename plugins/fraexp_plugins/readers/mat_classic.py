"""MATLAB files of version 4 to 7: which variables there are, how large, and the way into structs and cells."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.readers.mat_elements import matrix
from fraexp_plugins.readers.measured import LARGEST, check_size, missing_column

COMPRESSED, MATRIX, INT8 = 15, 14, 1
"""Types of a data element (MAT-File Format, MathWorks, table 1-1)."""
OPAQUE = 17
"""Class of MATLAB's own objects, whose header is undocumented."""
HEADER = 128
"""Length of the file's header [bytes]."""
CHUNK = 1 << 20
"""Bytes that are inflated at a time."""
PEEK = 1024
"""Bytes of a variable within which its name is."""
DEEPEST = 6


def read_columns(path: Path, columns: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the named columns as they stand in the file; RecordError names what exists if one is missing."""
    content, sizes = _loaded(path, {column.split(".")[0] for column in columns})
    return {column: _follow(path, column, content, sizes) for column in columns}


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the sides of every array of numbers in the file."""
    content, sizes = _loaded(path, None)
    leaves = [leaf for top in sizes if top in content for leaf in _leaves(content[top], top)]
    return {leaf: _follow(path, leaf, content, sizes).shape for leaf in leaves}


def _loaded(path: Path, tops: set[str] | None) -> tuple[Mapping[str, Any], dict[str, int]]:
    """Return the variables of these names, or all, and the decoded sizes of all [bytes]."""
    try:
        found, order = _variables(path)
        sizes = {name: variable.size for name, variable in found.items()}
        wanted = [name for name in found if tops is None or name in tops]
        for top in wanted:
            check_size(path, f"variable '{top}'", sizes[top])
        check_size(path, "what is read of it", sum(sizes[top] for top in wanted))
        if order is None:
            return _version_4(path, wanted), sizes
        with path.open("rb") as stream:
            return {name: matrix(_content(stream, found[name]), order) for name in wanted}, sizes
    except RecordError:
        raise
    except Exception as error:  # a damaged file makes its parts anything
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as a MATLAB file: {text}; save it again") from None


@dataclass(frozen=True)
class _Variable:
    """Where a variable is in the file."""

    size: int
    """Decoded [bytes]."""
    start: int = 0
    length: int = 0
    compressed: bool = False


def _version_4(path: Path, wanted: Sequence[str]) -> dict[str, Any]:
    import scipy.io

    content: dict[str, Any] = scipy.io.loadmat(path, variable_names=list(wanted))
    return content


def _variables(path: Path) -> tuple[dict[str, _Variable], str | None]:
    """Return each variable, from the headers alone, and the byte order; None for version 4."""
    import scipy.io.matlab

    end = path.stat().st_size
    major, _ = scipy.io.matlab.matfile_version(path)
    if major == 0:  # version 4 is not compressed: nothing in it is larger than the file
        check_size(path, "the file", end)
        for name, sides, _ in (found := scipy.io.whosmat(path)):
            if min(sides) < 0 or prod(sides) > end:
                raise ValueError(f"'{name}' has the sides {sides}")
        return {name: _Variable(0) for name, _, _ in found}, None
    with path.open("rb") as stream:
        head = stream.read(HEADER)
        order = "<" if head[126:128] == b"IM" else ">"
        return {name: variable for name, variable in _elements(stream, order, end) if name}, order


def _elements(stream: BinaryIO, order: str, end: int) -> Iterator[tuple[str, _Variable]]:
    while stream.tell() + 8 <= end:
        kind, size = struct.unpack(f"{order}II", stream.read(8))
        start = stream.tell()
        if start + size > end:
            raise ValueError("the file ends within a variable")
        body = stream.read(min(size, PEEK))
        if compressed := kind == COMPRESSED:
            inner = zlib.decompressobj().decompress(body, PEEK)
            kind, _ = struct.unpack(f"{order}II", inner[:8])
            body = inner[8:]
        if kind == MATRIX:
            decoded = size
            if compressed:  # what it says of its size need not be true
                stream.seek(start)
                decoded = sum(map(len, _inflated(stream, size)))
            yield _name(body, order), _Variable(decoded, start, size, compressed)
        stream.seek(start + size)


def _inflated(stream: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield what the next `size` bytes inflate to, piece by piece, up to somewhat more than `LARGEST`."""
    inflater, total = zlib.decompressobj(), 0
    while size and not inflater.eof:
        packed = stream.read(min(size, CHUNK))
        size -= len(packed)
        while packed and total <= LARGEST:
            piece = inflater.decompress(packed, CHUNK)
            total += len(piece)
            yield piece
            packed = inflater.unconsumed_tail
        if total > LARGEST:
            return
    if not inflater.eof:
        raise ValueError("a compressed variable is cut off")


def _content(stream: BinaryIO, variable: _Variable) -> memoryview:
    """Return the body of a variable's MATRIX element."""
    stream.seek(variable.start)
    if not variable.compressed:
        return memoryview(stream.read(variable.length))
    return memoryview(b"".join(_inflated(stream, variable.length)))[8:]


def _name(body: bytes, order: str) -> str:
    if struct.unpack_from(f"{order}I", body, 8)[0] & 0xFF == OPAQUE:
        return ""
    at = 16  # array flags come first, of fixed length; then dimensions, then the name
    _, size = struct.unpack_from(f"{order}II", body, at)
    at += 8 + (size + 7) // 8 * 8
    kind, size = struct.unpack_from(f"{order}II", body, at)
    if kind >> 16:  # a short element: length and type share four bytes
        return body[at + 4 : at + 4 + (kind >> 16)].decode("latin-1")
    return body[at + 8 : at + 8 + size].decode("latin-1") if kind == INT8 else ""


def _follow(path: Path, column: str, content: Mapping[str, Any], known: Mapping[str, int]) -> np.ndarray:
    top, *parts = column.split(".")
    if top not in content:
        raise missing_column(path, column, known)
    value, place = content[top], top
    for part in parts:
        value = _item(value, part) if part.isdigit() else _field(value, part)
        place = f"{place}.{part}"
        if value is None:
            raise missing_column(path, column, _leaves(content[top], top))
    if value.dtype.names or value.dtype == object:
        leaves = ", ".join(_leaves(value, place)) or "nothing that can be read"
        raise RecordError(f"{path.name}: '{column}' is a struct, cell or object, not numbers; it holds {leaves}")
    return np.asarray(value)


def _field(value: np.ndarray, name: str) -> Any:
    if value.dtype.names and name in value.dtype.names and value.size == 1:
        return _array(value[name].flat[0])
    return None


def _item(value: np.ndarray, number: str) -> Any:
    place = int(number) - 1
    if value.dtype.names or value.dtype == object:
        if not 0 <= place < value.size:
            return None
        element = value.ravel(order="F")[place : place + 1]
        return element if value.dtype.names else _array(element[0])
    upright = value if value.ndim == 2 and value.shape[0] >= value.shape[1] else value.T
    return upright[:, place] if upright.ndim == 2 and 0 <= place < upright.shape[1] else None


def _array(value: Any) -> np.ndarray:
    return value if isinstance(value, np.ndarray) else np.asarray(value, dtype=object)


def _leaves(value: Any, place: str, depth: int = 0) -> list[str]:
    """Return the paths of the arrays of numbers below a value."""
    if not isinstance(value, np.ndarray) or depth > DEEPEST:
        return []
    if value.dtype.names and value.size == 1:
        parts = [(name, value[name].flat[0]) for name in value.dtype.names]
    elif value.dtype.names or value.dtype == object:
        parts = [(str(number + 1), _item(value, str(number + 1))) for number in range(min(value.size, DEEPEST))]
    else:
        return [place] if value.dtype.kind in "biuf" and value.size else []
    return [leaf for name, part in parts for leaf in _leaves(part, f"{place}.{name}", depth + 1)]
