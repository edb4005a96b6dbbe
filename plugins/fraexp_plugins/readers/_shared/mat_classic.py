"""MATLAB files of version 4 to 7: their variables with sizes, and the paths into structs and cells."""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.mat_arrays import COMPLEX_PARTS
from fraexp_plugins.readers._shared.mat_elements import read_matrix
from fraexp_plugins.readers._shared.record_checks import MAX_SIZE_BYTES, check_size, missing_column

COMPRESSED, MATRIX, INT8 = 15, 14, 1
"""Types of a data element (MAT-File Format, MathWorks, table 1-1)."""
OPAQUE = 17
"""Class of MATLAB's own objects, whose header is undocumented."""
HEADER_BYTES = 128
"""Length of the file's header."""
CHUNK_BYTES = 1 << 20
"""Bytes that are inflated at a time."""
NAME_PEEK_BYTES = 1024
"""Bytes at the beginning of a variable that contain its name."""
MAX_DEPTH = 6
"""Levels of structs and cells, and elements of each, that are searched for names."""


def read_columns(path: Path, columns: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Return the named columns as stored in the file; RecordError lists the columns if one is missing."""
    content, sizes = _load(path, {column.split(".")[0] for column in columns})
    return {column: _array_at(path, column, content, sizes) for column in columns}


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every numeric array in the file, by name; (0,) for a variable that cannot be read.

    RecordError if none can be read.
    """
    found: dict[str, tuple[int, ...]] = {}
    faults: list[RecordError] = []
    for top in _load(path, set())[1]:
        try:
            content, sizes = _load(path, {top})
            found |= {leaf: _array_at(path, leaf, content, sizes).shape for leaf in _leaves(content[top], top)}
        except RecordError as fault:  # such as one with an object of MATLAB's own in it
            faults.append(fault)
            found[top] = (0,)
    if faults and all(shape == (0,) for shape in found.values()):
        raise faults[0]
    return found


def _load(path: Path, tops: set[str] | None) -> tuple[Mapping[str, Any], dict[str, int]]:
    """Return the variables of these names, or all if None, and the decoded sizes of all variables [bytes]."""
    try:
        variables, order = _variables(path)
        sizes = {name: variable.size for name, variable in variables.items()}
        wanted = [name for name in variables if tops is None or name in tops]
        for top in wanted:
            check_size(path, f"variable '{top}'", sizes[top])
        check_size(path, "all that is read of it", sum(sizes[top] for top in wanted))
        if order is None:
            return _load_version_4(path, wanted), sizes
        with path.open("rb") as stream:
            return {name: read_matrix(_content(stream, variables[name]), order) for name in wanted}, sizes
    except RecordError:
        raise
    except Exception as error:  # parsing a damaged file may raise anything
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as a MATLAB file: {text}; save it again") from None


@dataclass(frozen=True)
class _Variable:
    """Place of a variable in the file."""

    size: int
    """Decoded size [bytes]."""
    start: int = 0
    length: int = 0
    compressed: bool = False


def _load_version_4(path: Path, wanted: Sequence[str]) -> dict[str, Any]:
    import scipy.io

    content: dict[str, Any] = scipy.io.loadmat(path, variable_names=list(wanted))
    return content


def _variables(path: Path) -> tuple[dict[str, _Variable], str | None]:
    """Return each variable, read from the headers alone, and the byte order: None for version 4."""
    import scipy.io.matlab

    end = path.stat().st_size
    major, _ = scipy.io.matlab.matfile_version(path)
    if major == 0:  # version 4 is not compressed: nothing in it is larger than the file
        check_size(path, "the file", end)
        for name, shape, _ in (listed := scipy.io.whosmat(path)):
            if min(shape) < 0 or prod(shape) > end:
                raise ValueError(f"'{name}' has the shape {shape}")
        return {name: _Variable(0) for name, _, _ in listed}, None
    with path.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
        order = "<" if head[126:128] == b"IM" else ">"
        return {name: variable for name, variable in _elements(stream, order, end) if name}, order


def _elements(stream: BinaryIO, order: str, end: int) -> Iterator[tuple[str, _Variable]]:
    while stream.tell() + 8 <= end:
        kind, size = struct.unpack(f"{order}II", stream.read(8))
        start = stream.tell()
        if start + size > end:
            raise ValueError("the file ends within a variable")
        body = stream.read(min(size, NAME_PEEK_BYTES))
        if compressed := kind == COMPRESSED:
            inner = zlib.decompressobj().decompress(body, NAME_PEEK_BYTES)
            kind, _ = struct.unpack(f"{order}II", inner[:8])
            body = inner[8:]
        if kind == MATRIX:
            decoded = size
            if compressed:  # the size in its header need not be true
                stream.seek(start)
                decoded = sum(map(len, _inflate(stream, size)))
            yield _name(body, order), _Variable(decoded, start, size, compressed)
        stream.seek(start + size)


def _inflate(stream: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield the inflated content of the next `size` bytes, in pieces, up to somewhat more than `MAX_SIZE_BYTES`."""
    inflater, total = zlib.decompressobj(), 0
    while size and not inflater.eof:
        packed = stream.read(min(size, CHUNK_BYTES))
        size -= len(packed)
        while packed and total <= MAX_SIZE_BYTES:
            piece = inflater.decompress(packed, CHUNK_BYTES)
            total += len(piece)
            yield piece
            packed = inflater.unconsumed_tail
        if total > MAX_SIZE_BYTES:
            return
    if not inflater.eof:
        raise ValueError("a compressed variable is cut off")


def _content(stream: BinaryIO, variable: _Variable) -> memoryview:
    """Return the body of a variable's MATRIX element."""
    stream.seek(variable.start)
    if not variable.compressed:
        return memoryview(stream.read(variable.length))
    return memoryview(b"".join(_inflate(stream, variable.length)))[8:]


def _name(body: bytes, order: str) -> str:
    if struct.unpack_from(f"{order}I", body, 8)[0] & 0xFF == OPAQUE:
        return ""
    offset = 16  # array flags come first, of fixed length; then dimensions, then the name
    _, size = struct.unpack_from(f"{order}II", body, offset)
    offset += 8 + (size + 7) // 8 * 8
    kind, size = struct.unpack_from(f"{order}II", body, offset)
    if kind >> 16:  # a short element: length and type share four bytes
        return body[offset + 4 : offset + 4 + (kind >> 16)].decode("latin-1")
    return body[offset + 8 : offset + 8 + size].decode("latin-1") if kind == INT8 else ""


def _array_at(path: Path, column: str, content: Mapping[str, Any], sizes: Mapping[str, int]) -> NDArray[np.generic]:
    top, *parts = column.split(".")
    if top not in content:
        raise missing_column(path, column, sizes)
    value, parent = content[top], top
    for part in parts:
        value = _item(value, part) if part.isdigit() else _field(value, part)
        parent = f"{parent}.{part}"
        if value is None:
            raise missing_column(path, column, _leaves(content[top], top))
    if value.dtype.names or value.dtype == object:
        leaves = ", ".join(_leaves(value, parent)) or "nothing readable"
        raise RecordError(f"{path.name}: '{column}' is a struct, cell or object, not numbers; it holds {leaves}")
    return np.asarray(value)


def _field(value: NDArray[np.void], name: str) -> Any:
    if np.iscomplexobj(value) and name in COMPLEX_PARTS:
        return value.real if name == COMPLEX_PARTS[0] else value.imag
    if value.dtype.names and name in value.dtype.names and value.size == 1:
        return _as_array(value[name].flat[0])
    return None


def _item(value: NDArray[np.generic], number: str) -> Any:
    index = int(number) - 1
    if value.dtype.names or value.dtype == object:
        if not 0 <= index < value.size:
            return None
        element = value.ravel(order="F")[index : index + 1]
        return element if value.dtype.names else _as_array(element[0])
    upright = value if value.ndim == 2 and value.shape[0] >= value.shape[1] else value.T
    return upright[:, index] if upright.ndim == 2 and 0 <= index < upright.shape[1] else None


def _as_array(value: Any) -> NDArray[np.generic]:
    return value if isinstance(value, np.ndarray) else np.asarray(value, dtype=object)


def _leaves(value: object, parent: str, depth: int = 0) -> list[str]:
    """Return the paths of the numeric arrays below a value."""
    if not isinstance(value, np.ndarray) or depth > MAX_DEPTH:
        return []
    if value.dtype.names and value.size == 1:
        parts = [(name, value[name].flat[0]) for name in value.dtype.names]
    elif value.dtype.names or value.dtype == object:
        parts = [(str(number + 1), _item(value, str(number + 1))) for number in range(min(value.size, MAX_DEPTH))]
    else:
        if np.iscomplexobj(value) and value.size:
            return [f"{parent}.{part}" for part in COMPLEX_PARTS]
        return [parent] if value.dtype.kind in "biuf" and value.size else []
    return [leaf for name, part in parts for leaf in _leaves(part, f"{parent}.{name}", depth + 1)]
