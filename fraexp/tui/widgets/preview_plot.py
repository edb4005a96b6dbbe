"""A small plot of sweeps beside a list, with the names of its curves: what Compare would show first."""

import asyncio
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.timer import Timer
from textual.widgets import Static

from fraexp.components.registry import Registry
from fraexp.data.terminal_text import printable
from fraexp.errors import FraexpError
from fraexp.store import Store
from fraexp.tui.plotting.compared_sweeps import ComparedSweeps, compare_sweeps, read_marked_sweeps
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.views.fields import run_fields, sweep_fields

if TYPE_CHECKING:
    from fraexp.tui.app import FraexpApp

MAX_REST_S = 60.0
"""Longest rest."""
MAX_FIRST_REST_S = 10.0
"""Longest rest after the first turn, which also imports what it needs."""


class RefreshBudget:
    """Bounds the processor time of repeated work to a share of the time, by a rest after each turn."""

    def __init__(self, share: float) -> None:
        self._share = share
        self._began: float | None = None
        self._rest_until = 0.0
        self._longest_rest = MAX_FIRST_REST_S

    @property
    def is_resting(self) -> bool:
        """Whether another turn would take more than the share."""
        return time.monotonic() < self._rest_until

    def begin(self) -> None:
        """Note that a turn begins."""
        self._began = time.process_time()

    def end(self) -> None:
        """Note that a turn is done, with all that it made the process do."""
        if self._began is not None:
            rest = (time.process_time() - self._began) / self._share
            self._rest_until = time.monotonic() + min(rest, self._longest_rest)
            self._began, self._longest_rest = None, MAX_REST_S


WITH_RESULT = "-state=pending -state=failed"
"""Filter of the sweeps that have a result."""
Selected = tuple[list[str], list[tuple[str, str]]]
"""Keys of sweeps, and names and values of the details."""
SELECTION_DELAY_S = 0.15
"""Seconds for which a selection rests before it is read: holding an arrow key reads nothing."""
MAX_PREVIEWED = 400
"""Maximum number of sweeps that are read for a preview."""
MAX_NAMES = 6
"""Maximum number of names below the plot."""
MAX_SHARE = 0.015
"""Maximum share of the time that repeated previews may take: a run needs the processors."""


class PreviewPlot(Vertical):
    """The curves of some sweeps; hidden while there are none."""

    DEFAULT_CSS = """
    PreviewPlot { height: 1fr; display: none; }
    PreviewPlot > PlotStack { height: 1fr; }
    PreviewPlot > #names { height: auto; max-height: 7; padding: 0 1; }
    """
    app: "FraexpApp"

    def __init__(self, title: str = "Preview") -> None:
        super().__init__(classes="panel")
        self.border_title = title
        self._keys: tuple[str, ...] = ()
        self._budget = RefreshBudget(MAX_SHARE)

    def compose(self) -> ComposeResult:
        """Put the names below the plots."""
        yield PlotStack()
        yield Static(id="names")

    @property
    def is_resting(self) -> bool:
        """Whether another preview would take more than its share of the time."""
        return self._budget.is_resting

    def preview(self, keys: Sequence[str]) -> None:
        """Show sweeps, unless they are shown or the plot is hidden."""
        if self.display and tuple(keys) != self._keys:
            self._keys = tuple(keys)
            reading: Callable[[], object] = partial(self._preview, list(keys))
            self.run_worker(reading, group="preview", exclusive=True)

    async def _preview(self, keys: list[str]) -> None:
        self._budget.begin()
        backend, stack = self.app.backend, self.query_one(PlotStack)
        try:
            gathered = await backend.read(lambda store: read_marked_sweeps(store, keys, MAX_PREVIEWED))
            found = await backend.work(lambda workspace: compare_sweeps(workspace, gathered))
            view = found.default_view
            group = next(iter(found.groups(view)), "")
            picture = await asyncio.to_thread(found.picture, view, group, 0) if group else None
        except FraexpError:  # the screen reports what cannot be read
            picture, found, view, group = None, None, "", ""
        if not self.is_attached:
            return
        stack.view_range.cursor = None
        stack.display_picture(picture, cursor=False)
        self.query_one("#names", Static).update(self._names(found, view, group))
        self.call_after_refresh(self._budget.end)

    def _names(self, found: ComparedSweeps | None, view: str, group: str) -> Text:
        if found is None or not group:
            return Text("loading …" if not self._keys else "nothing to draw: no sweep has a result")
        styles = self.query_one(PlotStack).curve_styles
        labels = found.labels(view, group)
        text = Text(no_wrap=True, overflow="ellipsis")
        for number, (place, label) in enumerate(list(labels.items())[:MAX_NAMES]):
            text.append("\n" if number else "").append("━━ ", styles.style(place)).append(printable(label))
        more = len(labels) - MAX_NAMES + len(found.groups(view)) - 1
        return text.append(f"\n… {more} more in Compare") if more > 0 else text


class SidePreview(Vertical):
    """The curves of what is selected in a list, above its details."""

    DEFAULT_CSS = """
    SidePreview { width: 2fr; display: none; }
    SidePreview PreviewPlot { display: block; height: 2fr; }
    SidePreview #details { height: 1fr; min-height: 6; padding: 0 1; }
    """
    app: "FraexpApp"

    def __init__(self) -> None:
        super().__init__()
        self._timer: Timer | None = None
        self._plot = PreviewPlot()
        self._details = Static(id="details", classes="panel")
        self._details.border_title = "Details"

    def compose(self) -> ComposeResult:
        """Put the plot above the details."""
        yield self._plot
        yield self._details

    def select(self, read: Callable[[Store], Selected]) -> None:
        """Show what `read` returns, once the selection rests."""
        if self._timer:
            self._timer.stop()
        if self.display:
            self._timer = self.set_timer(SELECTION_DELAY_S, lambda: self._read(read))

    def _read(self, read: Callable[[Store], Selected]) -> None:
        reading: Callable[[], object] = partial(self._show, read)
        self.run_worker(reading, group="preview", exclusive=True)

    async def _show(self, read: Callable[[Store], Selected]) -> None:
        try:
            keys, fields = await self.app.backend.read(read)
        except FraexpError:  # deleted meanwhile
            keys, fields = [], []
        if self.is_attached:
            self._plot.preview(keys)
            text = Text("\n").join(
                Text(f"{name}  ", "bold").append(printable(value), "not bold") for name, value in fields if value
            )
            self._details.update(text)


def selected_run(store: Store, number: int) -> Selected:
    """Return the sweeps of a run that have a result, and its details."""
    return store.keys(WITH_RESULT, number), run_fields(store.run(number))


def selected_sweep(store: Store, key: str, registry: Registry) -> Selected:
    """Return a sweep, and its details."""
    return [key], sweep_fields(store.find(key), registry)
