"""Columns become quantities: units that agree with the file's, and samples in SI units."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fraexp.components.kinds import RecordTable
from fraexp.data import units
from fraexp.errors import ParameterError, RecordError
from fraexp.records.channels import Channel

Plain = dict[str, Any]
PURE = ("-", "–", "1", "")
"""How instruments write that a number has no unit."""


def in_si(name: str, channel: Channel, table: RecordTable, path: Path, default: str = "") -> Plain:
    """Return column, SI unit and factor to it of a channel, as plain data; `default` is for a column without unit."""
    stated = {column: table.units[column] for column in channel.columns if table.units.get(column)}
    for column, unit in stated.items() if channel.unit and abs(channel.scale) == 1 else ():
        _check_unit(name, channel, column, unit, path)  # another scale turns one quantity into another
    unit = channel.unit or next(iter(stated.values()), default)
    if len({text.strip() for text in stated.values()}) > 1 and not channel.unit:
        raise RecordError(
            f"{path.name}, channel '{name}': its columns are in {' and '.join(stated.values())}; expected one unit"
        )
    if not unit:
        raise ParameterError(
            f"{path.name}: channel '{name}' has no unit; give unit = such as mm, or 1 for a pure number"
        )
    factor, short = si_of(unit, f"{path.name}, channel '{name}'")
    if channel.scale == 0:
        raise ParameterError(f"{path.name}, channel '{name}': scale is 0; expected another number")
    more: Plain = {key: getattr(channel, key) for key in ("plus", "minus", "integrate") if getattr(channel, key)}
    if channel.offset:
        more["offset"] = factor * channel.offset
    if channel.integrate:
        _, short = si_of(f"({short})*s**{channel.integrate}", path.name)
    return {"column": channel.column, "unit": short, "scale": factor * channel.scale, **more}


def columns_of(channel: Mapping[str, Any]) -> set[str]:
    """Return the columns that a channel in plain data is made of."""
    return {channel[key] for key in ("column", "plus", "minus") if key in channel}


def _check_unit(name: str, channel: Channel, column: str, stated: str, path: Path) -> None:
    if stated.strip() in PURE:
        return
    try:
        theirs = si_of(stated, "")
    except ParameterError:  # a remark in brackets
        return
    place = f"{path.name}, channel '{name.strip()}'"
    ours = si_of(channel.unit, place)
    if ours[1] != theirs[1]:
        raise RecordError(
            f"{place}: the unit is given as {channel.unit}, but the file says {stated} for column "
            f"'{column}'; choose the other column, or correct the unit"
        )
    if not math.isclose(ours[0], theirs[0], rel_tol=1e-9):
        raise RecordError(
            f"{place}: the unit is given as {channel.unit}, but the file says {stated}; "
            "leave the unit out or correct it"
        )


def si_of(unit: str, place: str) -> tuple[float, str]:
    """Return the factor to SI and the SI unit of a unit that a study or a file states."""
    if unit.strip() == "g":
        raise ParameterError(f"{place}: 'g' is the gram; write g_0 for an acceleration in standard gravities")
    try:
        return units.si("1" if unit.strip() in PURE else unit.strip())
    except ParameterError as error:
        raise ParameterError(f"{place}: {error}") from None
    except Exception:  # what stands in a file's header may be anything, and the parser of units raises anything
        raise ParameterError(
            f"{place}: '{unit}' is no unit that can be used; give unit = such as mm, rad or 1"
        ) from None


def values_of(table: RecordTable, channel: Mapping[str, Any], name: str, path: Path) -> np.ndarray:
    """Return the samples of a channel in SI units, shape (n,); RecordError if they do not vary."""
    samples = table.columns[channel["column"]]
    if "plus" in channel:
        samples = samples + table.columns[channel["plus"]]
    if "minus" in channel:
        samples = samples - table.columns[channel["minus"]]
    if samples.size and samples.min() == samples.max():
        raise RecordError(
            f"{path.name}: channel '{name}' (column '{channel['column']}') is constant, {samples[0]:g}; "
            "expected a signal: choose another column"
        )
    return np.ascontiguousarray(samples * channel["scale"] + channel.get("offset", 0.0))


def auxiliary_values(name: str, channel: Channel, table: RecordTable, default: str, path: Path) -> np.ndarray:
    """Return the samples of the time or frequency, shape (n,), in the unit `default`."""
    plain = in_si(name, channel, table, path, default)
    if plain["unit"] != units.si(default)[1]:
        raise ParameterError(f"{path.name}: the {name} is in '{plain['unit']}'; expected a unit such as {default}")
    return np.asarray(table.columns[channel.column] * plain["scale"])
