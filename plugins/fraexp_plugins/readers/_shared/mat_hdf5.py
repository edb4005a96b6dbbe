"""MATLAB files of version 7.3, which are HDF5: structs are groups, cells and struct arrays hold references.

h5py is imported when a file is read, and has no types: groups and datasets are distinguished by their attributes.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError
from fraexp_plugins.readers._shared.record_arrays import COMPLEX_PARTS, check_size, missing_column

Answer = TypeVar("Answer")
REFERENCE_EXPANSION = 8
"""Size of a reference in memory over that in the file."""
OBJECT_MARK = "MATLAB_object_decode"
"""Attribute of an object of MATLAB's own: the dataset holds numbers of what is stored elsewhere."""
MAX_SEARCHED_NODES = 5000
"""Nodes that are searched for names."""
MAX_DEPTH = 6
"""Levels of structs and cells, and elements of each, that are searched for names."""


def read_columns(path: Path, columns: Sequence[str]) -> dict[str, NDArray[np.generic]]:
    """Return the named columns as stored in the file; RecordError lists the columns if one is missing."""

    def read_all(file: Any) -> dict[str, NDArray[np.generic]]:
        nodes = {name: _node_at(path, name, file) for name in columns}
        for name, (node, _) in nodes.items():
            check_size(path, f"variable '{name}'", _size(node))
        check_size(path, "all that is read of it", sum({node.name: _size(node) for node, _ in nodes.values()}.values()))
        return {name: _read(path, name, *node) for name, node in nodes.items()}

    return _apply(path, read_all)


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shape of every numeric array in the file, by name, with MATLAB's order of dimensions."""

    def all_shapes(file: Any) -> dict[str, tuple[int, ...]]:
        nodes = {leaf: _node_at(path, leaf, file)[0] for leaf in _leaves(file, "")}
        return {leaf: tuple(node.shape[::-1]) for leaf, node in nodes.items() if _is_numeric(node)}

    return _apply(path, all_shapes)


def attributes(path: Path, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the attributes of each dataset, and where it has none of that name those of the groups above it."""

    def all_attributes(file: Any) -> dict[str, dict[str, Any]]:
        found = {}
        for name in names:
            node, _ = _node_at(path, name, file)
            found[name] = dict(node.attrs)
            while node.name != "/":
                node = node.parent
                found[name] = {**dict(node.attrs), **found[name]}
        return found

    return _apply(path, all_attributes)


def _apply(path: Path, action: Callable[[Any], Answer]) -> Answer:
    """Return the result of an action on the opened file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return action(file)
    except RecordError:
        raise
    except Exception as error:  # a damaged file makes h5py raise almost anything
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as HDF5 (MATLAB 7.3): {text}; save it again") from None


def _read(path: Path, column: str, node: Any, number: int | str | None) -> NDArray[np.generic]:
    if not _is_numeric(node):
        leaves = ", ".join(_leaves(node, column)) or "nothing readable"
        raise RecordError(f"{path.name}: '{column}' is a struct, cell, text or object, not numbers; it holds {leaves}")
    if node.is_virtual or node.external:
        raise RecordError(f"{path.name}: '{column}' lies in another file; save all of it into one file")
    if node.attrs.get("MATLAB_empty", 0):
        return np.empty(0)
    if number is None:
        return np.asarray(node[()])
    if isinstance(number, str):
        values = np.asarray(node[()])
        real, imaginary = (
            (values[name] for name in values.dtype.names) if values.dtype.names else (values.real, values.imag)
        )
        return np.asarray(real if number == COMPLEX_PARTS[0] else imaginary)
    # HDF5 shows MATLAB's matrices transposed; the longer dimension is time either way.
    return np.asarray(node[number - 1] if node.shape[1] >= node.shape[0] else node[:, number - 1])


def _node_at(path: Path, column: str, file: Any) -> tuple[Any, int | str | None]:
    """Return the node at a path, and the number of the column if the path leads to one of a matrix."""
    node: Any = file
    number: int | str | None = None
    for part in column.split("."):
        if part in COMPLEX_PARTS and number is None and _is_complex(node):
            number = part
        elif part.isdigit() and number is None:
            node, number = _item(node, int(part))
        else:
            node = _child(node, part)
            if isinstance(number, int) and _is_dataset(node):  # a field of one element of a struct array
                node, number = _item(node, number)
        if node is None:
            raise missing_column(path, column, _leaves(file, ""))
    return node, number


def _is_dataset(node: Any) -> bool:
    return hasattr(node, "dtype")


def _size(node: Any) -> float:
    """Return the decoded size of a dataset [bytes]."""
    return float(node.size or 0) * node.dtype.itemsize if _is_dataset(node) else 0.0


def _is_reference_table(node: Any) -> bool:
    return _is_dataset(node) and bool(node.dtype.metadata) and "ref" in node.dtype.metadata


def _is_numeric(node: Any) -> bool:
    is_plain = _is_dataset(node) and node.dtype.kind in "biufcV" and node.attrs.get("MATLAB_class", b"") != b"char"
    return is_plain and OBJECT_MARK not in node.attrs


def objects(path: Path) -> dict[str, str]:
    """Return the class of each object of MATLAB's own, such as timeseries, by the name of the variable."""

    def classes(file: Any) -> dict[str, str]:
        nodes = {name: _child(file, name) for name in file if not name.startswith("#")}
        found = {name: node.attrs for name, node in nodes.items() if node is not None and OBJECT_MARK in node.attrs}
        return {name: bytes(of.get("MATLAB_class", b"")).decode("latin-1") for name, of in found.items()}

    return _apply(path, classes)


def _is_complex(node: Any) -> bool:
    """Say whether a dataset contains complex numbers, as h5py or as MATLAB writes them."""
    return _is_dataset(node) and (node.dtype.kind == "c" or node.dtype.names == ("real", "imag"))


def _child(node: Any, name: str) -> Any:
    if node is None or _is_dataset(node):
        return None
    # only hard links: a soft or external one may lead out of the file
    return node[name] if type(node.get(name, getlink=True)).__name__ == "HardLink" else None


def _item(node: Any, number: int) -> tuple[Any, int | str | None]:
    if not _is_dataset(node):
        return node, number  # the fields of a struct array are tables of references: they are indexed one level below
    if _is_reference_table(node):
        check_size(Path(node.file.filename), "a cell or struct array", _size(node) * REFERENCE_EXPANSION)
        references = np.ravel(node[()])
        return (node.file[references[number - 1]], None) if 0 < number <= references.size else (None, None)
    return (node, number) if node.ndim == 2 and 0 < number <= min(node.shape) else (None, None)


def _leaves(node: Any, parent: str) -> list[str]:
    """Return the paths of the numeric arrays below a node."""
    return list(_search(node, parent, set(), 0))


def _search(node: Any, parent: str, seen: set[object], depth: int) -> Iterator[str]:
    if depth > MAX_DEPTH or node in seen or len(seen) > MAX_SEARCHED_NODES:  # a group may contain itself
        return
    seen.add(node)
    if _is_reference_table(node):
        children = ((str(number), _item(node, number)[0]) for number in range(1, min(node.size, MAX_DEPTH) + 1))
    elif _is_dataset(node):
        if _is_numeric(node):
            yield from (f"{parent}.{part}" for part in COMPLEX_PARTS) if _is_complex(node) else (parent,)
        return
    else:
        names = itertools.islice((name for name in node if not name.startswith("#")), MAX_SEARCHED_NODES)
        children = ((name, _child(node, name)) for name in names)
    for name, child in children:
        if child is not None:
            yield from _search(child, f"{parent}.{name}".strip("."), seen, depth + 1)
