"""HDF5 files of any program."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.api import RecordReader, RecordTable
from fraexp_plugins.readers._shared.mat_hdf5 import attributes, read_columns, shapes
from fraexp_plugins.readers._shared.record_arrays import only_one, read_vectors, split_indices

UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")
RATE_ATTRIBUTES = ("sample_rate", "samplerate", "sampling_rate", "fs", "Fs", "rate")
STEP_ATTRIBUTES = ("sample_time", "dt", "Ts", "wf_increment", "time_step")


class Hdf5Reader(RecordReader, name="hdf5", version=1):
    """A file of HDF5; a column is a dataset by its path, ``group.force``, or ``group.data.2``, ``data(:,1)``.

    The attribute ``unit`` or ``units`` of a dataset is its unit; ``sample_rate``, ``fs``, ``dt`` or such of it, of a
    group above it or of the file is its clock.
    """

    suffixes = (".h5", ".hdf5", ".hdf", ".he5")

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        names = {column: split_indices(column)[0] for column in columns}
        known = attributes(path, sorted(set(names.values())))
        units = {column: _text(known[name], UNIT_ATTRIBUTES) for column, name in names.items()}
        sample_time = only_one(_sample_time(one) for one in known.values())
        return RecordTable(read_vectors(path, columns, read_columns), sample_time, units)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return shape and unit of every dataset of numbers, by path."""
        found = {name: shape[::-1] for name, shape in shapes(path).items()}
        known = attributes(path, sorted(found))
        return {name: (shape, _text(known[name], UNIT_ATTRIBUTES)) for name, shape in found.items()}


def _text(attributes_: dict[str, Any], names: Sequence[str]) -> str:
    for name in names:
        value = attributes_.get(name)
        if isinstance(value, bytes | str):
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return ""


def _sample_time(attributes_: dict[str, Any]) -> float | None:
    """Return the sample time [s] that attributes state, or None."""
    for names, inverse in ((RATE_ATTRIBUTES, True), (STEP_ATTRIBUTES, False)):
        for name in names:
            value = np.asarray(attributes_.get(name))
            if value.size == 1 and value.dtype.kind in "iuf" and float(value.ravel()[0]) > 0:
                return 1 / float(value.ravel()[0]) if inverse else float(value.ravel()[0])
    return None
