"""Probable role of a variable by its name and unit: the position in a file is no evidence."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fraexp.errors import FraexpError
from fraexp.records.channels import column_text
from fraexp.records.clocks import RATE_NAMES, SAMPLE_TIME_NAMES, TIME_NAMES
from fraexp.records.quantities import UNITLESS_MARKS, clock_unit, is_unknown_unit, si_unit

EXACT_ROLES = {
    "u": "u", "y": "y", "r": "r", "x": "y", "input": "u", "output": "y", "reference": "r", "excitation": "excitation",
    "response": "y", "w": "frequency", "millis": "time", "micros": "time",
}  # fmt: skip
"""Names that are a role themselves."""
CLOCK_PATTERNS = {
    "sample rate": rf"{RATE_NAMES.pattern}|rate",
    "sample time": rf"{SAMPLE_TIME_NAMES.pattern}|t_s",
}
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
    "N*m": "u", "s": "time", "1/s": "frequency",
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


def is_auxiliary(name: str) -> bool:
    """Say whether a name is that of a counter, a state or another column that is no signal."""
    return any(re.fullmatch(NAME_PATTERNS["ignored"], word) for word in _words(name))


def _words(name: str) -> list[str]:
    """Return the words of a name in lower case, without the structures that contain it and a drive's parameter."""
    plain = DRIVE_PARAMETER.sub("", NAMESAKE.sub("", name))
    short = next((part.strip() for part in reversed(plain.split(".")) if not part.isdigit()), plain)
    return [word.lower() for word in WORDS.findall(short.partition("(")[0])]


def is_usable_unit(unit: str) -> bool:
    """Say whether a unit that a file states is one: instruments also write words there, such as inc."""
    with suppress(FraexpError):
        si_unit(unit, "")
        return bool(unit.strip())
    return False


def guess_role(name: str, unit: str, shape: Sequence[int]) -> Role:
    """Return the probable role of a variable with its score; no role if neither name nor unit supports one.

    A name that is a role counts most, then a word in the name, then the unit. Where word and unit contradict each
    other there is no role.
    """
    if 0 in shape:
        return Role(UNREADABLE, 0)
    plain = DRIVE_PARAMETER.sub("", NAMESAKE.sub("", name))
    short = next((part.strip() for part in reversed(plain.split(".")) if not part.isdigit()), plain)
    words = _words(name)
    if int(np.prod(shape)) <= 1:
        return Role(_matching(CLOCK_PATTERNS, [short.lower(), *words]), 0)
    by_unit = _unit_role(unit)
    if short.lower() in EXACT_ROLES and unit.strip().lower() not in COUNT_UNITS:
        return Role(EXACT_ROLES[short.lower()], NAME_SCORE)
    by_name = _matching(NAME_PATTERNS, [short.lower(), *words])
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
