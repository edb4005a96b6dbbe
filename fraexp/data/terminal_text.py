"""Text that cannot command a terminal: what comes from files, plugins and databases is shown, never obeyed."""

import unicodedata

UNPRINTABLE_CATEGORIES = ("Cc", "Cf", "Cs", "Zl", "Zp")
"""Unicode categories that move the cursor, turn the writing direction or break lines."""


def printable(text: str) -> str:
    """Return a text as one line in which control and formatting characters are written as escapes."""
    return "".join(
        repr(character)[1:-1] if unicodedata.category(character) in UNPRINTABLE_CATEGORIES else character
        for character in text
    )
