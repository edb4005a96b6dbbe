"""TDMS files of LabVIEW and DIAdem, through the package npTDMS."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.api import RecordReader, RecordTable
from fraexp_plugins.readers._shared.record_arrays import (
    NUMERIC_KINDS,
    check_size,
    format_errors,
    load_package,
    only_one,
    pick_columns,
    real_vector,
)

STEP_PROPERTY, OFFSET_PROPERTY, UNIT_PROPERTY = "wf_increment", "wf_start_offset", "unit_string"
"""Properties of a channel's waveform: sample time [s], first instant [s], and unit."""


class TdmsReader(RecordReader, name="tdms", version=1):
    """A TDMS file; a column is ``group.channel``, or ``channel`` where only one group has it.

    Unit and sample time are those of the waveform's properties; channels of several sample times keep their own.
    """

    suffixes = (".tdms",)

    def read(self, path: Path, columns: Sequence[str]) -> RecordTable:
        values, units, times = {}, {}, {}
        with format_errors(path, "TDMS"):
            channels = pick_columns(path, columns, _channels(path))
            for column, channel in channels.items():
                values[column] = real_vector(path, column, np.asarray(channel[:]))
                units[column] = str(channel.properties.get(UNIT_PROPERTY, ""))
                step = float(channel.properties.get(STEP_PROPERTY, 0.0))
                if step > 0:
                    start = float(channel.properties.get(OFFSET_PROPERTY, 0.0))
                    times[column] = start + step * np.arange(values[column].size, dtype=float)
        steps = [float(channel.properties.get(STEP_PROPERTY, 0.0)) for channel in channels.values()]
        own = times if len(times) == len(values) else {}
        return RecordTable(values, only_one(steps) or None, units, own)

    def contents(self, path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
        """Return length and unit of every channel of numbers, by name."""
        with format_errors(path, "TDMS"):
            return {
                name: ((len(channel),), str(channel.properties.get(UNIT_PROPERTY, "")))
                for name, channel in _channels(path).items()
                if channel.dtype.kind in NUMERIC_KINDS
            }


def _channels(path: Path) -> dict[str, Any]:
    check_size(path, "the file", path.stat().st_size)
    file = load_package(path, "nptdms", "tdms").TdmsFile.read(path)
    everything = [channel for group in file.groups() for channel in group.channels()]
    names = [channel.name for channel in everything]
    return {
        channel.name if names.count(channel.name) == 1 else f"{channel.group_name}.{channel.name}": channel
        for channel in everything
    }
