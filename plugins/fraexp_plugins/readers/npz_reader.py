"""Arrays of NumPy: ``.npz`` with named arrays, ``.npy`` with one."""

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.api import RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import (
    NUMERIC_KINDS,
    check_size,
    format_errors,
    pick_arrays,
    split_indices,
)

SINGLE_NAME = "data"
"""Name of the array in a ``.npy`` file."""


class NpzReader(RecordReader, name="npz", version=1):
    """Arrays of NumPy by name; ``name.2`` is a column of a matrix, ``name(:,1)`` a part as in MATLAB.

    Complex numbers are two arrays, ``name.real`` and ``name.imaginary``. The array of a ``.npy`` file is called
    ``data``. Arrays of objects are never loaded.
    """

    suffixes = (".npz", ".npy")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        arrays, _ = _load(path, [split_indices(column)[0] for column in columns])
        return RecordTable(pick_arrays(path, arrays, columns))

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return the shape of every array of real numbers, by name; units are empty, as NumPy has none."""
        arrays, _ = _load(path, None)
        return {name: (values.shape, "") for name, values in arrays.items()}

    def unreadable(self, path: Path) -> Mapping[str, str]:
        """Return what the arrays contain that are not real numbers, by name."""
        return _load(path, None)[1]


def _load(path: Path, names: Sequence[str] | None) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    """Return the arrays of real numbers, of these names if given, and what the others contain."""
    with format_errors(path, "arrays of NumPy"), path.open("rb") as stream:
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                check_size(path, "the file", sum(one.file_size for one in archive.infolist()))
        loaded = np.load(stream, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            everything = (
                {SINGLE_NAME: loaded} if loaded.dtype.names is None else {n: loaded[n] for n in loaded.dtype.names}
            )
            return _real_arrays(everything)
        with loaded:
            wanted = None if names is None else {part for name in names for part in (name, name.rpartition(".")[0])}
            arrays, others = {}, {}
            for name in loaded.files:
                if wanted is None or name in wanted:
                    try:
                        arrays[name] = loaded[name]
                    except ValueError:  # an array of objects would run code
                        others[name] = "objects"
        real, rest = _real_arrays(arrays)
        return real, {**others, **rest}


def _real_arrays(arrays: Mapping[str, NDArray[np.float64]]) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    parts: dict[str, NDArray[np.float64]] = {}
    others = {}
    for name, values in arrays.items():
        if values.dtype.kind in NUMERIC_KINDS:
            parts[name] = values
        elif np.iscomplexobj(values):
            parts |= {f"{name}.real": np.real(values), f"{name}.imaginary": np.imag(values)}
        else:
            others[name] = str(values.dtype)
    return parts, others
