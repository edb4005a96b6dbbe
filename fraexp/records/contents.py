"""Contents of a measured file, and a proposal of the command that imports it."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fraexp.components.registry import Registry
from fraexp.data.record_table import RecordTable
from fraexp.data.units import si
from fraexp.errors import FraexpError, RecordError
from fraexp.records.clocks import RATE_NAMES, SAMPLE_TIME_NAMES, TIME_NAMES
from fraexp.records.quantities import UNITLESS_MARKS
from fraexp.records.repeats import detect_period
from fraexp.records.source import existing_file, find_reader
from fraexp.records.timebase import sample_rate_of

ContentLister = Callable[[Path], Mapping[str, tuple[tuple[int, ...], str]]]
"""Signature of a reader's optional `list_contents`: shape and unit of each variable of a file, by name."""
NAME_PATTERNS = {
    "time": TIME_NAMES.pattern,
    "sample rate": rf"{RATE_NAMES.pattern}|rate",
    "sample time": rf"{SAMPLE_TIME_NAMES.pattern}|t_s",
    "frequency": r"freq\w*|f_hz",
    "segment": r"level|lvl|segment|step|run|amplitude|ampl?",
    "excitation": r"inj\w*|exc\w*|anreg\w*|dither|perturb\w*|disturb\w*|multisine|chirp|prbs",
    "r": r"r|ref\w*|setpoint|set_?pos\w*|soll\w*|target|desired|command(ed)?_?pos\w*",
    "u": r"u\d?|v|volts?|voltage|cmd|control\w*|ctrl|force\w*|kraft|thrust|current|iq\w*|torque|drive|dac\w*|f|fu",
    "y": r"y\d?|x\d?|pos\w*|enc\w*|counts?|inc\w*|scale|laser|disp\w*|angle|theta\w*|acc\w*|vel\w*|resp\w*|weg|ist\w*",
}
"""Usual names of columns, as whole words, by their probable role."""
UNIT_ROLES = {"m": "y", "rad": "y", "m/s": "y", "m/s**2": "y", "N": "u", "A": "u", "V": "u", "N*m": "u", "s": "time"}
"""Probable role of a column by its SI unit."""
NAME_SEPARATORS = re.compile(r"[_.\s\d]+")
NUMBERED_NAME = re.compile(r"^(?P<head>.*?)(?P<number>\d+)(?P<tail>\D*)$")
UNREADABLE = "unreadable"
"""What stands in place of the role of a variable that holds no numbers, or cannot be read."""
CLOCK_ROLES = ("sample rate", "sample time")


@dataclass(frozen=True)
class FileContent:
    """A variable of a file."""

    name: str
    shape: tuple[int, ...]
    unit: str
    guess: str
    """Its probable role, such as time, u, y, r, excitation or segment; empty if it is unknown."""

    @property
    def size(self) -> int:
        """Number of values."""
        return int(np.prod(self.shape))

    @property
    def column(self) -> str:
        """Name of a signal in it: an array needs an index for each side except samples and periods."""
        sides = [place for place, side in enumerate(self.shape) if side > 1]
        if len(sides) < 2:
            return self.name
        longest = max(sides, key=lambda place: self.shape[place])
        left = {longest, next(place for place in sides if place != longest)} if len(self.shape) > 2 else set(sides)
        return f"{self.name}({','.join(':' if place in left else '1' for place in range(len(self.shape)))})"

    @property
    def quantity(self) -> str:
        """Text of a channel with it, with a unit if the file has none."""
        ending = self.name.rpartition("_")[2]
        guessed = NAME_ENDING_UNITS.get(ending, ROLE_UNITS.get(self.guess, "UNIT"))
        return self.column if self.unit else f"{self.column} [{guessed}]"


ROLE_UNITS = {"time": "s", "frequency": "Hz", "segment": "1"}
NAME_ENDING_UNITS = {
    unit: unit for unit in ("mm", "um", "nm", "m", "N", "mN", "V", "mV", "A", "mA", "rad", "deg", "s", "ms")
}
NAME_ENDING_UNITS |= {"g": "g_0"}
"""Units at the end of names, such as ``force_N``."""


def list_contents(file: Path, registry: Registry, reader: str = "") -> list[FileContent]:
    """Return the variables of a file; RecordError if its reader cannot list them."""
    path = existing_file(file)
    found = find_reader(reader, path, registry)
    listing: ContentLister | None = getattr(found, "contents", None)
    if listing is None:
        raise RecordError(f"{path.name}: reader '{found.name}' cannot list a file; give --channel NAME=COLUMN")
    all_of = [
        FileContent(name, shape, unit, _guess_role(name, unit, shape)) for name, (shape, unit) in listing(path).items()
    ]
    if not all_of:
        raise RecordError(f"{path.name}: nothing in the file can be read; expected columns or variables of numbers")
    return all_of


