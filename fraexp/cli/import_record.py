"""``fraexp import``: analyse a measured record."""

from argparse import Namespace

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.selection import database
from fraexp.errors import RecordError
from fraexp.workspace import Workspace

OPTIONS = ("sample_rate", "time", "period", "frequency", "skip", "lowest", "highest")
"""Options that are keys of a study's section [record]."""


def execute(arguments: Namespace) -> ExitCode:
    """Estimate the response of a record, store it, and print it as a run."""
    channels = dict(_channel(text) for text in arguments.channels)
    workspace = Workspace.open(arguments.workspace, database(arguments))
    options = {key: getattr(arguments, key) for key in OPTIONS if getattr(arguments, key) is not None}
    events = workspace.import_record(arguments.file, channels, options, arguments.study)
    return report(follow(events), arguments, workspace)


def _channel(text: str) -> tuple[str, str]:
    name, equals, column = text.partition("=")
    if not (name and equals and column):
        raise RecordError(f"--channel {text}: expected NAME=COLUMN, such as u=force or 'y=position [mm]'")
    return name, column
