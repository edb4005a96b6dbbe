"""Colours, dashes and digits that distinguish curves, on dark and light terminals."""

from dataclasses import dataclass
from typing import Any

from textual.app import App

from fraexp.tui.plotting.plotted_curves import REFERENCE
from fraexp.tui.services.themes import rich_colour

ON_DARK = ("#56B4E9", "#E69F00", "#CC79A7", "#00B98B", "#F0E442", "#FF7F45")
"""The palette of Okabe and Ito (2008), light enough for a dark background."""
ON_LIGHT = ("#0063A0", "#B04400", "#8E3B6F", "#00694B", "#6B5A00", "#333333")
"""The same hues, dark enough for a light background."""
NEUTRAL_COLOURS = {True: "#D0D0D0", False: "#303030"}
"""Colours of references and cursor, by whether the background is dark."""
AXIS_COLOURS, GRID_COLOURS = {True: "#7d8b9e", False: "#5f6b78"}, {True: "#2e3a4a", False: "#d5dbe2"}
"""Colours of axes and grid, by whether the background is dark, for themes without such colours."""
DASHES = ((1, 1), (5, 7), (2, 4))
"""Dots drawn, and dots of a period: one pair after the other when the colours repeat."""


@dataclass(frozen=True)
class CurveStyles:
    """Colours and digits that distinguish curves."""

    dark: bool = True
    digits: bool = False
    """Whether curves carry digits, as colours do not distinguish them."""
    axis: str = AXIS_COLOURS[True]
    grid: str = GRID_COLOURS[True]

    @classmethod
    def of_app(cls, app: App[Any]) -> "CurveStyles":
        """Return the styles for the theme of an application; with none or 16 colours, curves carry digits."""
        dark, colours = app.current_theme.dark, app.theme_variables
        wanted = (("axis", AXIS_COLOURS), ("grid", GRID_COLOURS))
        axis, grid = (rich_colour(colours, name) if name in colours else of[dark] for name, of in wanted)
        few = not app.is_headless and app.console.color_system == "standard"
        return cls(dark, app.no_color or few, axis, grid)

    @property
    def neutral(self) -> str:
        """Colour of references and cursor."""
        return NEUTRAL_COLOURS[self.dark]

    def style(self, of: int) -> str:
        """Return the style of a curve."""
        colours = ON_DARK if self.dark else ON_LIGHT
        return self.neutral if of == REFERENCE else colours[of % len(colours)]

    def dash(self, of: int, model: bool = False) -> tuple[int, int]:
        """Return the dash of a curve."""
        if of == REFERENCE:
            return 3, 6
        return (1, 2) if model else DASHES[of // len(ON_DARK) % len(DASHES)]


def curve_digit(of: int) -> str:
    """Return the character of a curve: 1 to 9, then letters."""
    return "123456789abcdefghijklmnopqrstuvwxyz"[of % 35]
