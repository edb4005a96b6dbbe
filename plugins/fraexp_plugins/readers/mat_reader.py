"""MATLAB files: versions 4 to 7 by their data elements, version 7.3 through h5py.

Files come from strangers. scipy's own reader, and pymatreader with it, trusts the lengths in a file: at 19 of 600
files with random damage it ended the process by a signal. Here every length is checked against the bytes that exist
(MAT-File Format, MathWorks).
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers._shared import mat_hdf5
from fraexp_plugins.readers._shared.record_arrays import (
    COMPLEX_PARTS,
    MAX_SIZE_BYTES,
    check_size,
    matrix_column,
    missing_column,
    read_vectors,
)

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
        everything, order = _variables(path)
        variables = {name: of for name, of in everything.items() if not of.object_class}
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
    object_class: str = ""
    """Class of an object of MATLAB's own, such as timeseries, which is not read."""


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
            name, object_class = _name_and_class(body, order)
            yield name, _Variable(decoded, start, size, compressed, object_class)
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


def _name_and_class(body: bytes, order: str) -> tuple[str, str]:
    """Return the name of a variable, empty if it has none, and the class if it is an object of MATLAB's own."""
    parts = elements(memoryview(body), order)
    is_object = int(np.frombuffer(next(parts)[1], f"{order}u4")[0]) & 0xFF == OPAQUE
    if not is_object:
        next(parts)  # the dimensions
    kind, name = next(parts)
    *_, object_class = (bytes(of) for _, of in islice(parts, 2 * is_object)) if is_object else (b"",)
    return bytes(name).decode("latin-1") * (kind == INT8), object_class.decode("latin-1")


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
    return matrix_column(value, number)


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


STORED_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Number types in the file, by the type of a data element."""
ARRAY_TYPES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Number types of arrays, by array class; the file may store the numbers in a smaller type."""
CELL, STRUCT, CHARACTERS = 1, 2, 4
INT32 = 5
COMPLEX_FLAG = 0x800
MAX_NESTING, MAX_DIMENSIONS = 16, 32
TAG_BYTES = 8
"""Length of an element's tag; elements are padded to a multiple of it."""


def read_matrix(body: memoryview, order: str, depth: int = 0) -> NDArray[np.generic]:
    """Return the array in the body of a MATRIX element; an array that holds None for a class that is not supported.

    A struct array has a field of objects for each field, as in scipy. ValueError or struct.error if it is damaged.
    """
    if not len(body):
        return np.empty((0, 0))
    if depth > MAX_NESTING:
        raise ValueError(f"structs and cells are nested deeper than {MAX_NESTING}")
    parts = elements(body, order)
    flags = int(np.frombuffer(next(parts)[1], f"{order}u4")[0])
    array_class, dimensions = flags & 0xFF, next(parts)
    shape = tuple(np.frombuffer(dimensions[1], f"{order}i4").tolist())
    if dimensions[0] != INT32 or not 2 <= len(shape) <= MAX_DIMENSIONS or min(shape) < 0:
        raise ValueError(f"an array has the shape {shape}")
    next(parts)  # the name
    if array_class in ARRAY_TYPES:
        return _numbers(parts, ARRAY_TYPES[array_class], shape, order, bool(flags & COMPLEX_FLAG))
    if array_class == CHARACTERS:
        return np.array("")
    if array_class in (CELL, STRUCT):
        names = _fields(parts, order) if array_class == STRUCT else []
        return _objects(parts, names, shape, len(body), order, depth)
    return np.array(None, dtype=object)


