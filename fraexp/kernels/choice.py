"""A choice between two values that compiled code can make in every lane of a vector."""

from typing import TypeVar

Value = TypeVar("Value")


def where(condition: object, yes: Value, no: Value) -> Value:
    """Return `yes` where the condition holds, else `no`; both are computed. For laws without branches."""
    return yes if condition else no
