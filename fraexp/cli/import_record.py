"""``fraexp import``: analyse measured records, or tell what is in one."""

from argparse import Namespace
from pathlib import Path
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, report
from fraexp.cli.output import print_json, print_table, say
from fraexp.cli.sweep_lookup import database
from fraexp.errors import RecordError
from fraexp.records.channels import channel_of
from fraexp.records.written import Request
from fraexp.workspace.workspace import Workspace

OPTIONS = (
    "input", "sample_rate", "time", "period", "period_time", "periods", "frequency", "periodic", "skip", "skip_time",
    "realisations", "where", "segment", "lowest", "highest", "every", "lines",
)  # fmt: skip
"""Options that are keys of a study's section [record]."""


def execute(arguments: Namespace) -> ExitCode:
    """Estimate what a record teaches, store it, and print it as a run; without channels, list what it holds."""
    workspace = Workspace.open(arguments.workspace, database(arguments))
    if not arguments.channels:
        return _list(arguments, workspace)
    request = Request(
        files=arguments.files,
        channels=_channels(arguments.channels, arguments.integrate),
        options={key: getattr(arguments, key) for key in OPTIONS if getattr(arguments, key) is not None},
        estimators=arguments.estimators,
        settings=arguments.settings,
        levels=arguments.levels,
        each_file=arguments.each_file,
    )
    return report(follow(workspace.import_record(request, arguments.study)), arguments, workspace)


def _channels(texts: list[str], integrals: list[str]) -> dict[str, Any]:
    channels: dict[str, Any] = {}
    for text in texts:
        name, equals, column = (part.strip() for part in text.partition("="))
        if not (name and equals and column):
            raise RecordError(f"--channel {text}: expected NAME=COLUMN, such as u=force or 'y=position [mm]'")
        if name in channels:
            raise RecordError(f"--channel {text}: there is a channel '{name}' already; expected another name")
        channels[name] = column
    for text in integrals:
        name, _, times = text.partition("=")
        if name not in channels or times.removeprefix("-") not in ("", "1", "2"):
            raise RecordError(
                f"--integrate {text}: expected a channel and 1, 2, -1 or -2, such as {next(iter(channels))}=2"
            )
        plain = channel_of(channels[name], name).plain()
        given = {key: value for key, value in plain.items() if value not in ("", 0.0) and (key, value) != ("scale", 1)}
        channels[name] = {**given, "integrate": int(times or 1)}
    return channels


def _list(arguments: Namespace, workspace: Workspace) -> ExitCode:
    """Print what is in a file, and the command that would probably import it."""
    from fraexp.records.contents import contents, proposal, seems_uneven

    file: Path = arguments.files[0]
    found = contents(file, workspace.registry)
    command = proposal(file, found, workspace.registry)
    if arguments.json:
        rows = [{"name": o.name, "shape": list(o.shape), "unit": o.unit, "guess": o.guess} for o in found]
        print_json({"file": str(file), "contents": rows, "proposal": command})
        return ExitCode.OK
    shapes = [" x ".join(map(str, one.shape)) for one in found]
    cells = [[one.name, shape, one.unit, one.guess] for one, shape in zip(found, shapes, strict=True)]
    print_table(["name", "size", "unit", "probably"], cells)
    time = next((one for one in found if one.guess == "time" and one.size > 1), None)
    fault = seems_uneven(file, time, workspace.registry) if time else ""
    if fault:
        say(fault)
    say(f"next, with your own units and gains: {command}")
    return ExitCode.OK
