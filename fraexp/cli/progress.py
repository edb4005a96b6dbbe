"""How far a run has come: a bar on a terminal, a line now and then elsewhere; all on stderr."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

from fraexp.cli.terminal import say
from fraexp.figures.labels import printable
from fraexp.views.pace import Speed, rate_text
from fraexp.views.words import duration, plural

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

PAUSE = 5.0
"""Least time between two lines [s]."""
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

    def begin(self) -> None:
        """Start anew: another study begins."""
        self._started, self._finished, self._speed = time.monotonic(), 0, Speed()

    def finish(self) -> None:
        """Take note of a sweep that has come to its end."""
        self._finished += 1

    def note(self, text: str) -> None:
        """Tell what is being prepared."""
        if self._bar and self._task is not None:
            self._bar.update(self._task, description=printable(text), visible=True)
        else:
            say(text)

    def move(self, done: float, total: float) -> None:
        """Show that the work of `done` of `total` sweeps is done; parts of sweeps count."""
        now = time.monotonic()
        self._speed.see(now, done)
        share = done / total if total > 0 else 1.0
        share = share if self._finished >= total else min(share, ALMOST)
        if self._bar and self._task is not None:
            text = f"{self._finished}/{int(total)} sweeps{self._pace(done, total)}"
            self._bar.update(self._task, description="", completed=share, total=1.0, count=text, visible=True)
        elif now - self._said >= PAUSE:
            self._said = now
            percent, elapsed = int(100 * share), duration(now - self._started)
            counted = f"{self._finished} of {plural(int(total), 'sweep')}"
            say(f"{counted}, {percent} %, {elapsed}{self._pace(done, total)}")

    def _pace(self, done: float, total: float) -> str:
        """Return the measured speed and the time left at this speed; what is left to do if that is no simulation."""
        if done >= total > self._finished:
            return ", estimating"
        rate = self._speed.rate
        if rate is None or done >= total:
            return ""
        return f", {rate_text(rate)}, about {duration((total - done) / rate)} left"


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
