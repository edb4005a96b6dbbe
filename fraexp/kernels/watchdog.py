"""A time limit on interpreted code, in any thread: code that does not return is ended, and its line is reported."""

import ctypes
import re
import sys
import threading
import time
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

LAW_TIME_LIMIT_S = 10.0
"""Time limit [s] of a friction law's first trial in plain Python, which normally takes milliseconds."""
POLLS_PER_LIMIT = 20
"""Number of times that the watchdog reads the clock within a limit."""
MAX_COUNTED_PER_POLL_S = 4.0
"""Maximum time [s] that counts between two readings: a process that was stopped meanwhile, as by Ctrl-Z, has not used
up its limit. A call into C that lets no other thread run may take longer than that."""
STEPS_TO_RECEIVE = 100
"""Jumps after which an error that was raised in this thread has arrived: one is enough, if no tracer intervenes."""

DUMPED_LINE = re.compile(r'\s*File "(.*)", line (\d+) in ')
"""A line of the traceback that the interpreter writes of its threads before it ends itself."""


class OverdueError(BaseException):
    """Raised in code that exceeds its time limit; not an Exception, because such code may catch these itself."""


@contextmanager
def time_limit(seconds: float, is_processor_time: bool = False) -> Iterator[None]:
    """Raise OverdueError in the `with` block of this thread once it has taken that long [s].

    With `is_processor_time` only time counts in which this process computes: for work that takes long on a busy
    machine. The error reaches interpreted code only, as with Python's own tools: a call that waits inside a function
    written in C is not ended.
    """
    watchdog, show = _Watchdog(seconds, is_processor_time), sys.unraisablehook

    def show_others(unraisable: "sys.UnraisableHookArgs") -> None:
        if not isinstance(unraisable.exc_value, OverdueError):  # C code that calls back, such as the compiler, drops it
            show(unraisable)

    sys.unraisablehook = show_others
    watchdog.thread.start()
    try:
        yield
    finally:
        watchdog.stop()
        sys.unraisablehook = show


class _Watchdog:
    """A thread that raises OverdueError in the thread that created it, unless it is stopped before."""

    def __init__(self, seconds: float, is_processor_time: bool) -> None:
        self._watched = threading.get_ident()
        self._poll_interval = seconds / POLLS_PER_LIMIT
        self._is_processor_time = is_processor_time
        self._stopped, self._lock, self._has_raised = threading.Event(), threading.Lock(), False
        self._error: type[OverdueError] = type(
            "OverdueError", (OverdueError,), {}
        )  # distinguishes it from that of an outer limit
        self.thread = threading.Thread(target=self._run, daemon=True)

    def stop(self) -> None:
        """Make sure that nothing is raised from here on; receive an error that is still on its way."""
        # Withdrawing it would leave the interpreter's flag of such errors set, and in Python 3.11 code that is traced,
        # as by coverage, stands still from then on.
        try:
            with self._lock:
                self._stopped.set()
            for _ in range(STEPS_TO_RECEIVE if self._has_raised else 0):
                pass
        except self._error:
            self._stopped.set()

    def _run(self) -> None:
        # The limit is spent in small steps, not waited for at once: each step counts no more than
        # MAX_COUNTED_PER_POLL_S, and processor time cannot be waited for at all.
        remaining = self._poll_interval * POLLS_PER_LIMIT
        clock = time.process_time if self._is_processor_time else time.monotonic
        while remaining > 0:
            before = clock()
            if self._stopped.wait(self._poll_interval):
                return
            remaining -= min(clock() - before, MAX_COUNTED_PER_POLL_S)
        with self._lock:  # the block may end just now: either it is stopped, or the error is raised, never both
            if not self._stopped.is_set():
                self._has_raised = True
                _raise_in_thread(self._watched, self._error)


def _raise_in_thread(thread: int, error: type[BaseException]) -> None:
    """Raise an error at the next jump or call of a thread."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(error))


def error_location(error: BaseException, file: str, first_line: int) -> str:
    """Return file and line at which code of a file was interrupted; `first_line` if the traceback does not say."""
    lines = traceback.extract_tb(error.__traceback__)
    inside = [line.lineno for line in lines if line.filename == file]
    return f"{Path(file).name}, line {inside[-1] if inside else first_line}"


def dumped_location(dump: Iterable[str], file: str) -> str:
    """Return the innermost line of a file in the interpreter's dump of its threads; empty if the file is not in it."""
    matches = [match for line in dump if (match := DUMPED_LINE.match(line)) and Path(match[1]).name == Path(file).name]
    return f"{Path(file).name}, line {matches[0][2]}" if matches else ""
