"""What readers share: limits of size, missing columns and libraries, and the array's samples that a name picks."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError, did_you_mean

Column = TypeVar("Column")
MAX_SIZE_BYTES = 2 * 1024**3
"""Maximum decoded size of a file or variable that is read."""
MAX_LISTED_COLUMNS = 30
"""Maximum number of columns named in a message."""
UNCHECKED_SIZE_BYTES, MAX_EXPANSION = 256 * 1024**2, 50
"""Decoded size up to which a file may be compressed at will, and how many times its own size a file may decode to
above that: measured data cannot be compressed further, zeros a thousand times."""


def missing_column(path: Path, name: str, known: Iterable[str]) -> RecordError:
    """Return the error for a column that a file does not have: it lists the columns, and the nearest name."""
    names = list(known)
    more = f" and {len(names) - MAX_LISTED_COLUMNS} more" if len(names) > MAX_LISTED_COLUMNS else ""
    near = did_you_mean(name, names)
    nearest = near if near.startswith("; did") else ""
    if name.removeprefix("-") in names:
        nearest = f"; to change the sign, write '{name[1:]} * -1'"
    listed = ", ".join(names[:MAX_LISTED_COLUMNS])
    return RecordError(f"{path.name}: no column is called '{name}'; it has {listed}{more}{nearest}")


def pick_columns(path: Path, columns: Sequence[str], found: Mapping[str, Column]) -> dict[str, Column]:
    """Return the named ones of a file's columns; RecordError lists the columns if one is missing."""
    for column in columns:
        if column not in found:
            raise missing_column(path, column, found)
    return {column: found[column] for column in columns}


def check_size(path: Path, what: str, size: float) -> None:
    """Raise RecordError if something of `size` bytes is too large to be read, or implausible for the file's size."""
    own = path.stat().st_size
    if UNCHECKED_SIZE_BYTES < size <= MAX_SIZE_BYTES and size > MAX_EXPANSION * own:
        raise RecordError(
            f"{path.name}: {what} would take {size / 1024**3:.1f} GiB, {size / own:.0f} times the file; "
            f"expected measured numbers, up to {MAX_EXPANSION} times the file"
        )
    if size > MAX_SIZE_BYTES:
        raise RecordError(
            f"{path.name}: {what} takes {size / 1024**3:.1f} GiB; expected up to {MAX_SIZE_BYTES / 1024**3:g} GiB: "
            "split it"
        )


INDEXED_NAME = re.compile(r"^(?P<name>.+?)\((?P<indices>[\d:,\s]+)\)$")
COMPLEX_PARTS = ("real", "imaginary")
"""What the names of the two parts of a complex array end with, behind a point."""


def split_indices(column: str) -> tuple[str, tuple[str, ...]]:
    """Return the variable in a column's name, and the indices in parentheses behind it, if there are any."""
    match = INDEXED_NAME.match(column)
    if not match:
        return column, ()
    return match["name"].strip(), tuple(index.strip() for index in match["indices"].split(","))


def extract_signal(path: Path, name: str, values: NDArray[np.generic], indices: tuple[str, ...]) -> NDArray[np.generic]:
    """Return the signal of an array at the given indices, each a number from 1 or ``:``, shape (n,).

    If two dimensions are open, the longer one is time; the other one numbers its periods, which follow one another.
    """
    whole = values.reshape(values.shape + (1,) * (len(indices) - values.ndim))  # MATLAB drops trailing dimensions of 1
    selection = list[slice | int]()
    open_dimensions = 0
    for axis, index in enumerate(indices):
        length = whole.shape[axis] if axis < whole.ndim else 1
        if index != ":" and not (index.isdigit() and 1 <= int(index) <= length):
            raise RecordError(
                f"{path.name}: '{name}' is {shape_text(values)}; index {axis + 1} in '({','.join(indices)})' is "
                f"'{index}', expected : or a number from 1 to {length}"
            )
        selection.append(slice(None) if index == ":" else int(index) - 1)
        open_dimensions += index == ":" and length > 1
    if len(indices) != whole.ndim or open_dimensions > 2:
        raise RecordError(f"{path.name}: '{name}' is {shape_text(values)}; {column_hint(name, values.shape)}")
    signal = np.squeeze(whole[tuple(selection)])
    if signal.ndim == 2 and signal.shape[0] < signal.shape[1]:
        signal = signal.T
    return signal.ravel(order="F")


