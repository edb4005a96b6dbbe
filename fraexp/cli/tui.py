"""``fraexp tui``: the terminal UI."""

import os
import sys
from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.errors import FraexpError


def execute(arguments: Namespace) -> ExitCode:
    """Show the terminal UI until it is left."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()) and not _served():
        raise FraexpError("tui: there is no terminal here; every screen has its command: fraexp list, show, compare")
    if not Path(arguments.workspace).is_dir():
        from fraexp.workspace.workspace import Workspace  # which takes its time, and would be imported later

        Workspace.open(arguments.workspace)  # tells what is wrong
    from fraexp.tui.services import gc_policy

    gc_policy.put_off()
    from fraexp.tui.app import FraexpApp

    app = FraexpApp(arguments.workspace, arguments.db, arguments.ascii or None, arguments.debug)
    app.run()
    return ExitCode.INTERNAL if app.return_code else ExitCode.OK


def _served() -> bool:
    return "TEXTUAL_DRIVER" in os.environ  # by fraexp serve, to a browser
