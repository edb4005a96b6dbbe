"""Segments of a record that are analysed: all samples, or runs that a column distinguishes."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fraexp.data.record_table import RecordTable
from fraexp.errors import ParameterError, RecordError
from fraexp.records.cutting import Cut, find_runs
from fraexp.records.record_settings import RecordSettings

CONDITION_PATTERN = re.compile(r"^\s*(?P<column>\S.*?)\s*=\s*(?P<value>[^=\s]+)\s*$")
VALUE_TOLERANCE = 1e-6
"""Relative difference up to which a column has the requested value."""
MAX_LEVEL_RATIO = 1.2
"""Largest ratio of rms values of inputs at one level."""
MAX_SHOWN_VALUES = 8
"""Maximum number of values in a message."""
SampleRun = tuple[str, tuple[int, int]]
"""Name of a run for messages, its first sample, and the one after its last."""


def parse_condition(select: str, place: str) -> tuple[str, float] | None:
    """Return column and value of a condition such as ``amplitude = 12``; None if it is empty."""
    if not select:
        return None
    found = CONDITION_PATTERN.match(select)
    try:
        return (found["column"], float(found["value"])) if found else _refuse_condition(select, place)
    except ValueError:
        return _refuse_condition(select, place)


def _refuse_condition(select: str, place: str) -> tuple[str, float]:
    raise ParameterError(f"{place}: select is '{select}'; expected a column and a number, such as 'amplitude = 12'")


def select_runs(settings: RecordSettings, table: RecordTable, size: int, place: str) -> list[SampleRun]:
    """Return the runs of samples of `select`, separated by `segment_column`; by default one run of all samples."""
    chosen = parse_condition(settings.select, place)
    if chosen is None and settings.segment_column is None:
        return [(place, (0, size))]
    values = np.ones(size) if settings.segment_column is None else table.columns[settings.segment_column.column].copy()
    if chosen is not None:
        column, value = chosen
        there = np.isclose(table.columns[column], value, rtol=VALUE_TOLERANCE, atol=0.0)
        if not there.any():
            known = np.unique(table.columns[column])
            more = " and more" if known.size > MAX_SHOWN_VALUES else ""
            listed = ", ".join(f"{one:g}" for one in known[:MAX_SHOWN_VALUES]) + more
            raise RecordError(f"{place}: '{column}' is nowhere {value:g}; it is {listed}")
        values = np.where(there, values, 0.0)
    runs = find_runs(values)
    if not runs:
        raise RecordError(f"{place}: the column of segments is nowhere above 0; expected a number for each segment")
    return [(f"{place}, samples {start + 1} to {stop}", (start, stop)) for start, stop in runs]


def check_levels(cuts: Sequence[Cut], inputs: Sequence[NDArray[np.float64]], name: str, place: str) -> None:
    """Raise RecordError if segments that would be averaged as realisations have different levels.

    `inputs` are the blocks of the input in each segment, each of shape (blocks, samples).
    """
    levels: dict[int, list[float]] = {}
    for cut, blocks in zip(cuts, inputs, strict=True):
        if cut.periodic:
            levels.setdefault(cut.samples, []).append(float(np.std(blocks)))
    for found in levels.values():
        if max(found) > MAX_LEVEL_RATIO * min(found):
            raise RecordError(
                f"{place}: the rms of '{name}' is {min(found):.3g} to {max(found):.3g} in segments that would be "
                "averaged as realisations; analyse each level by itself, with {level} in a column, a file or select, "
                "and level (--level)"
            )
