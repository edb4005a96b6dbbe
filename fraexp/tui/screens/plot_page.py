"""A page with plots: the keys that move the cursor, the focus and what is seen, and the readout of the curves."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from textual import on
from textual.binding import Binding, BindingType
from textual.events import Click, Resize
from textual.widgets import Static

from fraexp.tui.page import Page
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plot_widget import digit
from fraexp.tui.plotting.plotted_curves import REFERENCE
from fraexp.tui.widgets.readout import readout
from fraexp.views.words import plural

ZOOM = 1.5
"""Factor of one zoom."""
ROWS, HIGH = 3, 16
"""Least rows of the readout in a terminal from so many rows on; in a lower one it has one."""
PAN = 0.2
"""Share of what is seen by which one pan moves."""
DIGITS = 9
"""Curves that have a digit; the letters of others are no keys."""
FAST = 10
"""Columns by which the cursor moves fast."""


class PlotPage(Page):
    """A page whose body has a `PlotStack` and a Static called ``readout``."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left,h", "step(-1)", show=False, id="compare.left", tooltip="cursor left"),
        Binding("right,l", "step(1)", show=False, id="compare.right", tooltip="cursor right"),
        Binding("ctrl+left", f"step(-{FAST})", show=False, id="compare.fast-left", tooltip="cursor left, fast"),
        Binding("ctrl+right", f"step({FAST})", show=False, id="compare.fast-right", tooltip="cursor right, fast"),
        Binding("left_square_bracket,up,k", "focus_curve(-1)", show=False, id="compare.before", tooltip="curve before"),
        Binding("right_square_bracket,down,j", "focus_curve(1)", show=False, id="compare.next", tooltip="next curve"),
        *(Binding(str(n), f"curve({n - 1})", show=False, id=f"compare.curve-{n}", tooltip="hide or show this curve")
          for n in range(1, 10)),
        Binding("full_stop", "hide", show=False, id="compare.hide", tooltip="hide or show the focused curve"),
        Binding("0", "all", show=False, id="compare.all", tooltip="show all curves"),
        Binding("x", "zoom(True,False,True)", show=False, id="compare.zoom-x", tooltip="zoom into x"),
        Binding("X", "zoom(True,False,False)", show=False, id="compare.unzoom-x", tooltip="zoom out of x"),
        Binding("z", "zoom(False,True,True)", show=False, id="compare.zoom-y", tooltip="zoom into y"),
        Binding("Z", "zoom(False,True,False)", show=False, id="compare.unzoom-y", tooltip="zoom out of y"),
        Binding("plus", "zoom(True,True,True)", show=False, id="compare.zoom", tooltip="zoom in"),
        Binding("minus", "zoom(True,True,False)", show=False, id="compare.unzoom", tooltip="zoom out"),
        Binding("H,shift+left", "pan(-1,0)", show=False, id="compare.pan-left", tooltip="move left"),
        Binding("L,shift+right", "pan(1,0)", show=False, id="compare.pan-right", tooltip="move right"),
        Binding("J,shift+down", "pan(0,-1)", show=False, id="compare.pan-down", tooltip="move down"),
        Binding("K,shift+up", "pan(0,1)", show=False, id="compare.pan-up", tooltip="move up"),
        Binding("equals_sign", "home", show=False, id="compare.home", tooltip="show all again"),
        Binding("pageup", "panels(-1)", show=False, id="compare.panels-before", tooltip="panels before"),
        Binding("pagedown", "panels(1)", show=False, id="compare.panels-next", tooltip="next panels"),
        Binding("u", "bands", show=False, id="compare.bands", tooltip="95 % limits, or not"),
        Binding("W", "wrap", show=False, id="compare.wrap", tooltip="phase within ±180 degrees, or unwrapped"),
    ]  # fmt: skip

    @property
    def stack(self) -> PlotStack:
        """The plots."""
        return self.query_one(PlotStack)

    def labels(self) -> dict[int, str]:
        """Return the names of the curves, by their places."""
        return {}

    def tell_view(self) -> None:
        """Tell what is seen now, after it has changed."""
        self.tell_cursor()

    def rows(self, labels: Mapping[int, str]) -> int:
        """Return the number of rows that the readout has for curves."""
        return min(len(labels), max(ROWS, self.size.height // 4) if self.size.height >= HIGH else 1)

    def hints(self, labels: Mapping[int, str]) -> list[str]:
        """Return what is not seen of the curves and of the plots, and the key that shows it."""
        stack = self.stack
        before, after = stack.beyond()
        keys = [key for count, key in ((before, "page up"), (after, "page down")) if count]
        hints = [f"{plural(before + after, 'more panel')}: {', '.join(keys)}"] if keys else []
        if labels and stack.sight.hidden >= labels.keys():
            hints.append("all of these curves are hidden: 0 shows them")
        if self.rows(labels) < len(labels):
            hints.append(f"{self.rows(labels)} of {len(labels)} curves listed: up, down")
        if max(labels, default=0) >= DIGITS:
            hints.append(". hides or shows the focused one")
        return hints

    def tell_cursor(self) -> None:
        """Tell what is at the cursor; values of the panels that are seen come first."""
        labels, stack = self.labels(), self.stack
        if not labels or stack.picture is None:
            return
        place, rows = self.query_one("#readout", Static), self.rows(labels)
        if place.styles.height is None or place.styles.height.value != rows:
            place.styles.height = rows
        columns = place.content_size.width or self.size.width - 2
        panels = stack.picture.panels
        picture = replace(stack.picture, panels=panels[stack.first :] + panels[: stack.first])
        place.update(readout(picture, labels, stack.sight, stack.look, (columns, rows)), layout=False)

    @on(PlotStack.Moved)
    def _moved(self) -> None:
        self.tell_cursor()

    @on(Resize)
    def _resized(self) -> None:
        self.call_after_refresh(self.tell_view)

    @on(Click, "#readout")
    def _clicked(self, event: Click) -> None:
        """Focus the curve of a line; once more hides or shows it."""
        shown = str(self.query_one("#readout", Static).content).splitlines()
        if 0 <= event.y < len(shown):
            labels = self.labels()
            sign = shown[event.y][1:2]
            of = next((of for of in labels if (sign == " ") == (of == REFERENCE) and sign in (digit(of), " ")), None)
            if of is not None and of == self.stack.sight.focus:
                self._toggle(of)
            elif of is not None:
                self._focus(of)

    def action_curve(self, place: int) -> None:
        """Hide or show a curve."""
        if place in self.labels():
            self._toggle(place)

    def _toggle(self, place: int) -> None:
        self.stack.sight.hidden ^= {place}
        self._redraw()

    def action_hide(self) -> None:
        """Hide or show the focused curve: beyond nine no digit does."""
        if self.stack.sight.focus in self.labels():
            self._toggle(self.stack.sight.focus)

    def action_all(self) -> None:
        """Show all curves."""
        self.stack.sight.hidden = set()
        self._redraw()

    def action_focus_curve(self, by: int) -> None:
        """Focus the next curve."""
        places = list(self.labels())
        at = places.index(self.stack.sight.focus) if self.stack.sight.focus in places else 0
        if places:
            self._focus(places[(at + by) % len(places)])

    def _focus(self, place: int) -> None:
        self.stack.sight.focus = place
        self._redraw()

    def action_step(self, columns: int) -> None:
        """Move the cursor."""
        self.stack.step(columns)

    def action_zoom(self, x: bool, y: bool, closer: bool) -> None:
        """Zoom."""
        factor = ZOOM if closer else 1 / ZOOM
        self.stack.zoom(factor if x else 1.0, factor if y else 1.0)
        self.tell_view()

    def action_pan(self, x: int, y: int) -> None:
        """Move what is seen."""
        self.stack.pan(PAN * x, PAN * y)
        self.tell_view()

    def action_home(self) -> None:
        """Show all again."""
        self.stack.home()
        self.tell_view()

    def action_panels(self, by: int) -> None:
        """Show other panels."""
        self.stack.turn(by)
        self.tell_view()

    def action_bands(self) -> None:
        """Show 95 % limits, or not."""
        self.stack.sight.bands ^= True
        self.stack.draw()

    def action_wrap(self) -> None:
        """Wrap the phase, or unwrap it."""
        self.stack.sight.wrapped ^= True
        self._redraw()

    def _redraw(self) -> None:
        self.stack.draw()
        self.tell_view()
