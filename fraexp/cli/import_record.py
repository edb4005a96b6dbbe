"""``fraexp import``: analyse measured records, or list the contents of one."""

from argparse import Namespace
from pathlib import Path

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, print_outcome
from fraexp.cli.output import print_json, print_table, say
from fraexp.errors import RecordError
from fraexp.records.channels import parse_channel
from fraexp.records.study_writer import ImportRequest
from fraexp.workspace.workspace_service import WorkspaceService

RECORD_KEYS = (
    "line_channel", "sample_rate", "time_column", "samples_per_period", "period_time", "periods_per_realisation",
    "frequency_column", "periodic", "skip_periods", "skip_time", "realisations", "select", "segment_column",
    "min_frequency", "max_frequency", "harmonic_step", "harmonics", "response_unit", "input_amplitude", "averages",
)  # fmt: skip
"""Options by the keys of a study's section ``[record]``."""


def execute(arguments: Namespace) -> ExitCode:
    """Analyse a record, store the results, and print them as a run; without channels, list its contents."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    if not arguments.channels:
        study = workspace.study_of_record(arguments.study or arguments.files[0], arguments.files[0])
        if study is not None:
            say(f"{arguments.files[0]}: analysed as {study} says")
            return print_outcome(follow(workspace.run([str(study.resolve())])), arguments, workspace)
        return _list_contents(arguments, workspace)
    request = ImportRequest(
        files=arguments.files,
        channels=_parse_channels(arguments.channels, arguments.integrate),
        options={key: getattr(arguments, key) for key in RECORD_KEYS if getattr(arguments, key) is not None},
        estimators=arguments.estimators,
        settings=arguments.settings,
        levels=arguments.levels,
        each_file=arguments.separate_files,
    )
    return print_outcome(follow(workspace.import_record(request, arguments.study)), arguments, workspace)


def _parse_channels(texts: list[str], integrals: list[str]) -> dict[str, object]:
    channels: dict[str, object] = {}
    for text in texts:
        name, equals, column = (part.strip() for part in text.partition("="))
        if not (name and equals and column):
            raise RecordError(f"--channel {text}: expected NAME=COLUMN, such as u=force or 'y=position [mm]'")
        if name in channels:
            raise RecordError(f"--channel {text}: channel '{name}' is already defined; expected another name")
        channels[name] = column
    for text in integrals:
        name, _, times = text.partition("=")
        if name not in channels or times.removeprefix("-") not in ("", "1", "2"):
            raise RecordError(
                f"--integrate {text}: expected a channel and 1, 2, -1 or -2, such as {next(iter(channels))}=2"
            )
        plain = parse_channel(channels[name], name).plain()
        given = {key: value for key, value in plain.items() if value not in ("", 0.0) and (key, value) != ("scale", 1)}
        channels[name] = {**given, "integrate": int(times or 1)}
    return channels


def _list_contents(arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Print the contents of a file, and a command that would probably import it."""
    from fraexp.records.contents import clock_fault, list_contents, propose_import

    file: Path = arguments.files[0]
    found = list_contents(file, workspace.registry)
    command = propose_import(file, found, workspace.registry)
    if arguments.json:
        rows = [{"name": o.name, "shape": list(o.shape), "unit": o.unit, "guess": o.guess} for o in found]
        print_json({"file": str(file), "contents": rows, "proposal": command})
        return ExitCode.OK
    shapes = [" x ".join(map(str, one.shape)) for one in found]
    cells = [[one.name, shape, one.unit, one.guess] for one, shape in zip(found, shapes, strict=True)]
    print_table(["name", "size", "unit", "probably"], cells)
    time = next((one for one in found if one.guess == "time" and one.size > 1), None)
    fault = clock_fault(file, time, workspace.registry) if time else ""
    if fault:
        say(fault)
    say(f"next, after correcting units and gains: {command}")
    return ExitCode.OK
