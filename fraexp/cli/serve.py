"""``fraexp serve``: the terminal UI in a browser."""

import os
import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.workspace.workspace_folder import WorkspaceFolder


def execute(arguments: Namespace) -> ExitCode:
    """Serve until interrupted."""
    from fraexp.tui.services.browser_server import serve

    folder = WorkspaceFolder.open(arguments.workspace, arguments.db)
    os.environ.update(folder.location_environment())  # which the sessions inherit
    command = [sys.executable, "-m", "fraexp", "tui", *folder.location_options()]
    serve(command, arguments.host, arguments.port, arguments.remote, arguments.token)
    return ExitCode.OK
