"""How far a run has come: a bar on a terminal, a line now and then elsewhere; all on stderr."""

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Self

from fraexp.cli.terminal import say
from fraexp.cli.words import duration, plural
from fraexp.figures.labels import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

PAUSE = 5.0
"""Least time between two lines [s]."""


class Meter:
    """A progress display in sweeps; a context manager."""

    def __init__(self) -> None:
        self.total = 0.0
        self._started = self._said = time.monotonic()
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

    def note(self, text: str) -> None:
        """Tell what is being prepared."""
        if self._bar and self._task is not None:
            self._bar.update(self._task, description=printable(text), visible=True)
        else:
            say(text)

    def move(self, done: float, total: float) -> None:
        """Show that `done` of `total` sweeps are done; parts of sweeps count."""
        self.total = total
        if self._bar and self._task is not None:
            count = f"{int(done)}/{int(total)} sweeps"
            self._bar.update(self._task, description="", completed=done, total=total, count=count, visible=True)
        elif time.monotonic() - self._said >= PAUSE:
            self._said = time.monotonic()
            say(self._line(done, total))

    def _line(self, done: float, total: float) -> str:
        elapsed = time.monotonic() - self._started
        left = f", about {duration(elapsed * (total - done) / done)} left" if done > 0 else ""
        return f"{int(done)} of {plural(int(total), 'sweep')}, {100 * done / total:.0f} %, {duration(elapsed)}{left}"


def _bar() -> "Bar":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=40),
        TextColumn("{task.fields[count]}", markup=False),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
