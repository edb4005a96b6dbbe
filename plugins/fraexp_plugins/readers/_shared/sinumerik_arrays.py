"""Arrays of numbers in the XML files of a Sinumerik control: base 85, five characters for four bytes."""

import numpy as np
from numpy.typing import NDArray

ALPHABET = b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ!#$`()*+-/:;=?@[]^_{|}~"
GROUP_CHARACTERS = 5
"""Characters for each four bytes, the most significant one first."""
ZERO_SIGN, ZERO_GROUP = ".", "00000"
"""A dot stands for four bytes of zeros."""


def decode_doubles(text: str, count: int) -> NDArray[np.float64]:
    """Return `count` doubles, shape (count,); ValueError if the text holds another number of them or no base 85."""
    table = np.full(256, -1, dtype=np.int64)
    table[np.frombuffer(ALPHABET, dtype=np.uint8)] = np.arange(len(ALPHABET))
    characters = "".join(text.split()).replace(ZERO_SIGN, ZERO_GROUP).encode("latin-1", errors="replace")
    digits = table[np.frombuffer(characters, dtype=np.uint8)]
    if digits.size != 2 * GROUP_CHARACTERS * count or digits.min(initial=0) < 0:
        raise ValueError(f"an array does not hold {count} numbers in base 85")
    powers = len(ALPHABET) ** np.arange(GROUP_CHARACTERS - 1, -1, -1, dtype=np.int64)
    words = digits.reshape(-1, GROUP_CHARACTERS) @ powers
    if words.max(initial=0) >= 1 << 32:
        raise ValueError("an array holds a number of more than four bytes")
    return np.frombuffer(words.astype(">u4").tobytes(), dtype=">f8").astype(np.float64)
