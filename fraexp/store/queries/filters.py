"""The language of filters: ``estimator=effective_input excitation.amplitude>=12 -tag:baseline``."""

import math
import re
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from fraexp.data import units
from fraexp.errors import FilterError, ParameterError

OPERATORS = ("!=", ">=", "<=", "=", ">", "<", ":")
"""Longer ones first."""
OPERATOR = re.compile("|".join(OPERATORS))
QUOTED = re.compile(r'"(?:\\.|[^"\\])*"', re.DOTALL)
ESCAPED = re.compile(r"\\(.)", re.DOTALL)
TERM = re.compile(rf'(?:{QUOTED.pattern}|[^\s"])+', re.DOTALL)
COMPARISON = re.compile(
    rf'(?P<field>(?:{QUOTED.pattern}|(?!{OPERATOR.pattern})[^"])*)(?P<operator>{OPERATOR.pattern})(?P<value>.*)',
    re.DOTALL,
)
"""A term with an operator outside of quotes."""
LONG_WORD = re.compile(r"[^\W\d_]{5}")
"""Five letters, which no symbol of a unit has: coulomb is a friction law."""
FIELDS_OF_TEXT = ("key", "state", "outcome", "source", "study", "tag", "message", "created")
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


def parse_filter(text: str) -> list[Condition]:
    """Return the conditions of a filter, which must all hold; FilterError if a term is invalid."""
    if '"' in QUOTED.sub("", text):
        raise FilterError(f"filter: a quote is not closed in {text.strip()!r}")
    return [_parse_condition(term) for term in _join_terms(TERM.findall(text))]


def _join_terms(terms: Iterable[str]) -> list[str]:
    """Return terms in which blanks around an operator, and before a unit, separate nothing."""
    joined: list[str] = []
    for term in terms:
        before = COMPARISON.match(joined[-1]) if joined else None
        lacks_value = before is not None and not before["value"]
        continues_word = bool(joined) and before is None and OPERATOR.match(term)
        if lacks_value or continues_word:
            joined[-1] += term
        elif before is not None and _is_unit_of(before, term):
            joined[-1] += f" {term}"
        else:
            joined.append(term)
    return joined


def _is_unit_of(comparison: "re.Match[str]", word: str) -> bool:
    """Return whether a word is the unit, or a further part of the unit, of the number that is compared with."""
    field, value = _unquote(comparison["field"]), _unquote(comparison["value"])
    number = units.NUMBER.match(value)
    may_have_unit = field.removeprefix("-") not in FIELDS_OF_TEXT
    if not (number and may_have_unit) or '"' in word or not word[:1].isalpha() or LONG_WORD.search(word):
        return False
    return unit_in(f"1 {value[number.end() :]} {word}") != ""


def _unquote(text: str) -> str:
    """Return a text without its quotes; in quotes a backslash escapes a letter."""
    return QUOTED.sub(lambda quoted: ESCAPED.sub(r"\1", quoted[0][1:-1]), text)


def _parse_condition(written: str) -> Condition:
    term, negated = _unquote(written), written.startswith("-")
    body = written.removeprefix("-")
    if comparison := COMPARISON.match(body):
        field, operator, value = (_unquote(part) for part in comparison.groups())
        _check_condition(term, field, value)
        return Condition(term, field, operator.replace("!", ""), value, negated != (operator == "!="))
    word = _unquote(body)
    if not word:
        raise FilterError(f"filter: {term!r} is empty; expected a word, or a term such as tag:baseline")
    return Condition(term, "", ":", word, negated)


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
