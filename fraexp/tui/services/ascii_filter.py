"""A filter for terminals without Unicode: every character becomes the most similar one in ASCII."""

import unicodedata
from functools import lru_cache

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

ASCII_LIKE = {
    "─━╌╍┄┅┈┉═╴╶╸╺⎯▔▁": "-",
    "│┃╎╏┆┇┊┋║▏▕▎▊▌▐▍": "|",
    "┌┐└┘├┤┬┴┼┏┓┗┛┣┫┳┻╋╭╮╰╯╔╗╚╝╠╣╦╩╬╇╈╉╊╀╁╂╃╄╅╆┡┩": "+",
    "█▉▓▒▀▄▖▗▘▙▚▛▜▝▞▟■": "#",
    "░": ":",
    "●•∙·⬤◉": "*",
    "○◌◯": "o",
    "▶▸►❯›→⏵": ">",
    "◀◂◄❮‹←": "<",
    "▲▴↑⏶": "^",
    "▼▾↓⏷": "v",
    "✓✔": "x",
    "✗✘×": "x",
    "…": "~",
    "⏎↵": "<",
    "−–—‐": "-",
    "ωΩ": "w",
    "σ": "s",
    "ζ": "z",
    "µμ": "u",
    "Δ∆": "d",
    "∠": "/",
    "±": "~",
    "≥": ">",
    "≤": "<",
    "∞": "8",
    "°": "o",
    "²": "2",
    "³": "3",
    "“”„": '"',
    "‘’′": "'",
}
ASCII_BY_CODE = {ord(character): like for characters, like in ASCII_LIKE.items() for character in characters}
BRAILLE_CODES = range(0x2800, 0x2900)
"""Codes of the braille characters, with which curves are drawn."""
DOT_DENSITIES = " ..:+*#"
"""Characters in place of a braille character, by its number of dots."""


@lru_cache(4096)
def ascii_text(text: str) -> str:
    """Return a text of the same width in ASCII."""
    return text if text.isascii() else "".join(_ascii_character(character) for character in text)


def _ascii_character(character: str) -> str:
    code = ord(character)
    if code < 128:
        return character
    if code in BRAILLE_CODES:
        return DOT_DENSITIES[min((code - BRAILLE_CODES.start).bit_count(), len(DOT_DENSITIES) - 1)]
    if code in ASCII_BY_CODE:
        return ASCII_BY_CODE[code]
    simple = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    wide = 2 if unicodedata.east_asian_width(character) in "WF" else 0 if unicodedata.combining(character) else 1
    return (simple or "?" * wide)[:wide].ljust(wide)


class AsciiFilter(LineFilter):
    """Replaces characters that a terminal without Unicode cannot show."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments in ASCII."""
        return [Segment(ascii_text(text), style, control) for text, style, control in segments]
