"""Frequencies in the words of a message."""

from collections.abc import Iterable


def frequency_text(frequency: Iterable[float]) -> str:
    """Return the range of some frequencies [Hz], such as ``2 to 80 Hz``; ``2 Hz`` if it is one."""
    values = sorted(frequency)
    low, high = f"{values[0]:.4g}", f"{values[-1]:.4g}"
    return f"{low} Hz" if low == high else f"{low} to {high} Hz"
