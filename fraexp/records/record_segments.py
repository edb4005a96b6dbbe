"""Which stretches of a record are analysed: all of it, or runs of samples that a column tells apart."""

import re
from collections.abc import Sequence

import numpy as np

from fraexp.components.kinds import RecordTable
from fraexp.errors import ParameterError, RecordError
from fraexp.records.cutting import Cut, runs_of
from fraexp.records.record_settings import RecordSettings

CONDITION = re.compile(r"^\s*(?P<column>\S.*?)\s*=\s*(?P<value>[^=\s]+)\s*$")
EQUAL = 1e-6
"""Relative difference of a column's value and the one asked for that is rounding."""
ALIKE = 1.2
"""Greatest ratio of the inputs' rms values that are one level."""
SHOWN = 8
"""Values of a column that a message shows at most."""
Run = tuple[str, tuple[int, int]]
"""What a run is called in messages, its first sample and the one after its last."""


def condition(where: str, place: str) -> tuple[str, float] | None:
    """Return column and value of a text such as ``amplitude = 12``, or None if it is empty."""
    if not where:
        return None
    found = CONDITION.match(where)
    try:
        return (found["column"], float(found["value"])) if found else _refuse(where, place)
    except ValueError:
        return _refuse(where, place)


def _refuse(where: str, place: str) -> tuple[str, float]:
    raise ParameterError(f"{place}: where is '{where}'; expected a column and a number, such as 'amplitude = 12'")


def runs_in(settings: RecordSettings, table: RecordTable, size: int, place: str) -> list[Run]:
    """Return the runs of samples that `where` chooses and `segment` tells apart; all samples if neither is given."""
    chosen = condition(settings.where, place)
    if chosen is None and settings.segment is None:
        return [(place, (0, size))]
    values = np.ones(size) if settings.segment is None else table.columns[settings.segment.column].copy()
    if chosen is not None:
        column, value = chosen
        there = np.isclose(table.columns[column], value, rtol=EQUAL, atol=0.0)
        if not there.any():
            known = np.unique(table.columns[column])
            listed = f"{', '.join(f'{one:g}' for one in known[:SHOWN])}{' and more' if known.size > SHOWN else ''}"
            raise RecordError(f"{place}: '{column}' is nowhere {value:g}; it is {listed}")
        values = np.where(there, values, 0.0)
    runs = runs_of(values)
    if not runs:
        raise RecordError(f"{place}: the column of segments is nowhere above 0; expected a number for each segment")
    return [(f"{place}, samples {start + 1} to {stop}", (start, stop)) for start, stop in runs]


def check_levels(cuts: Sequence[Cut], inputs: Sequence[np.ndarray], name: str, place: str) -> None:
    """Raise RecordError if segments that would be averaged as realisations are of different levels.

    `inputs` are the blocks of the input in each segment, each of shape (blocks, samples).
    """
    levels: dict[int, list[float]] = {}
    for cut, blocks in zip(cuts, inputs, strict=True):
        if cut.periodic:
            levels.setdefault(cut.samples, []).append(float(np.std(blocks)))
    for found in levels.values():
        if max(found) > ALIKE * min(found):
            raise RecordError(
                f"{place}: the rms of '{name}' is {min(found):.3g} to {max(found):.3g} in segments that would be "
                "averaged as realisations; analyse each level by itself, with {level} in a column, a file or where, "
                "and level (--level)"
            )
