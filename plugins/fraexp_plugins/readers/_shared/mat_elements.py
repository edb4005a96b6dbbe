"""The data elements of MATLAB files of version 5 to 7 (MAT-File Format, MathWorks): arrays, structs and cells.

Files come from strangers. scipy's own reader, and pymatreader with it, trusts the lengths in a file: at 19 of 600
files with random damage it ended the process by a signal. Here every length is checked against the bytes that exist.
"""

import struct
from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

STORED_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Number types in the file, by the type of a data element."""
ARRAY_TYPES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Number types of arrays, by array class; the file may store the numbers in a smaller type."""
CELL, STRUCT, CHARACTERS = 1, 2, 4
INT32, MATRIX = 5, 14
COMPLEX_FLAG = 0x800
MAX_DEPTH, MAX_DIMENSIONS = 16, 32
TAG_BYTES = 8
"""Length of an element's tag; elements are padded to a multiple of it."""


def read_matrix(body: memoryview, order: str, depth: int = 0) -> NDArray[np.generic]:
    """Return the array in the body of a MATRIX element; an array that holds None for a class that is not supported.

    A struct array has a field of objects for each field, as in scipy. ValueError or struct.error if it is damaged.
    """
    if not len(body):
        return np.empty((0, 0))
    if depth > MAX_DEPTH:
        raise ValueError(f"structs and cells are nested deeper than {MAX_DEPTH}")
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
