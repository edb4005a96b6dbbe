"""Arrays of MATLAB files with several dimensions: ``force(:,:,1,2)`` is a signal in one of them."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordError

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
