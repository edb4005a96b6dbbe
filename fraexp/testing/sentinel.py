"""A thread that ends its process where the main thread does not come back: from compiled code, or from the compiler.

Such code cannot be interrupted, for it never asks whether it is to end.
"""

import faulthandler
import os
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import TextIO

TICK_S = 0.5
"""Time between two looks."""
STILL_LIMIT_S = 10.0
"""Processor time that the main thread may spend at one place in C or compiled code."""
COMPILE_LIMIT_S = 22.0
"""Processor time that the compiler may take for one call."""
WAIT_LIMIT_S = 20.0
"""Time that the main thread may wait at one place, as in a sleep."""
IDLE = 0.02
"""Share of the processor below which it waits: on a busy machine it is slow, but gets more than that."""
FROZEN_LIMIT_S = 20.0
"""Time without any look, where C code lets no other thread run: the interpreter itself then ends the process."""
COMPILER = f"{os.sep}numba{os.sep}"
WAITING = ("subprocess.py", "selectors.py", "threading.py")
"""Files whose functions wait for another process, or for a thread."""


class Sentinel:
    """Looks at the main thread, which has made it, until the process ends."""

    def __init__(self, report: Callable[[FrameType, bool, float], None], dump: TextIO) -> None:
        self._report, self._dump = report, dump
        self._main, self._parent = threading.get_ident(), os.getppid()
        self._seen: tuple[FrameType, int] | None = None
        self._since = (0.0, 0.0)

    def start(self) -> None:
        """Look from now on, also if no other thread gets to run before the first look."""
        self._let_interpreter_watch()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        over = threading.Event()
        while not over.wait(TICK_S):
            self._let_interpreter_watch()
            if os.getppid() != self._parent:  # nobody listens any more
                os._exit(1)
            self._look(sys._current_frames()[self._main])

    def _let_interpreter_watch(self) -> None:
        faulthandler.dump_traceback_later(FROZEN_LIMIT_S, exit=True, file=self._dump)

    def _look(self, frame: FrameType) -> None:
        compiling = outermost(frame, COMPILER)
        at = (compiling, 0) if compiling else (frame, frame.f_lasti)
        now = time.process_time(), time.monotonic()
        if frame.f_code.co_filename.endswith(WAITING) or at != self._seen:
            self._seen, self._since = at, now
            return
        spent, passed = now[0] - self._since[0], now[1] - self._since[1]
        waits = passed > WAIT_LIMIT_S and spent < IDLE * passed
        if waits or spent > (COMPILE_LIMIT_S if compiling else STILL_LIMIT_S):
            self._report(frame, compiling is not None, passed)
            os._exit(1)


def outermost(frame: FrameType | None, part: str) -> FrameType | None:
    """Return the outermost of a frame and its callers in a file whose path has this part, or None."""
    found = None
    while frame is not None:
        found = frame if part in frame.f_code.co_filename else found
        frame = frame.f_back
    return found


def line_within(frame: FrameType | None, file: str) -> int | None:
    """Return the innermost line of a file that is being run, or None."""
    while frame is not None:
        if frame.f_code.co_filename == file:
            return frame.f_lineno
        frame = frame.f_back
    return None
