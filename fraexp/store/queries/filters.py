"""The language of filters: ``estimator=effective_input excitation.amplitude>=12 -tag:baseline``."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from fraexp.data import units
from fraexp.errors import FilterError, ParameterError

OPERATORS = ("!=", ">=", "<=", "=", ">", "<", ":")
"""Longer ones first."""
LONG_WORD = re.compile(r"[^\W\d_]{5}")
"""Five letters, which no symbol of a unit has: coulomb is a friction law."""


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
    terms = list(_split_terms(text))
    conditions = [_parse_condition(letters) for letters in terms]
    for number, (condition, word) in enumerate(pairwise(conditions)):
        if not any(quoted for _, quoted in terms[number + 1]):
            _check_blank(condition, word)
    return conditions


def _split_terms(text: str) -> Iterator[list[tuple[str, bool]]]:
    """Yield the letters of each term, each with whether it is quoted; in quotes a backslash escapes a letter."""
    letters: list[tuple[str, bool]] = []
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


def _parse_condition(letters: list[tuple[str, bool]]) -> Condition:
    term = _join_letters(letters)
    negated = letters[0] == ("-", False)
    body = letters[1:] if negated else letters
    for start in range(len(body)):
        operator = next((text for text in OPERATORS if _starts_with(body, start, text)), None)
        if operator:
            field, value = _join_letters(body[:start]), _join_letters(body[start + len(operator) :])
            _check_condition(term, field, value)
            return Condition(term, field, operator.replace("!", ""), value, negated != (operator == "!="))
    word = _join_letters(body)
    if not word:
        raise FilterError(f"filter: {term!r} is empty; expected a word, or a term such as tag:baseline")
    return Condition(term, "", ":", word, negated)


def _starts_with(letters: list[tuple[str, bool]], start: int, text: str) -> bool:
    return letters[start : start + len(text)] == [(letter, False) for letter in text]


def _join_letters(letters: list[tuple[str, bool]]) -> str:
    return "".join(letter for letter, _ in letters)


def _check_blank(condition: Condition, word: Condition) -> None:
    """Refuse a unit that a blank separates from its number: it would be a word that is searched everywhere."""
    if word.field or word.negated or not units.NUMBER.fullmatch(condition.value) or LONG_WORD.search(word.value):
        return
    try:
        units.si(word.value)
    except ParameterError:
        return
    raise FilterError(
        f"filter: '{condition.term} {word.value}' has a blank before the unit; expected {condition.term}{word.value}, "
        f'or "{word.value}" in quotes to search for the word'
    )


def _check_condition(term: str, field: str, value: str) -> None:
    if not field:
        raise FilterError(f"filter: '{term}' has no field; expected one such as tag:baseline")
    if not value:
        raise FilterError(f"filter: '{term}' has no value; expected one such as {term}12 or {term}ok")
