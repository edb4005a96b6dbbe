"""MATLAB files of version 7.3, which are HDF5: structs are groups, cells and struct arrays hold references.

h5py is imported when a file is read, so groups and datasets are told apart by what they have.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fraexp.api import RecordError
from fraexp_plugins.readers.measured import check_size, missing_column

Found = TypeVar("Found")
REFERENCE = 8
"""Times that a reference takes more room than in the file."""
MOST = 5000
"""Nodes that are looked at for names."""
DEEPEST = 6
"""Levels of structs and cells that are looked through for names."""


def read_columns(path: Path, columns: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the named columns as they stand in the file; RecordError names what exists if one is missing."""

    def of_these(file: Any) -> dict[str, np.ndarray]:
        nodes = {name: _follow(path, name, file) for name in columns}
        for name, (node, _) in nodes.items():
            check_size(path, f"variable '{name}'", _size(node))
        check_size(path, "what is read of it", sum({node.name: _size(node) for node, _ in nodes.values()}.values()))
        return {name: _read(path, name, *found) for name, found in nodes.items()}

    return _opened(path, of_these)


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the sides of every array of numbers in the file, as MATLAB has them."""

    def of_all(file: Any) -> dict[str, tuple[int, ...]]:
        nodes = {leaf: _follow(path, leaf, file)[0] for leaf in _leaves(file, "")}
        return {leaf: tuple(node.shape[::-1]) for leaf, node in nodes.items() if _is_array(node)}

    return _opened(path, of_all)


def _opened(path: Path, action: Callable[[Any], Found]) -> Found:
    """Return what an action finds in the file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return action(file)
    except RecordError:
        raise
    except Exception as error:  # a damaged file makes h5py raise almost anything
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as a MATLAB 7.3 file: {text}; save it again") from None


def _read(path: Path, column: str, node: Any, number: int | None) -> np.ndarray:
    if not _is_array(node):
        leaves = ", ".join(_leaves(node, column)) or "nothing that can be read"
        raise RecordError(f"{path.name}: '{column}' is a struct, cell, text or object, not numbers; it holds {leaves}")
    if node.is_virtual or node.external:
        raise RecordError(f"{path.name}: '{column}' lies in another file; save all of it into one file")
    if node.attrs.get("MATLAB_empty", 0):
        return np.empty(0)
    if number is None:
        return np.asarray(node[()])
    # HDF5 shows MATLAB's matrices transposed; the longer side is time either way.
    return np.asarray(node[number - 1] if node.shape[1] >= node.shape[0] else node[:, number - 1])


def _follow(path: Path, column: str, file: Any) -> tuple[Any, int | None]:
    """Return the node of a path, and the column asked for if it is a matrix."""
    node: Any = file
    number: int | None = None
    for part in column.split("."):
        if part.isdigit() and number is None:
            node, number = _item(node, int(part))
        else:
            node = _child(node, part)
            if number is not None and _is_dataset(node):  # a field of one element of a struct array
                node, number = _item(node, number)
        if node is None:
            raise missing_column(path, column, _leaves(file, ""))
    return node, number


def _is_dataset(node: Any) -> bool:
    return hasattr(node, "dtype")


def _size(node: Any) -> float:
    """Return the decoded size of a dataset [bytes]."""
    return float(node.size or 0) * node.dtype.itemsize if _is_dataset(node) else 0.0


def _is_table(node: Any) -> bool:
    return _is_dataset(node) and bool(node.dtype.metadata) and "ref" in node.dtype.metadata


def _is_array(node: Any) -> bool:
    return _is_dataset(node) and node.dtype.kind in "biufcV" and node.attrs.get("MATLAB_class", b"") != b"char"


def _child(node: Any, name: str) -> Any:
    if node is None or _is_dataset(node):
        return None
    # Only what lies in this file: a soft or external link may lead elsewhere.
    return node[name] if type(node.get(name, getlink=True)).__name__ == "HardLink" else None


def _item(node: Any, number: int) -> tuple[Any, int | None]:
    if not _is_dataset(node):
        return node, number  # the fields of a struct array are tables, indexed one level below
    if _is_table(node):
        check_size(Path(node.file.filename), "a cell or struct array", _size(node) * REFERENCE)
        references = np.ravel(node[()])
        return (node.file[references[number - 1]], None) if 0 < number <= references.size else (None, None)
    return (node, number) if node.ndim == 2 and 0 < number <= min(node.shape) else (None, None)


def _leaves(node: Any, place: str) -> list[str]:
    """Return the paths of the arrays of numbers below a node."""
    return list(_found(node, place, set(), 0))


def _found(node: Any, place: str, seen: set[Any], depth: int) -> Iterator[str]:
    if depth > DEEPEST or node in seen or len(seen) > MOST:  # groups may hold themselves
        return
    seen.add(node)
    if _is_table(node):
        parts = ((str(number), _item(node, number)[0]) for number in range(1, min(node.size, DEEPEST) + 1))
    elif _is_dataset(node):
        if _is_array(node):
            yield place
        return
    else:
        names = itertools.islice((name for name in node if not name.startswith("#")), MOST)
        parts = ((name, _child(node, name)) for name in names)
    for name, part in parts:
        if part is not None:
            yield from _found(part, f"{place}.{name}".strip("."), seen, depth + 1)
