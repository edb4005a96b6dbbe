"""MATLAB files: version 5 (and 4) through scipy, version 7.3 through h5py; both are imported when a file is read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fraexp.api import RecordError, RecordReader, RecordTable
from fraexp_plugins.readers.mat_arrays import how_to_name, shape_text, signal, split

HDF5 = b"\x89HDF\r\n\x1a\n"
HDF5_USER_BLOCK = 512
"""Bytes of MATLAB's own header before the HDF5 signature."""


class MatReader(RecordReader, name="mat", version=1):
    """A MATLAB file; a column is a variable, or a path into it: ``data.y``, ``signals.2.values``, ``y.3``.

    A number counts from 1, as MATLAB does: the element of a struct or cell array, or the column of a matrix,
    whose longer side is time. Vectors may be rows or columns. Of an array with more sides a signal is named as in
    MATLAB, ``force(:,:,1,2)``: of two sides left open the longer one is time, the other one numbers the periods,
    which are read one after another. Objects such as timeseries are not read.
    """

    suffixes = (".mat",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        names = {column: split(column) for column in columns}
        if _is_hdf5(path):
            from fraexp_plugins.readers.mat_hdf5 import read_columns
        else:
            from fraexp_plugins.readers.mat_classic import read_columns
        found = read_columns(path, sorted({name for name, _ in names.values()}))
        if _is_hdf5(path):  # HDF5 shows MATLAB's arrays transposed
            found = {name: values.T for name, values in found.items()}
        return RecordTable({column: _column(path, name, found[name], sides) for column, (name, sides) in names.items()})

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return the sides of every array of numbers in a file by its name; MATLAB knows no units."""
        if _is_hdf5(path):
            from fraexp_plugins.readers.mat_hdf5 import shapes
        else:
            from fraexp_plugins.readers.mat_classic import shapes
        return {name: (shape, "") for name, shape in shapes(path).items()}


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(HDF5_USER_BLOCK + len(HDF5))
    return HDF5 in (head[: len(HDF5)], head[HDF5_USER_BLOCK:])


def _column(path: Path, name: str, values: np.ndarray, sides: tuple[str, ...]) -> np.ndarray:
    if values.dtype.kind not in "biuf":
        kind = "complex numbers" if values.dtype.kind == "c" else "text or objects"
        raise RecordError(f"{path.name}: '{name}' holds {kind}; expected real numbers")
    if sides:
        return np.asarray(signal(path, name, values, sides), dtype=float)
    if values.size != max(values.shape, default=1):
        raise RecordError(f"{path.name}: '{name}' is {shape_text(values)}; {how_to_name(name, values.shape)}")
    return np.asarray(values, dtype=float).ravel()
