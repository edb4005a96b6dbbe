"""What a check is: a named sentence about a component, and a function that finds where it is broken."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fraexp.components import Component

Draws = Callable[[type[Component]], Any]
"""Makes the hypothesis strategy of a check's examples for a class."""


class ViolationError(Exception):
    """A component breaks the sentence of a check; the text is the reason, in one line."""


class NotApplicableError(Exception):
    """An example says nothing about a check; the text is the reason, in one line."""


@dataclass(frozen=True)
class Check:
    """One named sentence about a component."""

    name: str
    """By which it is named in reports and in `expected_failures`."""
    meaning: str
    """The sentence."""
    body: Callable[[Any], None]
    """Raises ViolationError for an example (or for the class itself) that breaks the sentence."""
    draws: Draws | None = None
    """Strategy of the examples; None for a check of the class itself."""
    examples: int = 1
    """Examples that are looked at."""


def of_class(body: Callable[[Any], None]) -> Check:
    """Return the check of a class that a function with a docstring makes."""
    return Check(_name(body), _sentence(body), body)


def of_examples(body: Callable[[Any], None], draws: Draws, examples: int) -> Check:
    """Return the check of drawn examples that a function with a docstring makes."""
    return Check(_name(body), _sentence(body), body, draws, examples)


def _name(body: Callable[..., None]) -> str:
    return body.__name__.replace("_", "-")


def _sentence(body: Callable[..., None]) -> str:
    return " ".join(inspect.cleandoc(body.__doc__ or "").split())


def require(true: object, reason: str) -> None:
    """Raise ViolationError with a reason unless something is true."""
    if not true:
        raise ViolationError(reason)
