"""What is in a file that nobody has described yet, and the command that would probably import it."""

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fraexp.components.registry import Registry
from fraexp.data.units import si
from fraexp.errors import FraexpError, RecordError
from fraexp.records.clocks import RATES, SAMPLE_TIMES, TIMES
from fraexp.records.quantities import PURE
from fraexp.records.repeats import detected_period
from fraexp.records.source import existing, reader_of
from fraexp.records.timebase import rate_of

Listing = Callable[[Path], Mapping[str, tuple[tuple[int, ...], str]]]
"""What a reader may offer as `contents`: sides and unit of all that it can read of a file, by name."""
WORDS = {
    "time": TIMES.pattern,
    "sample rate": rf"{RATES.pattern}|rate",
    "sample time": rf"{SAMPLE_TIMES.pattern}|t_s",
    "frequency": r"freq\w*|f_hz",
    "segment": r"level|lvl|segment|step|run|amplitude|ampl?",
    "excitation": r"inj\w*|exc\w*|anreg\w*|dither|perturb\w*|disturb\w*|multisine|chirp|prbs",
    "r": r"r|ref\w*|setpoint|set_?pos\w*|soll\w*|target|desired|command(ed)?_?pos\w*",
    "u": r"u\d?|v|volts?|voltage|cmd|control\w*|ctrl|force\w*|kraft|thrust|current|iq\w*|torque|drive|dac\w*|f|fu",
    "y": r"y\d?|x\d?|pos\w*|enc\w*|counts?|inc\w*|scale|laser|disp\w*|angle|theta\w*|acc\w*|vel\w*|resp\w*|weg|ist\w*",
}
"""What columns are called, as whole words, by what they probably are."""
ROLES = {"m": "y", "rad": "y", "m/s": "y", "m/s**2": "y", "N": "u", "A": "u", "V": "u", "N*m": "u", "s": "time"}
"""What a column with an SI unit probably is."""
PARTS = re.compile(r"[_.\s\d]+")
NUMBERED = re.compile(r"^(?P<head>.*?)(?P<number>\d+)(?P<tail>\D*)$")
CLOCKS = ("sample rate", "sample time")


@dataclass(frozen=True)
class Content:
    """Something in a file that can be read."""

    name: str
    shape: tuple[int, ...]
    unit: str
    guess: str
    """What it probably is: a role such as time, u, y, r, excitation, segment; empty if the name tells nothing."""

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(np.prod(self.shape))

    @property
    def column(self) -> str:
        """How a signal in it is named: an array needs numbers for all sides but samples and periods."""
        sides = [place for place, side in enumerate(self.shape) if side > 1]
        if len(sides) < 2:
            return self.name
        longest = max(sides, key=lambda place: self.shape[place])
        left = {longest, next(place for place in sides if place != longest)} if len(self.shape) > 2 else set(sides)
        return f"{self.name}({','.join(':' if place in left else '1' for place in range(len(self.shape)))})"

    @property
    def quantity(self) -> str:
        """How a channel of it is given, with its unit if the file does not tell one."""
        ending = self.name.rpartition("_")[2]
        guessed = ENDINGS.get(ending, UNITS.get(self.guess, "UNIT"))
        return self.column if self.unit else f"{self.column} [{guessed}]"


UNITS = {"time": "s", "frequency": "Hz", "segment": "1"}
ENDINGS = {unit: unit for unit in ("mm", "um", "nm", "m", "N", "mN", "V", "mV", "A", "mA", "rad", "deg", "s", "ms")}
ENDINGS |= {"g": "g_0"}
"""Units with which names end, such as ``force_N``."""


def contents(file: Path, registry: Registry, reader: str = "") -> list[Content]:
    """Return all that is in a file; RecordError if its reader cannot list it."""
    path = existing(file)
    found = reader_of(reader, path, registry)
    listing: Listing | None = getattr(found, "contents", None)
    if listing is None:
        raise RecordError(f"{path.name}: reader '{found.name}' cannot list a file; give --channel NAME=COLUMN")
    all_of = [Content(name, shape, unit, _guess(name, unit, shape)) for name, (shape, unit) in listing(path).items()]
    if not all_of:
        raise RecordError(f"{path.name}: nothing in it can be read; expected columns or variables of numbers")
    return all_of


