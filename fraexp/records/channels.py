"""Channels of a record: how a study writes a column of a file, its quantity in SI units, and its probable role."""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fraexp.components.parameters import Parameters, param
from fraexp.data import units
from fraexp.data.signals import RecordTable
from fraexp.data.sweep import Plain
from fraexp.errors import FraexpError, ParameterError, RecordError

COLUMN_WITH_UNIT = re.compile(r"^(?P<column>.*\S)(?!(?<!\s)\[\d+\]$)\s*\[(?P<unit>[^\]]*)\]$")
"""A text with a unit in square brackets, such as ``iq [A]``; a number directly behind the name is an index."""
NUMBER_PATTERN = r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?"
SCALED_COLUMN = re.compile(
    rf"^(?P<inner>\S.*?)\s++(?P<operator>[*/])\s++(?P<gain>{NUMBER_PATTERN})(?:\s++(?P<sign>[+-])\s++(?P<offset>{NUMBER_PATTERN}))?$"
)
"""A column with a gain, such as ``volts * 31.5`` or ``counts / 4096 + 0.5``; blanks separate signs from names."""
COLUMN_SUM = re.compile(r"^(?P<column>\S.*?)\s+(?P<sign>[+-])\s+(?P<other>\S.*)$")
QUOTED = re.compile(r'^"(?P<column>[^"]+)"$')
"""A column whose name contains signs, such as ``"Amplitude - Force"``."""
MAX_TEXT_LENGTH = 1000
"""Maximum length of a channel's text: longer ones take long to parse."""
FORMULA_HINT = (
    "expected such as 'volts * 31.5', '(volts - 2.5) * 31.5 + 4' or '(a - b) / 2', with blanks around the signs"
)
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
SAMPLE_TIMES = 5e-8, 0.5
"""Sample times between which those of machines lie [s]."""
TIME_NAMES = re.compile(r"time|t|zeit|timestamp", re.IGNORECASE)
"""Names of a column that is the time even if it is uneven."""
RATE_NAMES = re.compile(r"fs|f_s|f_?samp\w*|sampl(e|ing)_?(rate|freq\w*)|abtastrate", re.IGNORECASE)
"""Names of a number that is the sample rate."""
SAMPLE_TIME_NAMES = re.compile(r"ts|dt|sampl(e|ing)_?(time|period)|abtastzeit", re.IGNORECASE)
"""Names of a number that is the sample time."""


class Channel(Parameters):
    """A column of the file with the conversion of its numbers: (column ± another) · scale + offset, in `unit`."""

    column: str = param("", "name of the column in the file")
    unit: str = param("", "unit of the numbers in the file, such as mm; 1 for a pure number", "")
    scale: float = param("1", "factor on the numbers, such as -1", 1.0)
    offset: float = param("", "what is added to the scaled numbers, in the unit", 0.0)
    plus: str = param("", "another column, which is added before scaling", "")
    minus: str = param("", "another column, which is subtracted before scaling", "")
    integrate: int = param(
        "1", "times the channel is integrated over time, to have displacement; below 0: differentiated", 0,
        at_least=-2, at_most=2,
    )  # fmt: skip

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        return tuple(name for name in (self.column, self.plus, self.minus) if name)

    def model_post_init(self, context: object) -> None:
        """Check that there are one or two columns."""
        if not self.column:
            raise ParameterError("column is empty; expected the name of a column in the file")
        if self.plus and self.minus:
            raise ParameterError(f"column '{self.column}' has plus and minus; expected only one of them")


def parse_channel(value: object, place: str) -> Channel:
    """Return the channel that a study describes by a table or a text; ParameterError if it is invalid."""
    if isinstance(value, Channel):
        return value
    if isinstance(value, str):
        if len(value) > MAX_TEXT_LENGTH:
            raise ParameterError(f"{place} has {len(value):,} letters; expected no more than {MAX_TEXT_LENGTH:,}")
        short = COLUMN_WITH_UNIT.match(value)
        unit = {"unit": short["unit"]} if short else {}
        return Channel.parse({**_parse_formula(short["column"] if short else value, place), **unit}, place)
    if not isinstance(value, Mapping):
        raise ParameterError(f"{place} is {value!r}; expected the name of a column, or a table with column and unit")
    return Channel.parse(value, place)


