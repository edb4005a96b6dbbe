"""The Bode plot of a measurement: it grows point by point, over the frequencies that are planned."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from fraexp.data.results import Outcome, Result
from fraexp.data.terminal_text import printable
from fraexp.figures.elements.shown import ShownResult
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plotted_curves import bode_picture
from fraexp.tui.services.measurement_feed import LabelledResponse

MIN_PANEL_ROWS = 9
"""Least height of a panel: with less the phase is left out, and the magnitude gets its room."""
LEGEND_PADDING = 4
"""Cells beside the names of the curves."""
AXIS_MARGIN = 0.02
"""Part of its length by which the frequency axis extends beyond the plan."""


class MeasuredBode(Vertical):
    """Magnitude and phase of what the estimators have found so far; a vertical line is at the point that is played."""

    DEFAULT_CSS = """
    MeasuredBode { height: 1fr; }
    MeasuredBode > #empty { height: 1fr; padding: 0 1; color: $text-muted; }
    MeasuredBode.-drawn > #empty { display: none; }
    MeasuredBode > PlotStack { display: none; }
    MeasuredBode.-drawn > PlotStack { display: block; }
    MeasuredBode > #names { height: auto; max-height: 3; padding: 0 1; display: none; }
    MeasuredBode.-drawn > #names { display: block; }
    """

    def __init__(self) -> None:
        super().__init__(classes="panel")
        self.border_title = "Response"
        self._marked: float | None = None

    def compose(self) -> ComposeResult:
        """Put the names of the curves below the plots."""
        yield Static("The response appears here, point by point.", id="empty")
        stack = PlotStack()
        stack.min_panel_rows = MIN_PANEL_ROWS
        yield stack
        yield Static(id="names")

    def show(self, responses: Sequence[LabelledResponse], frequency_range: tuple[float, float]) -> None:
        """Show responses; of several units those of the first one."""
        drawing: Callable[[], object] = partial(self._show, list(responses), frequency_range)
        self.run_worker(drawing, group="picture", exclusive=True)

    async def _show(self, responses: list[LabelledResponse], frequency_range: tuple[float, float]) -> None:
        unit = responses[0][1].unit if responses else ""
        alike = [(label, response) for label, response in responses if response.unit == unit]
        shown = [ShownResult(label, Result(Outcome.OK, response=response)) for label, response in alike]
        picture = await asyncio.to_thread(bode_picture, shown, None) if shown else None
        if not self.is_attached:
            return
        stack = self.query_one(PlotStack)
        low, high = np.log10(frequency_range)
        room = AXIS_MARGIN * max(high - low, 1.0)
        stack.whole_x = float(low - room), float(high + room)
        self.set_class(picture is not None, "-drawn")
        stack.display_picture(picture, cursor=False)
        self.mark(self._marked)
        self.query_one("#names", Static).update(
            stack.legend([label for label, _ in alike], self.size.width - LEGEND_PADDING)
        )
        others = len(responses) - len(alike)
        self.border_subtitle = printable(f"{others} in another unit: after the measurement") if others else ""

    def mark(self, frequency: float | None) -> None:
        """Put the vertical line at a frequency [Hz]."""
        self._marked, stack = frequency, self.query_one(PlotStack)
        if stack.view_range.cursor != frequency:
            stack.view_range.cursor = frequency
            stack.draw()
