"""A screen with plots: keys for cursor, focus and visible range, and the readout of the curves."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.events import Click, Resize
from textual.widgets import Static

from fraexp.tui.page import Page
from fraexp.tui.plotting.curve_styles import curve_digit
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plotted_curves import REFERENCE
from fraexp.tui.widgets.readout import readout
from fraexp.views.words import plural

ZOOM_FACTOR = 1.5
"""Factor of one zoom step."""
MIN_READOUT_ROWS, MIN_HIGH_ROWS = 3, 16
"""Minimum rows of the readout in a terminal with at least so many rows; a lower one has one."""
PAN_FRACTION = 0.2
"""Fraction of the visible range by which one pan moves."""
MAX_DIGIT_KEYS = 9
"""Number of curves with a digit key; the letters of other curves are not keys."""
FAST_COLUMNS = 10
"""Columns of a fast cursor step."""


class PlotPage(Page):
    """A screen whose body has a `PlotStack` and a Static with the id ``readout``."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left,h", "step(-1)", show=False, tooltip="cursor left"),
        Binding("right,l", "step(1)", show=False, tooltip="cursor right"),
        Binding("ctrl+left", f"step(-{FAST_COLUMNS})", show=False, tooltip="cursor left, fast"),
        Binding("ctrl+right", f"step({FAST_COLUMNS})", show=False, tooltip="cursor right, fast"),
        Binding("left_square_bracket,up,k", "focus_curve(-1)", show=False, tooltip="previous curve"),
        Binding("right_square_bracket,down,j", "focus_curve(1)", show=False, tooltip="next curve"),
        *(Binding(str(n), f"curve({n - 1})", show=False, tooltip="hide or show this curve")
          for n in range(1, 10)),
        Binding("full_stop", "hide", show=False, tooltip="hide or show the focused curve"),
        Binding("0", "all", show=False, tooltip="show all curves"),
        Binding("x", "zoom(True,False,True)", show=False, tooltip="zoom into x"),
        Binding("X", "zoom(True,False,False)", show=False, tooltip="zoom out of x"),
        Binding("z", "zoom(False,True,True)", show=False, tooltip="zoom into y"),
        Binding("Z", "zoom(False,True,False)", show=False, tooltip="zoom out of y"),
        Binding("plus", "zoom(True,True,True)", show=False, tooltip="zoom in"),
        Binding("minus", "zoom(True,True,False)", show=False, tooltip="zoom out"),
        Binding("H,shift+left", "pan(-1,0)", show=False, tooltip="move left"),
        Binding("L,shift+right", "pan(1,0)", show=False, tooltip="move right"),
        Binding("J,shift+down", "pan(0,-1)", show=False, tooltip="move down"),
        Binding("K,shift+up", "pan(0,1)", show=False, tooltip="move up"),
        Binding("equals_sign", "home", show=False, tooltip="show all again"),
        Binding("pageup", "panels(-1)", show=False, tooltip="previous panels"),
        Binding("pagedown", "panels(1)", show=False, tooltip="next panels"),
        Binding("u", "bands", show=False, tooltip="show or hide 95 % limits"),
        Binding("W", "wrap", show=False, tooltip="wrap or unwrap the phase"),
    ]  # fmt: skip

    @property
    def stack(self) -> PlotStack:
        """The plots."""
        return self.query_one(PlotStack)

    def labels(self) -> dict[int, str]:
        """Return the names of the curves, by place."""
        return {}

    def show_view(self) -> None:
        """Show the texts of the view after a change."""
        self.show_readout()

    def rows(self, labels: Mapping[int, str]) -> int:
        """Return the number of rows of the readout."""
        return min(
            len(labels), max(MIN_READOUT_ROWS, self.size.height // 4) if self.size.height >= MIN_HIGH_ROWS else 1
        )

    def hints(self, labels: Mapping[int, str]) -> list[str]:
        """Return hints on hidden curves and panels, with the keys that show them."""
        stack = self.stack
        before, after = stack.beyond()
        keys = [key for count, key in ((before, "page up"), (after, "page down")) if count]
        hints = [f"{plural(before + after, 'more panel')}: {', '.join(keys)}"] if keys else []
        if labels and stack.view_range.hidden >= labels.keys():
            hints.append("all curves are hidden: 0 shows them")
        if self.rows(labels) < len(labels):
            hints.append(f"{self.rows(labels)} of {len(labels)} curves listed: up, down")
        if max(labels, default=0) >= MAX_DIGIT_KEYS:
            hints.append(". hides or shows the focused curve")
        return hints

    def show_readout(self) -> None:
        """Show the values at the cursor, those of visible panels first."""
        labels, stack = self.labels(), self.stack
        if not labels or stack.picture is None:
            return
        place, rows = self.query_one("#readout", Static), self.rows(labels)
        if place.styles.height is None or place.styles.height.value != rows:
            place.styles.height = rows
        columns = place.content_size.width or self.size.width - 2
        panels = stack.picture.panels
        picture = replace(stack.picture, panels=panels[stack.first :] + panels[: stack.first])
        place.update(readout(picture, labels, stack.view_range, stack.curve_styles, (columns, rows)), layout=False)

    @on(PlotStack.Moved)
    def _handle_move(self) -> None:
        self.show_readout()

    @on(PlotStack.Fitted)
    def _handle_fit(self) -> None:
        self.show_view()

    @on(Resize)
    def _handle_resize(self) -> None:
        self.call_after_refresh(self.show_view)

    @on(Click, "#readout")
    def _handle_click(self, event: Click) -> None:
        """Focus the curve of the clicked line; a second click hides or shows it."""
        shown = str(self.query_one("#readout", Static).content).splitlines()
        if 0 <= event.y < len(shown):
            labels = self.labels()
            sign = shown[event.y][1:2]
            of = next(
                (of for of in labels if (sign == " ") == (of == REFERENCE) and sign in (curve_digit(of), " ")), None
            )
            if of is not None and of == self.stack.view_range.focus:
                self._toggle(of)
            elif of is not None:
                self._focus(of)

    def action_curve(self, place: int) -> None:
        """Hide or show a curve."""
        if place in self.labels():
            self._toggle(place)

    def _toggle(self, place: int) -> None:
        self.stack.view_range.hidden ^= {place}
        self._redraw()

    def action_hide(self) -> None:
        """Hide or show the focused curve, also beyond the digit keys."""
        if self.stack.view_range.focus in self.labels():
            self._toggle(self.stack.view_range.focus)

    def action_all(self) -> None:
        """Show all curves."""
        self.stack.view_range.hidden = set()
        self._redraw()

    def action_focus_curve(self, by: int) -> None:
        """Focus the next curve."""
        places = list(self.labels())
        at = places.index(self.stack.view_range.focus) if self.stack.view_range.focus in places else 0
        if places:
            self._focus(places[(at + by) % len(places)])

    def _focus(self, place: int) -> None:
        self.stack.view_range.focus = place
        self._redraw()

    def action_step(self, columns: int) -> None:
        """Move the cursor."""
        self.stack.step(columns)

    def action_zoom(self, x: bool, y: bool, closer: bool) -> None:
        """Zoom."""
        factor = ZOOM_FACTOR if closer else 1 / ZOOM_FACTOR
        self.stack.zoom(factor if x else 1.0, factor if y else 1.0)
        self.show_view()

    def action_pan(self, x: int, y: int) -> None:
        """Move the visible range."""
        self.stack.pan(PAN_FRACTION * x, PAN_FRACTION * y)
        self.show_view()

    def action_home(self) -> None:
        """Show all again."""
        self.stack.home()
        self.show_view()

    def action_panels(self, by: int) -> None:
        """Show other panels."""
        self.stack.turn(by)
        self.show_view()

    def action_bands(self) -> None:
        """Show or hide 95 % limits."""
        self.stack.view_range.bands ^= True
        self.stack.draw()

    def action_wrap(self) -> None:
        """Wrap or unwrap the phase."""
        self.stack.view_range.wrapped ^= True
        self._redraw()

    def _redraw(self) -> None:
        self.stack.draw()
        self.show_view()