def _parse_formula(text: str, place: str) -> dict[str, Any]:
    """Return columns, scale and offset of a text such as ``(a - b) * 0.5 + 3``; other texts are names of columns."""
    scaled = None if QUOTED.match(text) else SCALED_COLUMN.match(text)
    if not scaled:
        return _parse_sum(_without_parentheses(text), 1.0)
    gain = float(scaled["gain"])
    if scaled["operator"] == "/" and not 0 < abs(gain) < math.inf:
        raise ParameterError(f"{place}: '{text}' divides by {gain:g}; {FORMULA_HINT}")
    scale = gain if scaled["operator"] == "*" else 1 / gain
    inner = scaled["inner"]
    is_sum = _without_parentheses(inner) == inner and not QUOTED.match(inner) and COLUMN_SUM.match(inner)
    if is_sum or SCALED_COLUMN.match(inner):
        raise ParameterError(f"{place}: '{text}' is ambiguous; {FORMULA_HINT}")
    found = _parse_sum(_without_parentheses(inner), scale)
    offset = float(f"{scaled['sign']}1") * float(scaled["offset"]) if scaled["offset"] else 0.0
    total = found.get("offset", 0.0) + offset
    return {**found, "scale": scale, **({"offset": total} if total else {})}


def _without_parentheses(text: str) -> str:
    """Return a text without the parentheses around all of it."""
    return text[1:-1].strip() if text.startswith("(") and text.endswith(")") else text


def column_text(name: str) -> str:
    """Return how a column is written in a channel's text: in quotes if its name would be taken for a formula."""
    try:
        is_plain = parse_channel(name, "") == Channel(column=name)
    except ParameterError:
        is_plain = False
    return name if is_plain or '"' in name else f'"{name}"'


def _parse_sum(text: str, scale: float) -> dict[str, Any]:
    if quoted := QUOTED.match(text):
        return {"column": quoted["column"]}
    found = COLUMN_SUM.match(text)
    if not found:
        return {"column": text}
    if re.fullmatch(NUMBER_PATTERN, found["other"]):
        return {"column": found["column"], "offset": scale * float(f"{found['sign']}1") * float(found["other"])}
    if COLUMN_SUM.match(found["other"]):
        raise ParameterError(f"'{text}' has more than two columns; {FORMULA_HINT}")
    return {"column": found["column"], "plus" if found["sign"] == "+" else "minus": found["other"]}


SIGNAL_UNITS = frozenset(("1", "N", "N m", "N/m", "A", "V", "W", "Pa", "K", "s", "1/s"))
SIGNAL_UNITS |= {f"{of}{per}" for of in ("m", "rad") for per in ("", "/s", "/s**2", "/s**3")}
"""SI units of what is measured on machines."""


def clock_unit(column: str, values: NDArray[np.float64] | None = None) -> str:
    """Return the unit of a column of time for which neither the file nor the study states one; empty if it is unknown.

    Its name shows it, or its size, since 1970; else it is the second, or the day of a spreadsheet, if that makes a step
    which machines have.
    """
    if named := CLOCK_ENDINGS.get(re.split(r"[_ .]|(?<=[a-z])(?=[A-Z])", column)[-1].lower()):
        return named
    if values is None or values.size < 2:
        return "s"
    largest, step = float(np.abs(values).max()), float(np.median(np.diff(values)))
    epoch = next((unit for size, unit in EPOCH_UNITS if largest > size), "")
    least, most = SAMPLE_TIMES
    return epoch or next((unit for unit, day in (("s", 1.0), ("day", 86400.0)) if least < step * day < most), "")


def resolve_channel(name: str, channel: Channel, table: RecordTable, path: Path, default: str = "") -> PlainTable:
    """Return column, SI unit and factor of a channel as plain data; `default` is the unit of a column without one."""
    stated = {column: unit for column in channel.columns if (unit := table.units.get(column) or _named_unit(column))}
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
    factor, short = signal_unit(unit, f"{path.name}, channel '{name}'")
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


def signal_unit(unit: str, place: str) -> tuple[float, str]:
    """Return the factor to SI and the SI unit of a signal of a machine; ParameterError for that of anything else.

    The parser of units knows carats, atomic masses and gausses by what instruments write for counts and ratios.
    """
    factor, short = si_unit(unit, place)
    if short not in SIGNAL_UNITS:
        raise ParameterError(
            f"{place}: '{unit}' would be {factor:.4g} {short}, which is no unit of a machine's signal; expected one of "
            "force, torque, current, voltage, power, pressure, position, angle, speed, acceleration or a number: for "
            "counts or ratios give the factor ('y=position * 0.5 [um]'), for a weight kgf or lbf, for gravity g_0"
        )
    return factor, short


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


