"""Conversion of columns to quantities: units that agree with the file, and samples in SI units."""

import math
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fraexp.data import units
from fraexp.data.record_table import RecordTable
from fraexp.data.sweep import Plain
from fraexp.errors import ParameterError, RecordError
from fraexp.records.channels import Channel, column_text

PlainTable = dict[str, Any]
"""A table of plain data."""
UNITLESS_MARKS = ("-", "–", "1", "")
"""Units with which instruments mark pure numbers."""
GRAD = re.compile(r"(?<![A-Za-z])grad(?![A-Za-z])", re.IGNORECASE)
"""A word that German drives write for degrees, and others for a hundredth of a right angle."""
PER_MINUTE = re.compile(r"(?:1\s*/\s*min|/min|min\s*(?:\^|\*\*)?\s*\(?-1\)?|min⁻¹)")
"""Revolutions per minute as DIN 1301 and drives write them: as a bare number per minute they would be 2π off."""
REMARK = re.compile(r"(?:un)?filtered|actual|measured|command(?:ed)?|ist|soll|ch(?:annel)?[ .]?\d+", re.IGNORECASE)
"""What people write in the brackets behind a name, and is no unit."""
CLOCK_ENDINGS = dict.fromkeys(("s", "sec"), "s") | dict.fromkeys(("ms", "msec", "millis"), "ms") | {
    "us": "us", "usec": "us", "micros": "us", "ns": "ns",
}  # fmt: skip
"""Units of a time by the last word of its name, such as ``time_us`` or ``millis``."""


EPOCH_UNITS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Units of time stamps since 1970 by their size: in seconds they are about 2e9."""


def clock_unit(column: str, values: NDArray[np.float64] | None = None) -> str:
    """Return the unit of a column of time for which neither the file nor the study states one: by name, then size."""
    named = CLOCK_ENDINGS.get(re.split(r"[_ .]", column)[-1])
    largest = float(np.abs(values).max()) if values is not None and values.size else 0.0
    return named or next((unit for size, unit in EPOCH_UNITS if largest > size), "s")


def resolve_channel(name: str, channel: Channel, table: RecordTable, path: Path, default: str = "") -> PlainTable:
    """Return column, SI unit and factor of a channel as plain data; `default` is the unit of a column without one."""
    stated = {column: table.units[column] for column in channel.columns if table.units.get(column)}
    for column, unit in stated.items() if channel.unit and abs(channel.scale) == 1 else ():
        check_unit(name, channel, column, unit, path)  # another scale converts one quantity into another
    unit = channel.unit or next(iter(stated.values()), default)
    if len({text.strip() for text in stated.values()}) > 1 and not channel.unit:
        raise RecordError(
            f"{path.name}, channel '{name}': its columns are in {' and '.join(stated.values())}; expected one unit"
        )
    if not unit:
        raise ParameterError(
            f"{path.name}: channel '{name}' has no unit; give unit = such as mm, or 1 for a pure number"
        )
    factor, short = si_unit(unit, f"{path.name}, channel '{name}'")
    if channel.scale == 0:
        raise ParameterError(f"{path.name}, channel '{name}': scale is 0; expected another number")
    more: PlainTable = {key: getattr(channel, key) for key in ("plus", "minus", "integrate") if getattr(channel, key)}
    if channel.offset:
        more["offset"] = factor * channel.offset
    if channel.integrate:
        _, short = si_unit(f"({short})*s**{channel.integrate}", path.name)
    return {"column": channel.column, "unit": short, "scale": factor * channel.scale, **more}


def channel_columns(channel: Plain) -> set[str]:
    """Return the columns of a channel in plain data."""
    return {channel[key] for key in ("column", "plus", "minus") if key in channel}


def check_unit(name: str, channel: Channel, column: str, stated: str, path: Path) -> None:
    """Refuse a channel whose unit contradicts the one that the file states for a column, by RecordError."""
    if _is_remark(stated):
        return
    place = f"{path.name}, channel '{name.strip()}'"
    ours, theirs = si_unit(channel.unit, place), _readings(stated)
    if not theirs:
        _check_unknown_unit(channel, column, stated, place)
        return
    if all(ours[1] != short for _, short in theirs):
        raise RecordError(
            f"{place}: the unit is given as {channel.unit}, but the file says {stated} for column "
            f"'{column}'; choose the other column, or correct the unit"
        )
    if not any(math.isclose(ours[0], factor, rel_tol=1e-9) for factor, _ in theirs):
        raise RecordError(
            f"{place}: the unit is given as {channel.unit}, but the file says {stated}; "
            "leave the unit out or correct it"
        )


def is_unknown_unit(stated: str) -> bool:
    """Say whether a file states a unit that is not known here, such as inc."""
    return not _is_remark(stated) and not _readings(stated)


def _is_remark(stated: str) -> bool:
    return stated.strip() in UNITLESS_MARKS or bool(REMARK.fullmatch(stated.strip()))


def _readings(stated: str) -> list[tuple[float, str]]:
    """Return what the unit that a file states may mean: factors to SI with SI units; none if it is not known."""
    texts = ["g_0"] if stated.strip() == "g" else list(dict.fromkeys(GRAD.sub(unit, stated) for unit in ("deg", "gon")))
    found = []
    for text in texts:
        with suppress(ParameterError):
            found.append(si_unit(text, ""))
    return found


def _check_unknown_unit(channel: Channel, column: str, stated: str, place: str) -> None:
    """Refuse a unit beside one of the file that is not known, unless a factor, if only 1, says how the numbers are."""
    if channel.unit.strip() in UNITLESS_MARKS or "scale" in channel.model_fields_set:
        return
    raise RecordError(
        f"{place}: the unit is given as {channel.unit}, but the file says '{stated}' for column '{column}', which is "
        f"no known unit; state the factor, such as '{column_text(column)} * 1 [{channel.unit}]' where the numbers are "
        f"in {channel.unit}"
    )


def si_unit(unit: str, place: str) -> tuple[float, str]:
    """Return the factor to SI and the SI unit of a unit that a study or a file states."""
    if unit.strip() == "g":
        raise ParameterError(f"{place}: 'g' is the gram; write g_0 for an acceleration in standard gravities")
    if GRAD.search(unit):
        raise ParameterError(
            f"{place}: '{unit}' may be degrees, as in German, or gradians; give unit = deg or gon ('NAME=COLUMN [deg]')"
        )
    if PER_MINUTE.fullmatch(unit.strip()):
        unit = "rpm"
    try:
        return units.si("1" if unit.strip() in UNITLESS_MARKS else unit.strip())
    except ParameterError as error:
        raise ParameterError(f"{place}: {error}") from None
    except Exception:  # a file's header may contain anything, for which the parser of units raises anything
        raise ParameterError(f"{place}: '{unit}' is not a usable unit; give unit = such as mm, rad or 1") from None


def channel_values(table: RecordTable, channel: Plain, name: str, path: Path) -> NDArray[np.float64]:
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


def auxiliary_values(name: str, channel: Channel, table: RecordTable, default: str, path: Path) -> NDArray[np.float64]:
    """Return the samples of the time or frequency, shape (n,), in the unit `default`."""
    plain = resolve_channel(name, channel, table, path, default)
    if plain["unit"] != units.si(default)[1]:
        raise ParameterError(f"{path.name}: the {name} is in '{plain['unit']}'; expected a unit such as {default}")
    return np.asarray(table.columns[channel.column] * plain["scale"])
