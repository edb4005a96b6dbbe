"""Noticing that the terminal is gone: where no signal ends the program, nothing it reads or writes would."""

import os
import sys
import threading

LOOK = 1.0
"""Seconds between two looks at the terminal."""
HUNG_UP = 129
"""Exit code of a program that a lost line has ended."""


def gone(file: int) -> bool:
    """Return whether what was a terminal is none any more."""
    try:
        return not os.isatty(file)
    except OSError:
        return True


def end_with_terminal() -> None:
    """End the program when its terminal is gone, from a thread: the others wait to write to it, or are busy reading.

    Nothing is lost: runs are processes of their own, and a change of the database that is not complete is undone.
    """
    stream = sys.__stdin__
    if stream is None or not stream.isatty():
        return  # a browser's session: whoever serves it ends it
    file = stream.fileno()

    def look() -> None:
        pause = threading.Event()
        while not pause.wait(LOOK):
            if gone(file):
                os._exit(HUNG_UP)

    threading.Thread(target=look, name="terminal", daemon=True).start()
