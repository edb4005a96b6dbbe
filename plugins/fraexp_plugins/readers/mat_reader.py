"""MATLAB files: version 5 (and 4) through scipy, version 7.3 through h5py; both are imported when a file is read."""

from collections.abc import Sequence
from pathlib import Path

from fraexp.api import RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import real_vector, split_indices

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
        names = {column: split_indices(column) for column in columns}
        if _is_hdf5(path):
            from fraexp_plugins.readers._shared.mat_hdf5 import read_columns
        else:
            from fraexp_plugins.readers._shared.mat_classic import read_columns
        arrays = read_columns(path, sorted({name for name, _ in names.values()}))
        if _is_hdf5(path):  # HDF5 shows MATLAB's arrays transposed
            arrays = {name: values.T for name, values in arrays.items()}
        return RecordTable(
            {column: real_vector(path, name, arrays[name], indices) for column, (name, indices) in names.items()}
        )

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return the shape of every numeric array in a file, by name; units are empty, as MATLAB has none."""
        if _is_hdf5(path):
            from fraexp_plugins.readers._shared.mat_hdf5 import shapes
        else:
            from fraexp_plugins.readers._shared.mat_classic import shapes
        return {name: (shape, "") for name, shape in shapes(path).items()}


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(HDF5_USER_BLOCK + len(HDF5))
    return HDF5 in (head[: len(HDF5)], head[HDF5_USER_BLOCK:])
