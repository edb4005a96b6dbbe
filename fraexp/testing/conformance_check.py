"""What a check is: a named sentence about a component, and a function that finds where it is broken."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from fraexp.components.kinds import Component

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

StrategyMaker = Callable[[type[Component]], "SearchStrategy[Any]"]
"""Makes the hypothesis strategy of a check's examples for a component class."""


class ViolationError(Exception):
    """A component breaks the sentence of a check; the text is the reason, in one line."""


class NotApplicableError(Exception):
    """An example says nothing about a check; the text is the reason, in one line."""


@dataclass(frozen=True)
class Check:
    """One named sentence about a component."""

    body: Callable[[Any], None]
    """Raises ViolationError for an example (or for the class itself) that breaks the sentence."""
    make_strategy: StrategyMaker | None = None
    """Makes the strategy that draws the examples; None for a check of the class itself."""
    examples: int = 1
    """Number of examples that are tried."""
    quick_examples: int = 1
    """Number of examples in a quick check, which compiles nothing; 0 if it is left out of that."""
    is_compiled: bool = False
    """Whether it compiles a law, or asks for signals that compiled code has made."""
    shrinks: bool = True
    """Whether, once an example breaks the check, a smaller one is searched for."""

    @property
    def name(self) -> str:
        """Its name in reports and in `expected_failures`: that of the function."""
        return self.body.__name__.replace("_", "-")

    @property
    def meaning(self) -> str:
        """The sentence: the documentation of the function."""
        return " ".join(inspect.cleandoc(self.body.__doc__ or "").split())

    def quick(self) -> "Check":
        """Return the quick form of the check."""
        return replace(self, examples=self.quick_examples, is_compiled=False, shrinks=False)


def require(condition: object, reason: str) -> None:
    """Raise ViolationError with a reason unless the condition holds."""
    if not condition:
        raise ViolationError(reason)
