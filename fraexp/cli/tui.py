"""``fraexp tui``: the terminal UI."""

import sys
from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.errors import FraexpError
from fraexp.workspace.workspace_folder import WorkspaceFolder


def execute(arguments: Namespace) -> ExitCode:
    """Show the terminal UI until the user quits."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise FraexpError("tui: no terminal; use the commands instead: fraexp list, show, compare")
    if not Path(arguments.workspace).is_dir():
        WorkspaceFolder.open(arguments.workspace)  # raises the error before the UI starts
    from fraexp.tui.app import FraexpApp

    app = FraexpApp(arguments.workspace, arguments.db, arguments.debug)
    app.run()
    return ExitCode.INTERNAL if app.return_code else ExitCode.OK
