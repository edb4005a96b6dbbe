"""The data elements of MATLAB files of version 5 to 7 (MAT-File Format, MathWorks): arrays, structs and cells.

Files come from strangers. scipy's own reader believes what they say of themselves and crashes where it is not true;
here every length is checked against what is there.
"""

import struct
from collections.abc import Iterator
from math import prod
from typing import Any

import numpy as np

STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of numbers in the file."""
ARRAYS = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Types of arrays by their class; numbers may be stored in less room."""
CELL, STRUCT, CHARACTERS = 1, 2, 4
INT32, MATRIX = 5, 14
COMPLEX = 0x800
DEEPEST, MOST_SIDES = 16, 32
TAG = 8
"""Bytes before an element's own, and to whose multiple it is filled up."""


def matrix(body: memoryview, order: str, depth: int = 0) -> np.ndarray:
    """Return the array in the body of a MATRIX element; an array of None for what is not read.

    A struct array has a field of objects for each field, as in scipy. ValueError or struct.error if it is damaged.
    """
    if not len(body):
        return np.empty((0, 0))
    if depth > DEEPEST:
        raise ValueError(f"structs and cells are nested deeper than {DEEPEST}")
    parts = elements(body, order)
    flags = int(np.frombuffer(next(parts)[1], f"{order}u4")[0])
    number, kind = flags & 0xFF, next(parts)
    sides = tuple(np.frombuffer(kind[1], f"{order}i4").tolist())
    if kind[0] != INT32 or not 2 <= len(sides) <= MOST_SIDES or min(sides) < 0:
        raise ValueError(f"an array has the sides {sides}")
    next(parts)  # the name
    if number in ARRAYS:
        return _numbers(parts, ARRAYS[number], sides, order, bool(flags & COMPLEX))
    if number == CHARACTERS:
        return np.array("")
    if number in (CELL, STRUCT):
        names = _fields(parts, order) if number == STRUCT else []
        return _objects(parts, names, sides, len(body), order, depth)
    return np.array(None, dtype=object)


def elements(body: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element; ValueError if one ends after its surroundings."""
    at = 0
    while at + TAG <= len(body):
        kind, size = struct.unpack_from(f"{order}II", body, at)
        start, after = at + TAG, at + TAG + (size + TAG - 1) // TAG * TAG
        if kind >> 16:  # a short one: length and type share four bytes
            kind, size, start, after = kind & 0xFFFF, kind >> 16, at + TAG // 2, at + TAG
        if start + size > len(body) or (start < at + TAG and size > TAG // 2):
            raise ValueError("an element is longer than what it is in")
        yield kind, body[start : start + size]
        at = after


def _numbers(
    parts: Iterator[tuple[int, memoryview]], dtype: str, sides: tuple[int, ...], order: str, with_imaginary: bool
) -> np.ndarray:
    found = [
        np.frombuffer(content, f"{order}{STORED[kind]}").astype(dtype).reshape(sides, order="F")
        for kind, content in (next(parts) for _ in range(1 + with_imaginary))
    ]
    return found[0] + 1j * found[1] if with_imaginary else found[0]


def _fields(parts: Iterator[tuple[int, memoryview]], order: str) -> list[str]:
    length = int(np.frombuffer(next(parts)[1], f"{order}i4")[0])
    text = bytes(next(parts)[1])
    if not 0 < length <= max(len(text), 1):
        raise ValueError(f"names of fields are {length} letters long")
    names = [text[at : at + length].partition(b"\0")[0].decode("latin-1") for at in range(0, len(text), length)]
    if not all(names):
        raise ValueError("a field has no name")
    return names


def _objects(
    parts: Iterator[tuple[int, memoryview]], names: list[str], sides: tuple[int, ...], room: int, order: str, depth: int
) -> np.ndarray:
    count, width = prod(sides), max(len(names), 1)
    if count * width * TAG > room:
        raise ValueError(f"{count} elements do not fit into {room} bytes")
    dtype: Any = [(name, object) for name in names] if names else object
    found = np.empty(count, dtype=dtype)
    for place in range(count):
        values = []
        for _ in range(width):
            kind, content = next(parts)
            values.append(matrix(content, order, depth + 1) if kind == MATRIX else np.array(None, dtype=object))
        found[place] = tuple(values) if names else values[0]
    return found.reshape(sides, order="F")
