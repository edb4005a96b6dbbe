"""``fraexp serve``: the terminal UI in a browser."""

import sys
from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.workspace.workspace import Workspace


def execute(arguments: Namespace) -> ExitCode:
    """Serve until interrupted."""
    from fraexp.tui.services.browser_server import serve

    place = Workspace.open(arguments.workspace, arguments.db).place()
    command = [sys.executable, "-m", "fraexp", "tui", *place]
    serve(command, arguments.host, arguments.port, arguments.remote, arguments.token)
    return ExitCode.OK
