"""A small plot of sweeps beside a list, with the names of its curves: what Compare would show first."""

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.text import Text
from textual import work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Static

from fraexp.components.registry import Registry
from fraexp.data.texts import printable
from fraexp.errors import FraexpError
from fraexp.store import Store
from fraexp.tui.plotting.compared_sweeps import compare_sweeps, read_marked_sweeps
from fraexp.tui.plotting.plot_stack import PlotStack
from fraexp.tui.plotting.plotted_curves import Picture
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


class PlotsWithNames(Vertical):
    """Plots above the names of their curves."""

    app: "FraexpApp"

    def __init__(self, title: str) -> None:
        super().__init__(classes="panel")
        self.border_title = title

    def compose(self) -> ComposeResult:
        """Put the names below the plots."""
        yield PlotStack()
        yield Static(id="names")

    @property
    def stack(self) -> PlotStack:
        """The plots."""
        return self.query_one(PlotStack)

    def show_picture(self, picture: Picture | None, labels: Mapping[int, str], note: str = "") -> None:
        """Show a picture, the names of its curves by place, and a note below them."""
        self.stack.display_picture(picture, cursor=False)
        names = self.stack.legend(labels)
        self.query_one("#names", Static).update(names.append(f"\n{note}" if names and note else note))


class PreviewPlot(PlotsWithNames):
    """The curves of some sweeps; hidden while there are none."""

    def __init__(self, title: str = "Preview") -> None:
        super().__init__(title)
        self._keys: tuple[str, ...] = ()
        self._budget = RefreshBudget(MAX_SHARE)

    @property
    def is_resting(self) -> bool:
        """Whether another preview would take more than its share of the time."""
        return self._budget.is_resting

    def preview(self, keys: Sequence[str]) -> None:
        """Show sweeps, unless they are shown or the plot is hidden."""
        if self.display and tuple(keys) != self._keys:
            self._keys = tuple(keys)
            self._preview(list(keys))

    @work(group="preview", exclusive=True)
    async def _preview(self, keys: list[str]) -> None:
        self._budget.begin()
        backend, labels, note = self.app.backend, dict[int, str](), "nothing to draw: no sweep has a result"
        picture = None
        try:
            gathered = await backend.read(lambda store: read_marked_sweeps(store, keys, MAX_PREVIEWED))
            found = await backend.work(lambda workspace: compare_sweeps(workspace, gathered))
            view = found.default_view
            groups = found.groups(view)
            if groups:
                picture = await asyncio.to_thread(found.picture, view, groups[0], 0)
                every = list(found.labels(view, groups[0]).items())
                more = len(every[MAX_NAMES:]) + len(groups) - 1
                labels, note = dict(every[:MAX_NAMES]), f"… {more} more in Compare" if more else ""
        except FraexpError:  # the screen reports what cannot be read
            note = ""
        if self.is_attached:
            self.stack.view_range.cursor = None
            self.show_picture(picture, labels, note)
            self.call_after_refresh(self._budget.end)


class SidePreview(Vertical):
    """The curves of what is selected in a list, above its details."""

    app: "FraexpApp"

    def __init__(self) -> None:
        super().__init__()
        self._plot = PreviewPlot()
        self._details = Static(id="details", classes="panel")
        self._details.border_title = "Details"

    def compose(self) -> ComposeResult:
        """Put the plot above the details."""
        yield self._plot
        yield self._details

    @work(group="preview", exclusive=True)
    async def select(self, read: Callable[[Store], Selected]) -> None:
        """Show what `read` returns, once the selection rests."""
        if not self.display:
            return
        await asyncio.sleep(SELECTION_DELAY_S)
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