def elements(body: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element; ValueError if one exceeds what contains it."""
    offset = 0
    while offset + TAG_BYTES <= len(body):
        kind, size = struct.unpack_from(f"{order}II", body, offset)
        start, after = offset + TAG_BYTES, offset + TAG_BYTES + (size + TAG_BYTES - 1) // TAG_BYTES * TAG_BYTES
        if kind >> 16:  # a short one: length and type share four bytes
            kind, size, start, after = kind & 0xFFFF, kind >> 16, offset + TAG_BYTES // 2, offset + TAG_BYTES
        if start + size > len(body) or (start < offset + TAG_BYTES and size > TAG_BYTES // 2):
            raise ValueError("an element is longer than its container")
        yield kind, body[start : start + size]
        offset = after


def _numbers(
    parts: Iterator[tuple[int, memoryview]], dtype: str, shape: tuple[int, ...], order: str, with_imaginary: bool
) -> NDArray[np.generic]:
    parts_read = [
        np.frombuffer(content, f"{order}{STORED_TYPES[kind]}").astype(dtype).reshape(shape, order="F")
        for kind, content in (next(parts) for _ in range(1 + with_imaginary))
    ]
    return parts_read[0] + 1j * parts_read[1] if with_imaginary else parts_read[0]


def _fields(parts: Iterator[tuple[int, memoryview]], order: str) -> list[str]:
    length = int(np.frombuffer(next(parts)[1], f"{order}i4")[0])
    text = bytes(next(parts)[1])
    if not 0 < length <= max(len(text), 1):
        raise ValueError(f"names of fields are {length} characters long")
    names = [
        text[offset : offset + length].partition(b"\0")[0].decode("latin-1") for offset in range(0, len(text), length)
    ]
    if not all(names):
        raise ValueError("a field has no name")
    return names


def _objects(
    parts: Iterator[tuple[int, memoryview]], names: list[str], shape: tuple[int, ...], size: int, order: str, depth: int
) -> NDArray[np.generic]:
    count, width = prod(shape), max(len(names), 1)
    if count * width * TAG_BYTES > size:
        raise ValueError(f"{count} elements do not fit into {size} bytes")
    dtype: Any = [(name, object) for name in names] if names else object
    objects = np.empty(count, dtype=dtype)
    for index in range(count):
        values = []
        for _ in range(width):
            kind, content = next(parts)
            values.append(read_matrix(content, order, depth + 1) if kind == MATRIX else np.array(None, dtype=object))
        objects[index] = tuple(values) if names else values[0]
    return objects.reshape(shape, order="F")


HDF5 = b"\x89HDF\r\n\x1a\n"
HDF5_USER_BLOCK = 512
"""Bytes of MATLAB's own header before the HDF5 signature."""


class MatReader(RecordReader, name="mat", version=1):
    """A MATLAB file; a column is a variable, or a path into it: ``data.y``, ``signals.2.values``, ``y.3``.

    A number counts from 1, as MATLAB does: the element of a struct or cell array, or the column of a matrix,
    whose longer side is time. Vectors may be rows or columns. A signal in an array of more dimensions is named as
    in MATLAB, ``force(:,:,1,2)``: of two open dimensions the longer one is time, the other one numbers the periods,
    which are read one after another. Objects such as timeseries are not read.
    """

    suffixes = (".mat",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        return RecordTable(read_vectors(path, columns, _read_transposed if _is_hdf5(path) else read_columns))

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return the shape of every numeric array in a file, by name; units are empty, as MATLAB has none."""
        found = mat_hdf5.shapes(path) if _is_hdf5(path) else shapes(path)
        return {name: (shape, "") for name, shape in found.items()}

    def unreadable(self, path: Path) -> Mapping[str, str]:
        """Return what the variables contain that is of MATLAB's own, by name."""
        is_hdf5 = _is_hdf5(path)
        found = mat_hdf5.objects(path) if is_hdf5 else {at: of.object_class for at, of in _variables(path)[0].items()}
        return {name: f"a MATLAB object ({of})" for name, of in found.items() if of}


def _read_transposed(path: Path, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Return columns of version 7.3: HDF5 shows MATLAB's arrays transposed."""
    return {name: values.T for name, values in mat_hdf5.read_columns(path, names).items()}


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(HDF5_USER_BLOCK + len(HDF5))
    return HDF5 in (head[: len(HDF5)], head[HDF5_USER_BLOCK:])
