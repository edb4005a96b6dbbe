"""Progress of a run: a bar on a terminal, a line every few seconds elsewhere; all on stderr."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO, cast

from fraexp.cli.output import say
from fraexp.cli.standard_streams import TolerantStream
from fraexp.data.terminal_text import printable
from fraexp.execution.events import TimeLeft
from fraexp.views.run_progress import time_text
from fraexp.views.words import duration_text, plural

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

REPORT_INTERVAL_S = 5.0
"""Minimum time between two lines [s]."""
MAX_UNFINISHED_FRACTION = 0.99
"""Greatest fraction that is shown while a sweep is unfinished."""


class Meter:
    """A progress display in sweeps; a context manager."""

    def __init__(self) -> None:
        self.begin()
        self._said = self._started
        self._bar: Bar | None = make_bar() if sys.stderr.isatty() else None
        self._task = self._bar.add_task("", total=None, count="", visible=False) if self._bar else None

    def __enter__(self) -> Self:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar:
            self._bar.stop()

    def begin(self, reused: int = 0) -> None:
        """Start with another study; its reused sweeps come first."""
        self._started = time.monotonic()
        self._finished = -reused

    def finish(self) -> None:
        """Count a finished sweep."""
        self._finished += 1

    def note(self, text: str) -> None:
        """Show what is being prepared."""
        if self._bar and self._task is not None:
            self._bar.update(self._task, description=printable(text), visible=True)
        else:
            say(text)

    def move(
        self, done: float, total: float, running: int | None = None, doing: str = "", left: TimeLeft | None = None
    ) -> None:
        """Show that `done` of `total` sweeps are done, including the finished parts of those that are `running`."""
        now, finished = time.monotonic(), max(self._finished, 0)
        share = done / total if total > 0 else 1.0
        share = share if finished >= total else min(share, MAX_UNFINISHED_FRACTION)
        rest = "estimating" if done >= total else time_text(left, "left") if left else ""
        told = [_running_text(done - finished, int(total) - finished, running), rest if total > finished else ""]
        if self._bar and self._task is not None:
            text = ", ".join(filter(None, [f"{finished}/{int(total)} sweeps", *told]))
            self._bar.update(
                self._task, description=printable(doing), completed=share, total=1.0, count=text, visible=True
            )
        elif now - self._said >= REPORT_INTERVAL_S:
            self._said = now
            counted = f"{finished} of {plural(int(total), 'sweep')}"
            say(
                ", ".join(
                    filter(None, [counted, printable(doing), told[0], duration_text(now - self._started), *told[1:]])
                )
            )


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


def make_bar() -> "Bar":
    """Return a bar on stderr that disappears at its end."""
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
