"""Texts of messages: ranges of frequencies; and what comes from files, plugins and databases is shown, never obeyed."""

import unicodedata
from collections.abc import Iterable


def frequency_text(frequency: Iterable[float]) -> str:
    """Return the range of some frequencies [Hz], such as ``2 to 80 Hz``; ``2 Hz`` if it is one."""
    values = sorted(frequency)
    low, high = f"{values[0]:.4g}", f"{values[-1]:.4g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"


UNPRINTABLE_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the writing direction or break lines."""


def printable(text: str) -> str:
    """Return a text as one line in which control and formatting characters are written as escapes."""
    return "".join(
        repr(character)[1:-1] if unicodedata.category(character) in UNPRINTABLE_CATEGORIES else character
        for character in text
    )
