"""The language in which sweeps are looked for: ``estimator=proposed excitation.amplitude>=12 -tag:baseline``."""

from collections.abc import Iterator
from dataclasses import dataclass

from fraexp.errors import StoreError

OPERATORS = ("!=", ">=", "<=", "=", ">", "<", ":")
"""Longer ones first."""


@dataclass(frozen=True)
class Condition:
    """One term of a filter: a comparison, or a word that is searched everywhere."""

    term: str
    """As it was written, for what is said of it."""
    field: str
    """Empty for a word that is searched everywhere."""
    operator: str
    """One of OPERATORS, except ``!=``."""
    value: str
    negated: bool = False


def parse(text: str) -> list[Condition]:
    """Return the conditions of a filter, all of which must hold; StoreError says what cannot be understood."""
    return [_condition(letters) for letters in _terms(text)]


def _terms(text: str) -> Iterator[list[tuple[str, bool]]]:
    """Yield the letters of each term, each with whether it stands in quotes; a backslash there keeps the next one."""
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
        raise StoreError(f"filter: a quote is not closed in {text.strip()!r}")
    if letters:
        yield letters


def _condition(letters: list[tuple[str, bool]]) -> Condition:
    term = _joined(letters)
    negated = letters[0] == ("-", False)
    body = letters[1:] if negated else letters
    for start in range(len(body)):
        operator = next((text for text in OPERATORS if _reads(body, start, text)), None)
        if operator:
            field, value = _joined(body[:start]), _joined(body[start + len(operator) :])
            _check(term, field, value)
            return Condition(term, field, operator.replace("!", ""), value, negated != (operator == "!="))
    word = _joined(body)
    if not word:
        raise StoreError(f"filter: {term!r} says nothing; expected a word, or a term such as tag:baseline")
    return Condition(term, "", ":", word, negated)


def _reads(letters: list[tuple[str, bool]], start: int, text: str) -> bool:
    return letters[start : start + len(text)] == [(letter, False) for letter in text]


def _joined(letters: list[tuple[str, bool]]) -> str:
    return "".join(letter for letter, _ in letters)


def _check(term: str, field: str, value: str) -> None:
    if not field:
        raise StoreError(f"filter: '{term}' has no field; expected one such as tag:baseline")
    if not value:
        raise StoreError(f"filter: '{term}' has no value; expected one such as {term}12 or {term}ok")
