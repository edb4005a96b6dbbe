"""How tests ask for an error: by its kind and by the names and values that it gives, never by its sentence."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

MAX_WORDS = 3
"""Words of a name, such as a quantity with its unit or a command; more would be a sentence."""


@contextmanager
def refused(kind: type[Exception] | tuple[type[Exception], ...], *names: object) -> Iterator[pytest.ExceptionInfo[Any]]:
    """Expect an error of one line that gives each of these names: places, values, options and remedies.

    A name is found as a whole, so that 1 is not in 12 and 'load' not in 'workload'.
    """
    expected = [str(name) for name in names]
    assert all(len(name.split()) <= MAX_WORDS for name in expected), "a sentence is no name"
    with pytest.raises(kind) as caught:
        yield caught
    text = str(caught.value)
    assert "\n" not in text
    for name in expected:
        # no letter or digit goes on before or behind it, and no decimals do
        whole = rf"(?:\b|(?!\w))(?:(?<!\d\.)|(?!\d)){re.escape(name)}(?:\b|(?<!\w))(?!\.\d)"
        assert re.search(whole, text), f"{name!r} is not in {text!r}"
