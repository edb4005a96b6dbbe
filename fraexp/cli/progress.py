"""Progress of a run: a bar on a terminal, a line every few seconds elsewhere; all on stderr."""

import sys
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, TextIO, cast

from fraexp.cli.output import say
from fraexp.cli.standard_streams import TolerantStream
from fraexp.data.texts import printable
from fraexp.execution.events import TimeLeft
from fraexp.views.run_progress import time_text
from fraexp.views.words import duration_text, plural

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

REPORT_INTERVAL_S = 5.0
"""Minimum time between two lines [s]."""
MAX_UNFINISHED_FRACTION = 0.99
"""Greatest fraction that is shown while a sweep is unfinished."""


class ProgressLine:
    """A bar on a terminal while `bar` is open, which disappears at its end; elsewhere a line every few seconds."""

    def __init__(self) -> None:
        self._bar = _make_bar() if sys.stderr.isatty() else None
        self._task = self._bar.add_task("", total=None, count="", visible=False) if self._bar else None
        self._said = time.monotonic()

    @property
    def bar(self) -> AbstractContextManager[object]:
        """What shows the bar as long as it is open."""
        return self._bar or nullcontext()

    def draw(self, doing: str, share: float | None, count: str = "", visible: bool = True) -> bool:
        """Show the bar with what is being done, and how far if that is known; return whether there is one."""
        if self._bar is None or self._task is None:
            return False
        total = None if share is None else 1.0
        self._bar.update(
            self._task, description=printable(doing), completed=share, total=total, count=count, visible=visible
        )
        return True

    def tell(self, parts: Sequence[str]) -> None:
        """Print a line of those parts that are not empty, if the last one was printed some seconds ago."""
        if time.monotonic() - self._said >= REPORT_INTERVAL_S:
            self._said = time.monotonic()
            say(", ".join(filter(None, parts)))


class Meter(ProgressLine):
    """A progress display in sweeps."""

    def __init__(self) -> None:
        super().__init__()
        self.begin()

    def begin(self, reused: int = 0) -> None:
        """Start with another study; its reused sweeps come first."""
        self._started = time.monotonic()
        self._finished = -reused

    def finish(self) -> None:
        """Count a finished sweep."""
        self._finished += 1

    def note(self, text: str) -> None:
        """Show what is being prepared."""
        if not self.draw(text, None):
            say(text)

    def move(
        self, done: float, total: float, running: int | None = None, doing: str = "", left: TimeLeft | None = None
    ) -> None:
        """Show that `done` of `total` sweeps are done, including the finished parts of those that are `running`."""
        finished = max(self._finished, 0)
        share = done / total if total > 0 else 1.0
        share = share if finished >= total else min(share, MAX_UNFINISHED_FRACTION)
        rest = "estimating" if done >= total else time_text(left, "left") if left else ""
        told = [_running_text(done - finished, int(total) - finished, running), rest if total > finished else ""]
        if not self.draw(doing, share, ", ".join(filter(None, [f"{finished}/{int(total)} sweeps", *told]))):
            counted, spent = f"{finished} of {plural(int(total), 'sweep')}", time.monotonic() - self._started
            self.tell([counted, printable(doing), told[0], duration_text(spent), *told[1:]])


def _running_text(part: float, left: int, running: int | None) -> str:
    """Return how many of the remaining sweeps are in progress, and how far if no others are left.

    `part` is the sum of their finished fractions.
    """
    if running is None and left == 1 and part > 0:
        running = 1
    if running is None:
        return "others in progress" if part > 0 and left > 0 else ""
    running = min(running, left)
    if running <= 0:
        return ""
    share = int(100 * part / running)
    return f"{running} in progress" + (f" at {share} %" if running == left and 0 < share < 100 else "")


def _make_bar() -> "Bar":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=30),
        TimeElapsedColumn(),
        TextColumn("{task.fields[count]}", markup=False),
        console=Console(file=cast(TextIO, TolerantStream(sys.stderr))),
        transient=True,
    )
