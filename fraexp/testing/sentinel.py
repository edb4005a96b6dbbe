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
from typing import NamedTuple, TextIO

POLL_INTERVAL_S = 0.5
"""Time between two looks at the main thread."""
STILL_LIMIT_S = 10.0
"""Processor time that the main thread may spend at one place in C or compiled code."""
COMPILE_LIMIT_S = 22.0
"""Processor time that the compiler may take for one call."""
WAIT_LIMIT_S = 20.0
"""Time that the main thread may wait at one place, as in a sleep."""
MAX_WAITING_LOAD = 0.02
"""Share of a processor below which it counts as waiting: on a busy machine work is slow, but gets more than that."""
FROZEN_LIMIT_S = 20.0
"""Time without any look, where C code lets no other thread run: the interpreter itself then ends the process."""
COMPILER = f"{os.sep}numba{os.sep}"
WAITING_FILES = ("subprocess.py", "selectors.py", "threading.py")
"""Files whose functions wait for another process, or for a thread."""


class _Clocks(NamedTuple):
    """Readings of both clocks [s]."""

    processor: float
    wall: float


class Sentinel:
    """Watches the main thread, which creates it, until the process ends."""

    def __init__(self, report: Callable[[FrameType, bool, float], None], dump: TextIO) -> None:
        self._report, self._dump = report, dump
        self._main, self._parent = threading.get_ident(), os.getppid()
        self._seen: tuple[FrameType, int] | None = None
        self._since = _Clocks(0.0, 0.0)

    def start(self) -> None:
        """Watch from now on, also if no other thread gets to run before the first look."""
        self._arm_interpreter_watchdog()
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        over = threading.Event()
        while not over.wait(POLL_INTERVAL_S):
            self._arm_interpreter_watchdog()
            if os.getppid() != self._parent:  # the command has ended, and nobody reads the report
                os._exit(1)
            self._look(sys._current_frames()[self._main])

    def _arm_interpreter_watchdog(self) -> None:
        faulthandler.dump_traceback_later(FROZEN_LIMIT_S, exit=True, file=self._dump)

    def _look(self, frame: FrameType) -> None:
        compiler = outermost_frame(frame, COMPILER)
        # Compiling takes its time at many places: what counts is that the same call into the compiler goes on.
        at = (compiler, 0) if compiler else (frame, frame.f_lasti)
        now = _Clocks(time.process_time(), time.monotonic())
        if frame.f_code.co_filename.endswith(WAITING_FILES) or at != self._seen:
            self._seen, self._since = at, now
            return
        spent, passed = now.processor - self._since.processor, now.wall - self._since.wall
        is_waiting = passed > WAIT_LIMIT_S and spent < MAX_WAITING_LOAD * passed
        if is_waiting or spent > (COMPILE_LIMIT_S if compiler else STILL_LIMIT_S):
            self._report(frame, compiler is not None, passed)
            os._exit(1)


def outermost_frame(frame: FrameType | None, part: str) -> FrameType | None:
    """Return the outermost of a frame and its callers in a file whose path has this part, or None."""
    found = None
    while frame is not None:
        found = frame if part in frame.f_code.co_filename else found
        frame = frame.f_back
    return found


def innermost_line(frame: FrameType | None, file: str) -> int | None:
    """Return the innermost line of a file that is being run, or None."""
    while frame is not None:
        if frame.f_code.co_filename == file:
            return frame.f_lineno
        frame = frame.f_back
    return None