def shape_text(values: NDArray[np.generic]) -> str:
    """Return the dimensions of an array as text, such as ``1000 x 4``."""
    return " x ".join(str(length) for length in values.shape)


def column_hint(name: str, shape: tuple[int, ...]) -> str:
    """Return how to name a signal in an array of this shape."""
    if len(shape) == 2:
        return f"expected a vector: name a column, such as '{name}.1', or '{name}(:,:)' for periods one after another"
    longest = int(np.argmax(shape))
    second = next(axis for axis in range(len(shape)) if axis != longest)
    example = ",".join(":" if axis in (longest, second) else "1" for axis in range(len(shape)))
    return (
        f"expected samples and periods of one signal: give the other dimensions an index, such as '{name}({example})'"
    )


NUMERIC_KINDS = "biuf"
"""Kinds of numpy types that are real numbers."""


def load_package(path: Path, module: str, extra: str) -> Any:
    """Return a module of an optional package; RecordError names the extra if it is not installed."""
    try:
        return import_module(module)
    except ImportError:
        raise RecordError(
            f"{path.name}: reading it needs the package {module.partition('.')[0]}; pip install 'fraexp[{extra}]'"
        ) from None


@contextmanager
def format_errors(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises at a damaged file into RecordError."""
    try:
        yield
    except RecordError:
        raise
    except Exception as error:
        lines = str(error).splitlines()
        text = f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
        raise RecordError(f"{path.name}: this cannot be read as {what} ({text}); export it again") from None


def real_vector(path: Path, name: str, values: NDArray[Any], indices: tuple[str, ...] = ()) -> NDArray[np.float64]:
    """Return the samples of a variable, or of the part that indices in parentheses name, shape (n,)."""
    if values.dtype.kind not in NUMERIC_KINDS:
        kind = "complex numbers" if values.dtype.kind == "c" else "text or objects"
        raise RecordError(f"{path.name}: '{name}' holds {kind}; expected real numbers")
    if indices:
        return np.asarray(extract_signal(path, name, values, indices), dtype=float)
    if values.size != max(values.shape, default=1):
        raise RecordError(f"{path.name}: '{name}' is {shape_text(values)}; {column_hint(name, values.shape)}")
    return np.asarray(values, dtype=float).ravel()


def read_vectors(
    path: Path, columns: Sequence[str], read: Callable[[Path, list[str]], Mapping[str, NDArray[Any]]]
) -> dict[str, NDArray[np.float64]]:
    """Return the signals that columns name, shape (n,); `read` returns the arrays of a file by their names."""
    names = {column: split_indices(column) for column in columns}
    arrays = read(path, sorted({name for name, _ in names.values()}))
    return {column: real_vector(path, name, arrays[name], indices) for column, (name, indices) in names.items()}


def only_one(values: Iterable[Column]) -> Column | None:
    """Return the value that is the same for all columns, or None."""
    found = set(values)
    return found.pop() if len(found) == 1 else None


def matrix_column(values: NDArray[Any], number: str) -> NDArray[Any] | None:
    """Return a column of a matrix by its number from 1, whose longer side is time; None if it has none such."""
    upright = values if values.ndim == 2 and values.shape[0] >= values.shape[1] else values.T
    index = int(number) - 1 if number.isdigit() else -1
    return upright[:, index] if upright.ndim == 2 and 0 <= index < upright.shape[1] else None


def pick_arrays(path: Path, arrays: dict[str, NDArray[Any]], columns: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return columns from named arrays: ``name``, ``name.2`` for a column of a matrix, or ``name(:,1)``."""
    found = {}
    for column in columns:
        name, indices = split_indices(column)
        values: NDArray[Any] | None = arrays.get(name)
        if values is None:
            head, _, number = name.rpartition(".")
            values = matrix_column(arrays[head], number) if head in arrays else None
        if values is None:
            raise missing_column(path, column, arrays)
        found[column] = real_vector(path, name, values, indices)
    return found
