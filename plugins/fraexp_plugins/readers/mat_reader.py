"""MATLAB files: version 5 (and 4) through scipy, version 7.3 through h5py; both are imported when a file is read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fraexp.api import RecordError, RecordReader, Table

HDF5 = b"\x89HDF\r\n\x1a\n"
HDF5_USER_BLOCK = 512
"""Bytes of MATLAB's own header before the HDF5 signature."""


class MatReader(RecordReader, name="mat", version=1):
    """A MATLAB file; a column is a variable, or a path into it: ``data.y``, ``signals.2.values``, ``y.3``.

    A number counts from 1, as MATLAB does: the element of a struct or cell array, or the column of a matrix,
    whose longer side is time. Vectors may be rows or columns. Objects such as timeseries are not read.
    """

    suffixes = (".mat",)

    def read(self, path: Path, columns: Sequence[str]) -> Table:
        with path.open("rb") as stream:
            head = stream.read(HDF5_USER_BLOCK + len(HDF5))
        if HDF5 in (head[: len(HDF5)], head[HDF5_USER_BLOCK:]):
            from fraexp_plugins.readers.mat_hdf5 import read_columns
        else:
            from fraexp_plugins.readers.mat_classic import read_columns
        found = read_columns(path, columns)
        return Table({name: _column(path, name, values) for name, values in found.items()})


def _column(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype.kind not in "biuf":
        kind = "complex numbers" if values.dtype.kind == "c" else "text or objects"
        raise RecordError(f"{path.name}: '{name}' holds {kind}; expected real numbers")
    if values.size != max(values.shape, default=1):
        shape = " x ".join(str(side) for side in values.shape)
        raise RecordError(f"{path.name}: '{name}' is {shape}; expected a vector: name a column, such as '{name}.1'")
    return np.asarray(values, dtype=float).ravel()
