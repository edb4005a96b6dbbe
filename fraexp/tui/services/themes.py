"""The colours of fraexp, dark and light, and the sign and colour of each state.

All text has a contrast of at least 4.5 (WCAG 2.2, level AA) on the backgrounds it is drawn on.
"""

from collections.abc import Mapping
from functools import lru_cache

from rich.text import Text
from textual.style import Style
from textual.theme import Theme

DARK = Theme(
    name="fraexp-dark", dark=True,
    foreground="#dfe5ee", background="#10151c", surface="#161d27", panel="#1f2937",
    primary="#7cb7ff", secondary="#7fd1c7", accent="#f5b83d",
    success="#62d394", warning="#f5b83d", error="#ff8f85",
    variables={
        "text-muted": "#9fadbf", "text-disabled": "#8593a6", "border": "#7cb7ff", "border-blurred": "#3d4b5f",
        "block-cursor-background": "#28466e", "block-cursor-foreground": "#ffffff",
        "block-cursor-blurred-background": "#233247", "block-cursor-blurred-foreground": "#dfe5ee",
        "input-selection-background": "#28466e", "scrollbar": "#3d4b5f", "scrollbar-background": "#161d27",
        "footer-description-foreground": "#c3cedb", "grid": "#2e3a4a", "axis": "#7d8b9e",
    },
)  # fmt: skip
LIGHT = Theme(
    name="fraexp-light", dark=False,
    foreground="#1b2430", background="#fcfcfa", surface="#f2f4f5", panel="#e4e9ee",
    primary="#0b57a4", secondary="#0d645c", accent="#7d4300",
    success="#14602f", warning="#7d4300", error="#a8201a",
    variables={
        "text-muted": "#4b5a6b", "text-disabled": "#5b6979", "border": "#0b57a4", "border-blurred": "#b4bec9",
        "block-cursor-background": "#cbdff7", "block-cursor-foreground": "#0b1f33",
        "block-cursor-blurred-background": "#dde6f0", "block-cursor-blurred-foreground": "#1b2430",
        "input-selection-background": "#cbdff7", "scrollbar": "#b4bec9", "scrollbar-background": "#f2f4f5",
        "footer-description-foreground": "#35424f", "grid": "#d5dbe2", "axis": "#5f6b78",
    },
)  # fmt: skip
STATE_SIGNS = {
    "complete": ("●", "success"),
    "ok": ("●", "success"),
    "running": ("▶", "primary"),
    "measuring": ("▶", "primary"),
    "pending": ("·", "text-muted"),
    "...": ("·", "text-muted"),
    "new": ("○", "text-muted"),
    "measure": ("○", "text-muted"),
    "partial": ("◐", "warning"),
    "stale": ("↻", "warning"),
    "not settled": ("◐", "warning"),
    "inaccurate": ("◐", "warning"),
    "stopping": ("■", "warning"),
    "interrupted": ("■", "warning"),
    "stopped": ("■", "warning"),
    "process lost": ("✗", "error"),
    "broken": ("✗", "error"),
    "failed": ("✗", "error"),
}
"""Sign of a state or outcome, and the name of its colour in the theme; any other outcome is unusable."""
UNUSABLE_SIGN = ("✗", "error")


def state_sign(state: str) -> tuple[str, str]:
    """Return the sign of a state and the name of its colour; a number may precede the state, and text may follow it."""
    text = state.lower().lstrip("0123456789 ")
    found = (sign for name, sign in STATE_SIGNS.items() if text.startswith(name))
    return next(found, UNUSABLE_SIGN)


def state_cell(state: str) -> str:
    """Return the text of a state with its sign before it; empty without a state."""
    return f"{state_sign(state)[0]} {state}" if state else ""


def state_text(cell: str, state: str, colours: Mapping[str, str]) -> Text:
    """Return a text in the colour of a state; `colours` are the variables of the theme."""
    return Text(cell, style=rich_colour(colours, state_sign(state)[1]) if state else "")


def rich_colour(colours: Mapping[str, str], name: str) -> str:
    """Return a colour of the theme in the notation of Rich; `colours` are the variables of the theme.

    Textual's own notation also has opacities, `auto` for a contrast with the background, and the colours of the
    terminal. Only this function gives colours of a theme to Rich.
    """
    return _resolve_colour(colours[name], colours["background"])


@lru_cache
def _resolve_colour(text: str, background: str) -> str:
    style = Style.parse(f"{text} on {background}")
    assert style.foreground is not None and style.background is not None
    colour, ground = style.foreground, style.background
    colour = ground.get_contrast_text(colour.a) if colour.auto else colour
    return (ground + colour if colour.ansi is None else colour).rich_color.name