EXACT_ROLES = {
    "u": "u", "y": "y", "r": "r", "x": "y", "input": "u", "output": "y", "reference": "r", "excitation": "excitation",
    "response": "y", "w": "frequency", "millis": "time", "micros": "time",
}  # fmt: skip
"""Names that are a role themselves."""
CLOCK_PATTERNS = {"sample rate": rf"{RATE_NAMES.pattern}|rate", "sample time": rf"{SAMPLE_TIME_NAMES.pattern}|t_s"}
"""Names of single numbers."""
NAME_PATTERNS = {
    "time": rf"{TIME_NAMES.pattern}|x_?values?|x-axis",
    "coherence": r"coh\w*|gamma2?",
    "magnitude": r"mag|magnitude|gain|ampl?itude_?ratio|betrag|db",
    "phase": r"pha(se)?|phi|arg",
    "real": r"re(al)?(_?part)?",
    "imaginary": r"im(ag\w*)?",
    "frequency": r"freq\w*|hz|omega|frequenz",
    "excitation": r"inj\w*|exc\w*|anreg\w*|dither|perturb\w*|disturb\w*|multisine|chirp|prbs|noise",
    "segment": r"level|lvl|segment|step|run|amplitude|ampl?",
    "ignored": r"err(or)?|lag|schlepp\w*|following|diff|status|state|flags?|temp\w*|id|index|count(er)?|sample|valid"
    r"|alarm",
    "u": r"[uf]\d|volts?|voltage|control\w*|ctrl|force\w*|kraft|effort"
    r"|thrust|current\w*|strom|iq\w*|torque\w*|moment|drive"
    r"|dac\w*|m?fu|tau|trq|hammer",
    "y": r"[xy]\d?|pos\w*|enc\w*|counts|inc\w*|scale|laser|disp\w*|angle|winkel|theta\w*|q\d?|acc\w*|a\d|vel\w*|speed"
    r"|resp\w*|weg|geschw\w*|ist\w*|drehzahl|omega_?\w*",
}
"""Usual names of channels, as whole words, by their role."""
COMMAND_WORDS = re.compile(r"r|ref\w*|set\w*|soll\w*|target|desired|des|dem(and)?\w*|sp|cmd|command\w*")
"""Words of a commanded quantity: a commanded position is a reference, a commanded force an input."""
UNIT_ROLES = {
    "m": "y", "rad": "y", "m/s": "y", "rad/s": "y", "m/s**2": "y", "rad/s**2": "y", "N": "u", "A": "u", "V": "u",
    "N m": "u", "s": "time", "1/s": "frequency",
}  # fmt: skip
"""Probable role by the SI unit."""
COUNT_UNITS = ("sequence", "samples", "sample")
"""What oscilloscopes write as the unit of a column that counts samples."""
RATE_UNITS = ("m/s", "rad/s")
ACCELERATION_UNITS = ("m/s**2", "rad/s**2")
WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
DRIVE_PARAMETER = re.compile(r"^[rp]\d+(?:\[\d+\])?\s*:?\s+(?=\S)")
"""Number of a drive's parameter before its name, such as ``r482[0]: Encoder 1``."""
NAMESAKE = re.compile(r" #\d+$")
"""Number of a column among those of the same name."""
UNREADABLE = "unreadable"
"""What stands in place of the role of a variable that holds no numbers, or cannot be read."""
CLOCK_ROLES = tuple(CLOCK_PATTERNS)
NAME_SCORE, WORD_SCORE, UNIT_SCORE = 8, 4, 2
VELOCITY_PENALTY, ACCELERATION_PENALTY = 1, 2


class Role(NamedTuple):
    """A probable role, and how much speaks for it."""

    name: str
    """Such as time, u, y, r, excitation or segment; empty if nothing supports a guess."""
    score: int


@dataclass(frozen=True)
class FileContent:
    """A variable of a file."""

    name: str
    shape: tuple[int, ...]
    unit: str
    guess: str
    """Its probable role; empty if it is unknown."""
    score: int = 0
    """How much speaks for the role."""

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
    def has_unit(self) -> bool:
        """Whether the file or the end of the name states its unit."""
        return is_usable_unit(self.unit) or self.name.rpartition("_")[2] in NAME_ENDING_UNITS

    @property
    def quantity(self) -> str:
        """Text of a channel with it, with a unit if the file has none."""
        ending = self.name.rpartition("_")[2]
        usual = clock_unit(self.name) if self.guess == "time" else ROLE_UNITS.get(self.guess, "UNIT")
        guessed = NAME_ENDING_UNITS.get(ending, usual)
        written = column_text(self.column)
        if is_usable_unit(self.unit):
            return written
        return f"{written} * 1 [{guessed}]" if is_unknown_unit(self.unit) else f"{written} [{guessed}]"


ROLE_UNITS = {"segment": "1"}
NAME_ENDING_UNITS = {
    unit: unit for unit in ("mm", "um", "nm", "m", "N", "mN", "Nm", "V", "mV", "A", "mA", "rad", "deg", "s", "ms")
}
NAME_ENDING_UNITS |= {unit: unit for unit in ("us", "ns", "kN", "mNm", "uV", "mrad", "urad", "Hz", "kHz", "dB")}
NAME_ENDING_UNITS |= {"g": "g_0", "mps2": "m/s^2", "mps": "m/s", "rpm": "rpm", "radps": "rad/s"}
"""Units at the end of names, such as ``force_N``."""


