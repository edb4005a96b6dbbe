"""How far a run has come: a bar on a terminal, a line now and then elsewhere; all on stderr."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

from fraexp.cli.output import say
from fraexp.figures.elements.labels import printable
from fraexp.views.pace import Speed, rate_text
from fraexp.views.words import duration, plural

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

PAUSE = 5.0
"""Least time between two lines [s]."""
ENDS = 300.0
"""Time over which it is measured how fast sweeps come to their end [s]: longer than one takes."""
ALMOST = 0.99
"""Greatest share that is shown while a sweep has not come to its end."""


class Meter:
    """A progress display in sweeps; a context manager."""

    def __init__(self) -> None:
        self.begin()
        self._said = self._started
        self._bar: Bar | None = _bar() if sys.stderr.isatty() else None
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
        """Start anew: another study begins, of which some sweeps are there and come first; they do not count."""
        self._started = self._last_end = time.monotonic()
        self._finished, self._work, self._ends = -reused, Speed(), Speed(ENDS)
        self._since: float | None = None
        self._idle: float | None = None

    def finish(self) -> None:
        """Take note of a sweep that has come to its end."""
        self._finished += 1
        self._last_end = time.monotonic()
        if self._finished == 1:
            self._ends.see(self._since or self._started, 0)
        self._ends.see(self._last_end, max(self._finished, 0))

    def note(self, text: str) -> None:
        """Tell what is being prepared."""
        if self._bar and self._task is not None:
            self._bar.update(self._task, description=printable(text), visible=True)
        else:
            say(text)

    def move(self, done: float, total: float, running: int | None = None, doing: str = "") -> None:
        """Show that the work of `done` of `total` sweeps is done, parts of those that are `running` included."""
        now, finished = time.monotonic(), max(self._finished, 0)
        self._work.see(now, done)
        if done <= 0:
            self._since, self._idle = self._since or now, now
        elif not finished and self._idle:  # what passed before, such as compiling, does not come again
            self._since, self._idle = self._idle, None
        share = done / total if total > 0 else 1.0
        share = share if finished >= total else min(share, ALMOST)
        told = [_under_way(done - finished, int(total) - finished, running), *self._pace(now, done, total)]
        if self._bar and self._task is not None:
            text = ", ".join(filter(None, [f"{finished}/{int(total)} sweeps", *told]))
            self._bar.update(
                self._task, description=printable(doing), completed=share, total=1.0, count=text, visible=True
            )
        elif now - self._said >= PAUSE:
            self._said = now
            counted = f"{finished} of {plural(int(total), 'sweep')}"
            say(", ".join(filter(None, [counted, printable(doing), told[0], duration(now - self._started), *told[1:]])))

    def _pace(self, now: float, done: float, total: float) -> list[str]:
        """Return the measured speed and the time left at this speed, or what is left to do that is no simulation."""
        finished = max(self._finished, 0)
        if done >= total:
            return ["estimating"] if total > finished else []
        rate = self._ends.rate if finished else None
        if rate:  # what estimators and fits take is in it
            left = (total - finished) / rate - (now - self._last_end)
            return [rate_text(rate), f"about {duration(left)} left"] if left > 0 else [rate_text(rate)]
        rate = self._work.rate
        return [rate_text(rate), f"at least {duration((total - done) / rate)} left"] if rate else []


def _under_way(part: float, left: int, running: int | None) -> str:
    """Return how many of the sweeps that are left are being computed; how far they came if no others are left.

    `part` is the sum of what has been done of each.
    """
    if running is None and left == 1 and part > 0:
        running = 1
    if running is None:
        return "more under way" if part > 0 and left > 0 else ""
    running = min(running, left)
    if running <= 0:
        return ""
    share = int(100 * part / running)
    return f"{running} under way" + (f" at {share} %" if running == left and 0 < share < 100 else "")


def _bar() -> "Bar":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=30),
        TimeElapsedColumn(),
        TextColumn("{task.fields[count]}", markup=False),
        console=Console(stderr=True),
        transient=True,
    )
