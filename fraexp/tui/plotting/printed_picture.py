"""Pictures as lines of text: what the terminal UI would draw of them, without its screen."""

import asyncio
from collections.abc import Mapping
from typing import ClassVar

from rich.segment import Segment
from rich.style import Style
from textual.app import App, ComposeResult

from fraexp.data.terminal_text import printable
from fraexp.tui.plotting.curve_styles import CurveStyles, curve_digit
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plot_widget import Plot
from fraexp.tui.plotting.plotted_curves import REFERENCE, Picture

Lines = list[list[Segment]]
"""The segments of each line."""
DARK_THEME, LIGHT_THEME = "textual-dark", "textual-light"


class PictureApp(App[None]):
    """An application whose only screen is a plot; it runs without a terminal."""

    CSS: ClassVar[str] = "Screen { padding: 0; }"

    def __init__(self, picture: Picture, dark: bool, plain: bool) -> None:
        super().__init__()
        self.picture = picture
        self.no_color = self.no_color or plain
        self.theme = DARK_THEME if dark else LIGHT_THEME

    def compose(self) -> ComposeResult:
        """Yield the plot."""
        yield PlotStack()


def picture_lines(picture: Picture, size: tuple[int, int], dark: bool = True, plain: bool = False) -> Lines:
    """Return a picture in columns and rows of text; `plain`, digits distinguish the curves instead of colours."""
    return asyncio.run(_draw(picture, size, dark, plain))


async def _draw(picture: Picture, size: tuple[int, int], dark: bool, plain: bool) -> Lines:
    app = PictureApp(picture, dark, plain)
    async with app.run_test(size=size) as pilot:
        stack = app.query_one(PlotStack)
        stack.display_picture(picture, cursor=False)
        await pilot.pause()
        shown = [plot for plot in stack.query(Plot) if plot.display]
        return [
            [_without_ground(segment) for segment in plot.render_line(row)]
            for plot in shown
            for row in range(plot.size.height)
        ]


def _without_ground(segment: Segment) -> Segment:
    """Return a segment on the background of the terminal."""
    style = segment.style or Style()
    return Segment(segment.text, Style(color=style.color, bold=style.bold))


def legend_lines(names: Mapping[int, str], dark: bool = True, plain: bool = False) -> Lines:
    """Return a line for each curve: a sample in its colour, or its digit, and its name."""
    styles = CurveStyles(dark, plain)
    lines: Lines = []
    for place, name in names.items():
        sample = "- -" if place == REFERENCE else f" {curve_digit(place)} " if plain else "━━━"
        lines.append([Segment(f"  {sample} ", Style(color=styles.style(place))), Segment(printable(name))])
    return lines
