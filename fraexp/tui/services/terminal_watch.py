"""A watch that ends the program when its terminal is gone and no signal has ended it."""

import os
import sys
import threading

POLL_INTERVAL_S = 1.0
"""Seconds between two polls of the terminal."""
HANGUP_EXIT_CODE = 129
"""Exit code of a program that was ended by a hangup."""


def is_gone(file: int) -> bool:
    """Return whether a file descriptor is no longer a terminal."""
    try:
        return not os.isatty(file)
    except OSError:
        return True


def end_with_terminal() -> None:
    """End the program when its terminal is gone, from a thread, as the others block on the terminal.

    Nothing is lost: runs are separate processes, and incomplete transactions are rolled back.
    """
    stream = sys.__stdin__
    if stream is None or not stream.isatty():
        return  # a session in a browser, which the server ends
    file = stream.fileno()

    def look() -> None:
        pause = threading.Event()
        while not pause.wait(POLL_INTERVAL_S):
            if is_gone(file):
                os._exit(HANGUP_EXIT_CODE)

    threading.Thread(target=look, name="terminal", daemon=True).start()