def _guess_role(name: str, unit: str, shape: Sequence[int]) -> str:
    if 0 in shape:
        return UNREADABLE
    single = int(np.prod(shape)) <= 1
    last = name.rpartition(".")[2].lower()
    for word in (last, *(part for part in NAME_SEPARATORS.split(last) if part)):
        for role, pattern in NAME_PATTERNS.items():
            if re.fullmatch(pattern, word) and (role in CLOCK_ROLES) == single:
                return role
    with suppress(FraexpError):
        if unit.strip() and unit.strip() not in UNITLESS_MARKS and not single:
            return UNIT_ROLES.get(si(unit.strip())[1], "")
    return ""


def propose_import(file: Path, found: Sequence[FileContent], registry: Registry) -> str:
    """Return a command that imports the file; the user must replace words in capitals."""
    signals = [one for one in found if one.size > 1]
    longest = max((one.size for one in signals), default=0)
    alike = [one for one in signals if one.size == longest]
    alike = _matrix_columns(alike)
    chosen = {role: next((one for one in alike if one.guess == role), None) for role in ("u", "y", "r", "excitation")}
    rest = [one for one in alike if not one.guess]
    for role in ("u", "y"):
        chosen[role] = chosen[role] or (rest.pop(0) if rest else None)
    words = ["fraexp", "import", str(file)]
    level = _common_levels(chosen, found)
    for role, one in chosen.items():
        if one or role in ("u", "y"):
            name = "reference" if role == "r" else role
            words += ["--channel", f"{name}={_with_level(one.quantity, level) if one else 'COLUMN [UNIT]'}"]
    if level:
        words += [part for number in level for part in ("--level", number)]
    one = chosen["u"]
    table = _read(file, one.column, registry) if one else None
    words += _clock_options(file, alike, found, registry) if table is None or table.sample_time is None else []
    words += _period_options(one, table.columns[one.column]) if one and table else []
    return shlex.join(words)


def _matrix_columns(alike: Sequence[FileContent]) -> list[FileContent]:
    """Return the columns of the only variable if it is a matrix: they are probably the channels."""
    if len(alike) != 1 or len(alike[0].shape) != 2 or min(alike[0].shape) == 1:
        return list(alike)
    one = alike[0]
    count, length = sorted(one.shape)
    return [FileContent(f"{one.name}.{number + 1}", (length,), "", "") for number in range(count)]


def _common_levels(chosen: Mapping[str, FileContent | None], found: Sequence[FileContent]) -> list[str]:
    """Return the numbers in the names of the chosen variables, if each of these exists with all of them."""
    numbers: list[list[str]] = []
    for one in (chosen["u"], chosen["y"]):
        match = NUMBERED_NAME.match(one.name) if one else None
        if match is None:
            return []
        others = (re.fullmatch(rf"{re.escape(match['head'])}(\d+){re.escape(match['tail'])}", of.name) for of in found)
        numbers.append([other[1] for other in others if other])
    return numbers[0] if numbers[0] == numbers[1] and len(numbers[0]) > 1 else []


def _with_level(text: str, level: Sequence[str]) -> str:
    match = NUMBERED_NAME.match(text.partition("(")[0].partition(" [")[0]) if level else None
    return text if match is None else f"{match['head']}{{level}}{match['tail']}{text[match.end() :]}"


def _clock_options(
    file: Path, alike: Sequence[FileContent], found: Sequence[FileContent], registry: Registry
) -> list[str]:
    time = next((one for one in alike if one.guess == "time"), None)
    if time:
        return ["--time", time.quantity]
    for one in found:
        if one.guess in CLOCK_ROLES:
            value = float(_read_values(file, one.name, registry)[0])
            rate = value if one.guess == "sample rate" else 1 / value if value else 0.0
            if rate > 0:
                return ["--sample-rate", f"{rate:.10g}"]
    return ["--sample-rate", "HZ"]


def _period_options(one: FileContent, values: NDArray[np.float64]) -> list[str]:
    sides = [side for side in one.shape if side > 1]
    if len(sides) > 1:
        return ["--samples-per-period", str(max(sides))]
    period = detect_period(values)
    return ["--samples-per-period", str(period)] if period else ["--aperiodic", "--estimator", "sliding_identification"]


def _read(file: Path, name: str, registry: Registry) -> RecordTable:
    path = existing_file(file)
    return find_reader("", path, registry).read(path, [name])


def _read_values(file: Path, name: str, registry: Registry) -> NDArray[np.float64]:
    return _read(file, name, registry).columns[name]


def clock_fault(file: Path, time: FileContent, registry: Registry) -> str:
    """Return the fault of a column that is probably the time; empty if there is none."""
    try:
        sample_rate_of(_read_values(file, time.name, registry), f"the time in '{time.name}'")
    except RecordError as error:
        return str(error)
    return ""
