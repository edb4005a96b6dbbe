"""How many examples a search is given: all of them in the whole suite, a part in the suite for people."""

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import settings

THOROUGH, QUICK = 100, 12
"""Examples of a property by default; those of others keep the same ratio."""
LEAST = 5


def portion(count: int) -> int:
    """Return how many of `count` examples, those of the whole suite, are tried in this one."""
    return max(round(count * settings().max_examples / THOROUGH), min(count, LEAST))


def thorough(*values: Any) -> Any:
    """Return a parameter set of a test that only the whole suite runs."""
    return pytest.param(*values, marks=pytest.mark.thorough)


def some(values: Iterable[Any], *chosen: Any) -> list[Any]:
    """Return values of a parameter, of which `make test` runs those that are chosen, and the whole suite all."""
    return [value if value in chosen else thorough(value) for value in values]
