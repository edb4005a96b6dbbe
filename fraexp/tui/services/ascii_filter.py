"""What is drawn on a terminal that knows ASCII alone: every other character becomes the nearest one that it has."""

import unicodedata
from functools import lru_cache

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

LIKE = {
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
TABLE = {ord(character): like for characters, like in LIKE.items() for character in characters}
DOTS = range(0x2800, 0x2900)
"""Braille characters, with which curves are drawn."""
LEVELS = " ..:+*#"
"""What stands for so many of a braille character's eight dots."""


@lru_cache(4096)
def ascii_text(text: str) -> str:
    """Return a text of the same width in ASCII."""
    return text if text.isascii() else "".join(_letter(character) for character in text)


def _letter(character: str) -> str:
    code = ord(character)
    if code < 128:
        return character
    if code in DOTS:
        return LEVELS[min((code - DOTS.start).bit_count(), len(LEVELS) - 1)]
    if code in TABLE:
        return TABLE[code]
    simple = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
    wide = 2 if unicodedata.east_asian_width(character) in "WF" else 0 if unicodedata.combining(character) else 1
    return (simple or "?" * wide)[:wide].ljust(wide)


class AsciiOnly(LineFilter):
    """Replaces what a terminal without Unicode cannot show."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Return the segments in ASCII."""
        return [Segment(ascii_text(text), style, control) for text, style, control in segments]