def _guess(name: str, unit: str, shape: Sequence[int]) -> str:
    single = int(np.prod(shape)) <= 1
    last = name.rpartition(".")[2].lower()
    for word in (last, *(part for part in PARTS.split(last) if part)):
        for role, pattern in WORDS.items():
            if re.fullmatch(pattern, word) and (role in CLOCKS) == single:
                return role
    with suppress(FraexpError):
        if unit.strip() and unit.strip() not in PURE and not single:
            return ROLES.get(si(unit.strip())[1], "")
    return ""


def proposal(file: Path, found: Sequence[Content], registry: Registry) -> str:
    """Return a command that would import the file; words in capitals are for the user to fill in."""
    signals = [one for one in found if one.size > 1]
    longest = max((one.size for one in signals), default=0)
    alike = [one for one in signals if one.size == longest]
    alike = _columns(alike)
    chosen = {role: next((one for one in alike if one.guess == role), None) for role in ("u", "y", "r", "excitation")}
    rest = [one for one in alike if not one.guess]
    for role in ("u", "y"):
        chosen[role] = chosen[role] or (rest.pop(0) if rest else None)
    words = ["fraexp", "import", str(file)]
    level = _levels(chosen, found)
    for role, one in chosen.items():
        if one or role in ("u", "y"):
            name = "reference" if role == "r" else role
            words += ["--channel", f"{name}={_leveled(one.quantity, level) if one else 'COLUMN [UNIT]'}"]
    if level:
        words += [part for number in level for part in ("--level", number)]
    words += _clock(file, alike, found, registry)
    one = chosen["u"]
    words += _period(file, one, registry) if one else []
    return shlex.join(words)


def _columns(alike: Sequence[Content]) -> list[Content]:
    """Return the columns of the only variable, if that is a matrix: its channels, most probably."""
    if len(alike) != 1 or len(alike[0].shape) != 2 or min(alike[0].shape) == 1:
        return list(alike)
    one = alike[0]
    count, length = sorted(one.shape)
    return [Content(f"{one.name}.{number + 1}", (length,), "", "") for number in range(count)]


def _levels(chosen: Mapping[str, Content | None], found: Sequence[Content]) -> list[str]:
    """Return the numbers by which names like those chosen differ, if each of these has them all."""
    numbers: list[list[str]] = []
    for one in (chosen["u"], chosen["y"]):
        match = NUMBERED.match(one.name) if one else None
        if match is None:
            return []
        others = (re.fullmatch(rf"{re.escape(match['head'])}(\d+){re.escape(match['tail'])}", of.name) for of in found)
        numbers.append([other[1] for other in others if other])
    return numbers[0] if numbers[0] == numbers[1] and len(numbers[0]) > 1 else []


def _leveled(text: str, level: Sequence[str]) -> str:
    match = NUMBERED.match(text.partition("(")[0].partition(" [")[0]) if level else None
    return text if match is None else f"{match['head']}{{level}}{match['tail']}{text[match.end() :]}"


def _clock(file: Path, alike: Sequence[Content], found: Sequence[Content], registry: Registry) -> list[str]:
    time = next((one for one in alike if one.guess == "time"), None)
    if time:
        return ["--time", time.quantity]
    for one in found:
        if one.guess in CLOCKS:
            value = float(_values(file, one.name, registry)[0])
            rate = value if one.guess == "sample rate" else 1 / value if value else 0.0
            if rate > 0:
                return ["--sample-rate", f"{rate:.10g}"]
    return ["--sample-rate", "HZ"]


def _period(file: Path, one: Content, registry: Registry) -> list[str]:
    sides = [side for side in one.shape if side > 1]
    if len(sides) > 1:
        return ["--period", str(max(sides))]
    period = detected_period(_values(file, one.column, registry))
    return ["--period", str(period)] if period else ["--not-periodic", "--estimator", "sliding_identification"]


def _values(file: Path, name: str, registry: Registry) -> np.ndarray:
    path = existing(file)
    return reader_of("", path, registry).read(path, [name]).columns[name]


def seems_uneven(file: Path, time: Content, registry: Registry) -> str:
    """Return what is wrong with a column that is probably the time, or nothing."""
    try:
        rate_of(_values(file, time.name, registry), f"the time in '{time.name}'")
    except RecordError as error:
        return str(error)
    return ""
