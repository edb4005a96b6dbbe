"""A terminal that is lost: the UI ends with it, also where no signal tells."""

import os
import pty
import signal
import subprocess
import sys
import threading

import pytest

from tests.waiting import HANG_TIMEOUT_S


@pytest.mark.thorough
def test_the_ui_ends_with_its_terminal_where_no_signal_ends_it(workspace):
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", IGNORING, str(workspace)]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True) as ui:
        os.close(theirs)
        watch = threading.Timer(HANG_TIMEOUT_S, ui.kill)
        watch.start()
        shown = b""
        while b"fraexp tui" not in shown:
            shown += os.read(ours, 4096)
        os.close(ours)
        assert ui.wait() != -signal.SIGKILL
        watch.cancel()


def test_keys_that_are_typed_before_the_ui_is_up_count(workspace):
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", PATIENT, "tui", f"--workspace={workspace}"], stdin=theirs, stdout=theirs, stderr=theirs,
        start_new_session=True,
    ) as ui:  # fmt: skip
        os.close(theirs)
        os.write(ours, b"\r")  # which the terminal makes a line feed of until the UI has taken it over
        watch = threading.Timer(HANG_TIMEOUT_S, ui.kill)
        watch.start()
        shown = b""
        while b"Launch" not in shown:
            shown += os.read(ours, 4096)
        watch.cancel()
        ui.kill()
        os.close(ours)


def test_the_first_frame_needs_neither_the_database_nor_what_computes():
    heavy = ("sqlalchemy", "numba", "matplotlib", "fraexp.workspace.workspace_service")
    code = f"import sys, fraexp.tui.app; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


IGNORING = """
import signal, sys
from fraexp.tui.app import FraexpApp

signal.signal(signal.SIGHUP, signal.SIG_IGN)
FraexpApp(sys.argv[1]).run()
"""

# Keys wait only for some seconds until a screen is loaded, which a busy machine may need for the first one.
PATIENT = f"""
from fraexp.cli.main import console
from fraexp.tui import page

page.LOAD_TIMEOUT_S = {HANG_TIMEOUT_S}
console()
"""
