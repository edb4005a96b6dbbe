"""How many examples a search is given: all of them in the whole suite, a part in the suite for people."""

from hypothesis import settings

THOROUGH, QUICK = 100, 20
"""Examples of a property by default; those of others keep the same ratio."""
LEAST = 5


def portion(count: int) -> int:
    """Return how many of `count` examples, those of the whole suite, are tried in this one."""
    return max(round(count * settings().max_examples / THOROUGH), min(count, LEAST))
