"""The language of filters: ``estimator=effective_input excitation.amplitude>=12 -tag:baseline``."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import NamedTuple

from fraexp.data import units
from fraexp.errors import FilterError, ParameterError

OPERATORS = ("!=", ">=", "<=", "=", ">", "<", ":")
"""Longer ones first."""
LONG_WORD = re.compile(r"[^\W\d_]{5}")
"""Five letters, which no symbol of a unit has: coulomb is a friction law."""
FIELDS_OF_TEXT = ("key", "state", "outcome", "source", "study", "tag", "note", "message", "created")
"""Fields whose values have no unit, beside the names of components."""
NUMBER_WITH_UNIT = re.compile(rf"({units.NUMBER.pattern})\s*(.*)", re.DOTALL)
TIME_FORMATS = (("%Y-%m-%d", timedelta(days=1)), ("%Y-%m-%dT%H:%M", timedelta(minutes=1)))


@dataclass(frozen=True)
class Condition:
    """A term of a filter: a comparison, or a word that is searched everywhere."""

    term: str
    """The term as it was written, for messages."""
    field: str
    """Empty for a word that is searched everywhere."""
    operator: str
    """One of OPERATORS, except ``!=``."""
    value: str
    negated: bool = False


Letters = list[tuple[str, bool]]
"""Letters of a term, each with whether it is quoted."""


def parse_filter(text: str) -> list[Condition]:
    """Return the conditions of a filter, which must all hold; FilterError if a term is invalid."""
    return [_parse_condition(letters) for letters in _join_terms(_split_terms(text))]


def _join_terms(terms: Iterable[Letters]) -> list[Letters]:
    """Return terms in which blanks around an operator, and before a unit, separate nothing."""
    joined: list[Letters] = []
    for term in terms:
        before = _operator_place(joined[-1]) if joined else None
        lacks_value = before is not None and sum(before) == len(joined[-1])
        continues_word = bool(joined) and before is None and _operator_place(term, last=0) is not None
        if lacks_value or continues_word:
            joined[-1] = [*joined[-1], *term]
        elif before is not None and _is_unit_of(joined[-1], before, term):
            joined[-1] = [*joined[-1], (" ", False), *term]
        else:
            joined.append(term)
    return joined


def _is_unit_of(term: Letters, place: "OperatorPlace", word: Letters) -> bool:
    """Return whether a word is the unit, or a further part of the unit, of the number that a term ends with."""
    field, value, unit = _join_letters(term[: place.start]), _join_letters(term[sum(place) :]), _join_letters(word)
    number = units.NUMBER.match(value)
    may_have_unit = field.removeprefix("-") not in FIELDS_OF_TEXT
    if not (number and may_have_unit) or any(quoted for _, quoted in word) or not unit[:1].isalpha():
        return False
    return not LONG_WORD.search(unit) and unit_in(f"1 {value[number.end() :]} {unit}") != ""


def _split_terms(text: str) -> Iterator[Letters]:
    """Yield the letters of each term, each with whether it is quoted; in quotes a backslash escapes a letter."""
    letters: Letters = []
    quoted = False
    rest = iter(text)
    for letter in rest:
        if letter == '"':
            quoted = not quoted
            letters.append(("", True))
        elif quoted and letter == "\\":
            letters.append((next(rest, "\\"), True))
        elif letter.isspace() and not quoted:
            if letters:
                yield letters
            letters = []
        else:
            letters.append((letter, quoted))
    if quoted:
        raise FilterError(f"filter: a quote is not closed in {text.strip()!r}")
    if letters:
        yield letters


def _parse_condition(letters: Letters) -> Condition:
    term = _join_letters(letters)
    negated = letters[0] == ("-", False)
    body = letters[1:] if negated else letters
    place = _operator_place(body)
    if place:
        operator = _join_letters(body[place.start : sum(place)])
        field, value = _join_letters(body[: place.start]), _join_letters(body[sum(place) :])
        _check_condition(term, field, value)
        return Condition(term, field, operator.replace("!", ""), value, negated != (operator == "!="))
    word = _join_letters(body)
    if not word:
        raise FilterError(f"filter: {term!r} is empty; expected a word, or a term such as tag:baseline")
    return Condition(term, "", ":", word, negated)


class OperatorPlace(NamedTuple):
    """Where the operator of a term is; both together are where its value begins."""

    start: int
    length: int


def _operator_place(letters: Letters, last: int | None = None) -> OperatorPlace | None:
    """Return the place of the first operator of a term, up to the letter `last`; None for a word."""
    for start in range(len(letters) if last is None else last + 1):
        operator = next((text for text in OPERATORS if _starts_with(letters, start, text)), None)
        if operator:
            return OperatorPlace(start, len(operator))
    return None


def _starts_with(letters: Letters, start: int, text: str) -> bool:
    return letters[start : start + len(text)] == [(letter, False) for letter in text]


def _join_letters(letters: Letters) -> str:
    return "".join(letter for letter, _ in letters)


def _check_condition(term: str, field: str, value: str) -> None:
    if not field:
        raise FilterError(f"filter: '{term}' has no field; expected one such as tag:baseline")
    if not value:
        raise FilterError(f"filter: '{term}' has no value; expected one such as {term}12 or {term}ok")


UnitLookup = Callable[[], Collection[str]]
"""Returns the units that a number can have."""


def no_units() -> Collection[str]:
    """Return no unit, if the units of numbers are unknown."""
    return ()


def parse_number(text: str, kinds: UnitLookup = no_units) -> float | None:
    """Return the number in base units of a text such as ``12`` or ``0.1um``; None if it is not a number.

    FilterError if `kinds` returns units and the text has a unit of another kind.
    """
    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    if not match:
        return None
    value, unit = float(match[1]), match[2].strip()
    if unit:
        try:
            value *= units.si(unit)[0]
        except ParameterError:
            return None
        _check_unit_kind(unit, sorted(kinds()))
    return value if math.isfinite(value) else None


def unit_in(text: str) -> str:
    """Return the unit after a number, such as mm in ``0.1mm``; empty if the text is no number with a known unit."""
    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    unit = match[2].strip() if match else ""
    try:
        return unit if unit and units.si(unit) else ""
    except ParameterError:
        return ""


def is_of_a_kind(unit: str, kinds: Collection[str]) -> bool:
    """Return whether a unit can be converted to one of `kinds`."""
    return any(_unfit_text(unit, kind) == "" for kind in kinds)


def _unfit_text(unit: str, kind: str) -> str:
    """Return why a unit cannot be converted to another one; empty if it can."""
    try:
        units.factor(unit, kind)
    except ParameterError as error:
        return str(error)
    return ""


def _check_unit_kind(unit: str, kinds: Sequence[str]) -> None:
    """Raise FilterError if a unit is of another kind than all of `kinds`."""
    if not kinds or is_of_a_kind(unit, kinds):
        return
    quoting = ", or quotes around a word to search for" if " " in unit else ""
    raise FilterError(" or ".join([_unfit_text(unit, kinds[0]), *(f"'{kind}'" for kind in kinds[1:])]) + quoting)


def parse_time_span(text: str, now: datetime) -> tuple[datetime, datetime]:
    """Return begin and end of a time such as ``today``, a day or a minute, in the time zone of `now`."""
    if text.lower() in ("today", "yesterday"):
        begin = now.replace(hour=0, minute=0, second=0, microsecond=0)
        begin -= timedelta(days=text.lower() == "yesterday")
        return begin, begin + timedelta(days=1)
    for form, length in TIME_FORMATS:
        try:
            begin = datetime.strptime(text, form).astimezone(now.tzinfo)
        except ValueError:
            continue
        return begin, begin + length
    raise FilterError(
        f"filter: '{text}' is not a date; expected one such as 2026-03-31, 2026-03-31T12:00, today or yesterday"
    )
