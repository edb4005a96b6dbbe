"""Gauges of motion and force beside their limits."""

from collections.abc import Sequence
from typing import Any

from textual.content import Content
from textual.widgets import Static

from fraexp.tui.plotting.panels import prefixed_text
from fraexp.tui.services.measurement_feed import LimitedMotion
from fraexp.views.run_progress import EMPTY, FULL

PREDICTED_SIGN, MARGIN_SIGN = "┃", "│"
"""Signs on a bar: what is predicted, and where the margin begins that predicted motion leaves free."""
MIN_BAR, MAX_BAR = 16, 60
"""Least cells of a bar beside its value: with less room it is below it; and most cells of a bar."""
OTHER_CELLS = 13
"""Cells of a line beside name, value and bar."""


class LimitGauges(Static):
    """A bar for each limited quantity: how much of its limit is used, what is predicted, and where the margin begins.

    No bar depends on its colour: the part of the limit stands beside it, with a sign where the margin is used.
    """

    DEFAULT_CSS = "LimitGauges { height: auto; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }"

    def __init__(self, title: str) -> None:
        super().__init__(classes="panel")
        self.border_title = title
        self._shown: tuple[Any, ...] = ()

    def show(
        self, motions: Sequence[LimitedMotion], margin: float, used: Sequence[float], predicted: Sequence[float]
    ) -> None:
        """Show what is used of each limit, and what is predicted; both are demands, and may be empty."""
        wanted = (tuple(motions), margin, tuple(used), tuple(predicted), self.content_size.width)
        if wanted != self._shown:
            self._shown = wanted
            text = self._text(motions, margin, used, predicted)
            height = text.plain.count("\n") + 1
            self.update(text, layout=height != self.content_size.height)  # a layout draws the whole screen

    def on_resize(self) -> None:
        """Draw bars of another length."""
        if self._shown:
            motions, margin, used, predicted, _ = self._shown
            self.show(motions, margin, used, predicted)

    def _text(
        self, motions: Sequence[LimitedMotion], margin: float, used: Sequence[float], predicted: Sequence[float]
    ) -> Content:
        names = max((len(motion.name) for motion in motions), default=0)
        values = max((len(_value_text(motion, used)) for motion in motions), default=0)
        width = self.content_size.width or MAX_BAR
        bar = width - names - values - OTHER_CELLS
        is_narrow = bar < MIN_BAR
        bar = min(width if is_narrow else bar, MAX_BAR)
        lines = []
        for motion in motions:
            now = used[motion.place] / motion.limit if used else 0.0
            expected = (predicted[motion.place] if predicted else motion.predicted) / motion.limit
            colour = "$error" if now > 1 else "$warning" if now > 1 - margin else "$success"
            gauge = Content.styled(_bar_text(now, expected, 1 - margin, bar), colour)
            share = f" {100 * (now if used else expected):3.0f} %" if used or expected else ""
            value = Content.assemble(
                f"{_value_text(motion, used):<{values}}{share}",
                ("" if colour == "$success" else " !", f"bold {colour}"),
            )
            parts = (value, "\n", gauge) if is_narrow else (gauge, "  ", value)
            lines.append(Content.assemble((f"{motion.name:<{names}}  ", "bold"), *parts))
        return Content("\n").join(lines)


def _value_text(motion: LimitedMotion, used: Sequence[float]) -> str:
    """Return a value beside its limit; without a value what is predicted, and the limit alone without either."""
    value, limit = used[motion.place] if used else motion.predicted, prefixed_text(motion.limit, motion.unit)
    return f"{prefixed_text(float(f'{value:.3g}'), motion.unit)} of {limit}" if used or value else limit


def _bar_text(used: float, predicted: float, margin: float, width: int) -> str:
    """Return a bar of `width` cells; all are parts of a limit."""
    full = min(round(used * width), width)
    cells = [FULL] * full + [EMPTY] * (width - full)
    for part, sign in ((margin, MARGIN_SIGN), (predicted, PREDICTED_SIGN)):
        place = min(int(part * width), width - 1)
        if cells[place] == EMPTY:
            cells[place] = sign
    return "".join(cells)
