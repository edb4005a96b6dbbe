"""MATLAB files of version 4 to 7: which variables there are, how large, and the way into structs and cells."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fraexp.api import RecordError
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
    import scipy.io

    try:
        sizes = _variables(path)
        wanted = sizes.keys() if tops is None else tops
        for top in wanted & sizes.keys():
            check_size(path, f"variable '{top}'", sizes[top])
        check_size(path, "what is read of it", sum(sizes[top] for top in wanted & sizes.keys()))
        return scipy.io.loadmat(path, variable_names=list(wanted), verify_compressed_data_integrity=True), sizes
    except RecordError:
        raise
    except Exception as error:  # a damaged file makes scipy raise almost anything
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as a MATLAB file: {text}; save it again") from None


def _variables(path: Path) -> dict[str, int]:
    """Return name and decoded size [bytes] of each variable, from the headers alone."""
    import scipy.io.matlab

    major, _ = scipy.io.matlab.matfile_version(path)
    if major == 0:  # version 4 is not compressed: nothing in it is larger than the file
        check_size(path, "the file", path.stat().st_size)
        return {name: 0 for name, _, _ in scipy.io.whosmat(path)}
    with path.open("rb") as stream:
        head = stream.read(HEADER)
        order = "<" if head[126:128] == b"IM" else ">"
        return {name: size for name, size in _elements(stream, order, path.stat().st_size) if name}


def _elements(stream: BinaryIO, order: str, end: int) -> Iterator[tuple[str, int]]:
    while stream.tell() + 8 <= end:
        kind, size = struct.unpack(f"{order}II", stream.read(8))
        after = stream.tell() + size
        body = stream.read(min(size, PEEK))
        if kind == COMPRESSED:
            inner = zlib.decompressobj().decompress(body, PEEK)
            kind, _ = struct.unpack(f"{order}II", inner[:8])
            stream.seek(after - size)
            size = _inflated(stream, size)  # what it says of itself need not be true
            body = inner[8:]
        if kind == MATRIX:
            yield _name(body, order), size
        stream.seek(after)


def _inflated(stream: BinaryIO, size: int) -> int:
    """Return to how many bytes the next `size` bytes inflate; somewhat more than `LARGEST` if to more than that."""
    inflater, total, left = zlib.decompressobj(), 0, size
    while left and total <= LARGEST:
        piece = stream.read(min(left, CHUNK))
        if not piece:
            break
        left -= len(piece)
        while piece and total <= LARGEST:
            total += len(inflater.decompress(piece, CHUNK))
            piece = inflater.unconsumed_tail
    return total


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
