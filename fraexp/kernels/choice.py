"""A choice between two values that compiled code can make in every lane of a vector."""

from typing import Any


def where(condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` where the condition holds, else `no`; both are computed. For laws without branches."""
    return yes if condition else no
