"""A terminal that is lost: the UI ends with it, also where no signal tells."""

import os
import pty
import signal
import subprocess
import sys
import threading

PATIENCE = 60.0


def test_the_ui_ends_with_its_terminal_where_no_signal_ends_it(workspace):
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", IGNORING, str(workspace)]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True) as ui:
        os.close(theirs)
        shown = b""
        while b"Studies" not in shown:
            shown += os.read(ours, 4096)
        os.close(ours)
        watch = threading.Timer(PATIENCE, ui.kill)
        watch.start()
        assert ui.wait() != -signal.SIGKILL
        watch.cancel()


IGNORING = """
import signal, sys
from fraexp.tui.app import FraexpApp

signal.signal(signal.SIGHUP, signal.SIG_IGN)
FraexpApp(sys.argv[1]).run()
"""
