"""``fraexp tui`` and ``fraexp serve``: the terminal UI, here or in a browser."""

import os
import sys
from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.errors import FraexpError
from fraexp.workspace.workspace_folder import WorkspaceFolder


def execute(arguments: Namespace) -> ExitCode:
    """Show the terminal UI until the user quits."""
    is_served = "TEXTUAL_DRIVER" in os.environ  # by fraexp serve, to a browser
    if not (sys.stdin.isatty() and sys.stdout.isatty()) and not is_served:
        raise FraexpError("tui: no terminal; use the commands instead: fraexp list, show, compare")
    if not Path(arguments.workspace).is_dir():
        WorkspaceFolder.open(arguments.workspace)  # raises the error before the UI starts
    from fraexp.tui.app import FraexpApp

    app = FraexpApp(arguments.workspace, arguments.db, arguments.debug)
    app.run()
    return ExitCode.INTERNAL if app.return_code else ExitCode.OK


def serve(arguments: Namespace) -> ExitCode:
    """Serve the terminal UI to browsers until interrupted."""
    from fraexp.tui.services import browser_server

    folder = WorkspaceFolder.open(arguments.workspace, arguments.db)
    os.environ.update(folder.location_environment())  # which the sessions inherit
    command = [sys.executable, "-m", "fraexp", "tui", *folder.location_options()]
    browser_server.serve(command, arguments.host, arguments.port, arguments.token)
    return ExitCode.OK