def _named_unit(column: str) -> str:
    """Return the unit at the end of a column's name; a single letter may mean anything, such as the motor."""
    ending = column.rpartition("_")[2]
    return NAME_ENDING_UNITS.get(ending, "") if len(ending) > 1 else ""


def is_auxiliary(name: str) -> bool:
    """Say whether a name is that of a counter, a state or another column that is no signal."""
    return any(re.fullmatch(NAME_PATTERNS["ignored"], word) for word in _words(name))


def _short_name(name: str) -> str:
    """Return a name without the structures that contain it and a drive's parameter."""
    plain = DRIVE_PARAMETER.sub("", NAMESAKE.sub("", name))
    return next((part.strip() for part in reversed(plain.split(".")) if not part.isdigit()), plain)


def _words(name: str) -> list[str]:
    """Return the words of a name in lower case."""
    return [word.lower() for word in WORDS.findall(_short_name(name).partition("(")[0])]


def is_usable_unit(unit: str) -> bool:
    """Say whether a unit that a file states is one: instruments also write words there, such as inc."""
    with suppress(FraexpError):
        signal_unit(unit, "")
        return bool(unit.strip())
    return False


def guess_role(name: str, unit: str, shape: Sequence[int]) -> Role:
    """Return the probable role of a variable with its score; no role if neither name nor unit supports one.

    A name that is a role counts most, then a word in the name, then the unit. Where word and unit contradict each
    other there is no role.
    """
    if 0 in shape:
        return Role(UNREADABLE, 0)
    short, words = _short_name(name).lower(), _words(name)
    if int(np.prod(shape)) <= 1:
        return Role(_matching(CLOCK_PATTERNS, [short, *words]), 0)
    by_unit = _unit_role(unit)
    if short in EXACT_ROLES and unit.strip().lower() not in COUNT_UNITS:
        return Role(EXACT_ROLES[short], NAME_SCORE)
    by_name = _matching(NAME_PATTERNS, [short, *words])
    if by_name == "magnitude" and by_unit != "magnitude" and _matching({"phase": NAME_PATTERNS["phase"]}, words):
        by_name = "phase"  # such as Gain: Phase
    if is_auxiliary(name):
        return Role("", 0)
    if unit.strip().lower() in COUNT_UNITS:
        return Role("index", 0)
    return _joint_role(by_name, by_unit, unit, words)


def _joint_role(by_name: str, by_unit: str, unit: str, words: Sequence[str]) -> Role:
    """Return the role that name and unit support together."""
    signals = ("u", "y")
    is_command = any(COMMAND_WORDS.fullmatch(word) for word in words)
    role = by_name or by_unit
    if by_name in signals and by_unit in signals:
        role = by_unit  # a spring's force may be called position's, but N stays a force
    elif by_name and by_unit and by_name != by_unit and {by_name, by_unit} & {"time"}:
        return Role("", 0)
    score = WORD_SCORE * (by_name == role) + UNIT_SCORE * (by_unit == role)
    if not role and is_command:
        return Role("r", WORD_SCORE)
    if role == "y" and is_command:
        return Role("r", score)
    if role == "u" and is_command:
        score -= 1  # the measured force is nearer to what the machine feels
    return Role(role, score - _rate_penalty(unit, words)) if role else Role("", 0)


def _rate_penalty(unit: str, words: Sequence[str]) -> int:
    """Return what a velocity or an acceleration loses against a position."""
    short = ""
    with suppress(FraexpError):
        short = si_unit(unit, "")[1]
    if short in ACCELERATION_UNITS or any(word.startswith("acc") for word in words):
        return ACCELERATION_PENALTY
    is_rate = short in RATE_UNITS or any(
        word.startswith(("vel", "speed", "geschw", "drehz", "omega")) for word in words
    )
    return VELOCITY_PENALTY if is_rate else 0


def _unit_role(unit: str) -> str:
    text = unit.strip()
    if text.lower() == "db":
        return "magnitude"
    with suppress(FraexpError):
        if text and text not in UNITLESS_MARKS and text != "g":
            return "frequency" if text in ("Hz", "kHz") else UNIT_ROLES.get(si_unit(text, "")[1], "")
    return "y" if text in ("g", "inc", "counts", "cts") else ""


def _matching(patterns: dict[str, str], words: Sequence[str]) -> str:
    """Return the role of the first word that has one; one that numbers segments counts if no other word has a role."""
    roles = [role for word in words for role, pattern in patterns.items() if re.fullmatch(pattern, word)]
    return next((role for role in roles if role != "segment"), next(iter(roles), ""))
