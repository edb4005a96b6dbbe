"""A time limit on interpreted code, in any thread: what does not return ends, and its line is known."""

import ctypes
import re
import threading
import time
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

LAW_TIME_LIMIT_S = 10.0
"""Time that a friction law has for all of its first trial in plain Python, which takes milliseconds."""
TICKS = 20
"""Looks at the clock within a limit."""
MOST_AT_ONCE_S = 4.0
"""Time that counts between two looks, at most: a process that was stopped meanwhile, as by Ctrl-Z, has not lost all.
A call into C that lets no other thread run may take longer than a look."""

DUMPED = re.compile(r'\s*File "(.*)", line (\d+) in ')
"""A line of what the interpreter writes of its threads before it ends itself."""


class OverdueError(BaseException):
    """Raised in the code that takes too long; no Exception, which that code may catch by itself."""


@contextmanager
def time_limit(seconds: float, of_processor: bool = False) -> Iterator[None]:
    """Raise OverdueError in what this thread runs meanwhile, once it has taken that long [s].

    `of_processor`: only time in which this process computes counts, for what takes long on a busy machine. It reaches
    interpreted code only, as Python's own tools do: what waits inside a function written in C is not ended.
    """
    watch = _Watch(seconds, of_processor)
    watch.thread.start()
    try:
        yield
    finally:
        watch.end()


class _Watch:
    """A thread that raises OverdueError in the one that has made it, unless it is ended before."""

    def __init__(self, seconds: float, of_processor: bool) -> None:
        self._watched, self._tick, self._of_processor = threading.get_ident(), seconds / TICKS, of_processor
        self._over, self._lock, self._raised = threading.Event(), threading.Lock(), False
        self.thread = threading.Thread(target=self._run, daemon=True)

    def end(self) -> None:
        """See to it that nothing is raised from here on, also what is on its way."""
        with self._lock:
            self._over.set()
        if self._raised:
            _raise_in(self._watched, None)

    def _run(self) -> None:
        left, clock = self._tick * TICKS, time.process_time if self._of_processor else time.monotonic
        while left > 0:
            before = clock()
            if self._over.wait(self._tick):
                return
            left -= min(clock() - before, MOST_AT_ONCE_S)
        with self._lock:
            if not self._over.is_set():
                self._raised = True
                _raise_in(self._watched, ctypes.py_object(OverdueError))


def _raise_in(thread: int, error: "ctypes.py_object[type[BaseException]] | None") -> None:
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), error)


def place_of(error: BaseException, file: str, first_line: int) -> str:
    """Return in which line of a file something was interrupted; `first_line` of what was run, if that is not known."""
    lines = traceback.extract_tb(error.__traceback__)
    inside = [line.lineno for line in lines if line.filename == file]
    return f"{Path(file).name}, line {inside[-1] if inside else first_line}"


def place_in_dump(lines: Iterable[str], file: str) -> str:
    """Return the innermost line of a file in what the interpreter wrote of its threads; empty if there is none."""
    found = [match for line in lines if (match := DUMPED.match(line)) and Path(match[1]).name == Path(file).name]
    return f"{Path(file).name}, line {found[0][2]}" if found else ""
