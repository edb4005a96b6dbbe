"""What a check is: a named sentence about a component, and a function that finds where it is broken."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from fraexp.components.kinds import Component

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
    quick_examples: int = 1
    """Examples that are looked at when the check is quick and nothing is compiled; 0 if it is left out then."""
    is_compiled: bool = False
    """Whether it compiles a law, or asks for signals that compiled code has made."""

    shrinks: bool = True
    """Whether the smallest example is looked for once one was found."""

    def quick(self) -> "Check":
        """Return the check as it is when it is to be quick."""
        return replace(self, examples=self.quick_examples, is_compiled=False, shrinks=False)


def of_class(body: Callable[[Any], None], is_compiled: bool = False) -> Check:
    """Return the check of a class that a function with a docstring makes; a compiled one is not quick."""
    return Check(_name(body), _sentence(body), body, quick_examples=int(not is_compiled), is_compiled=is_compiled)


def of_examples(
    body: Callable[[Any], None], draws: Draws, examples: int, quick: int = 0, is_compiled: bool = False
) -> Check:
    """Return the check of drawn examples that a function with a docstring makes, fewer of them when it is quick."""
    return Check(_name(body), _sentence(body), body, draws, examples, quick, is_compiled)


def _name(body: Callable[..., None]) -> str:
    return body.__name__.replace("_", "-")


def _sentence(body: Callable[..., None]) -> str:
    return " ".join(inspect.cleandoc(body.__doc__ or "").split())


def require(true: object, reason: str) -> None:
    """Raise ViolationError with a reason unless something is true."""
    if not true:
        raise ViolationError(reason)
