"""``fraexp import`` and ``fraexp identify``: measured records, analysed one by one or as those of one machine."""

from argparse import Namespace
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

from fraexp.cli.documents import sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import FinishedRun, follow, print_outcome, read_run
from fraexp.cli.options import RECORD_OPTIONS
from fraexp.cli.output import print_fields, print_json, print_path, print_table, say
from fraexp.components.kinds import Controller
from fraexp.errors import RecordError
from fraexp.execution.events import Event
from fraexp.records.channels import parse_channel
from fraexp.records.first_look import choose, look_at, with_channels
from fraexp.records.study_writer import ImportRequest
from fraexp.views.identified_axis import answers, gains
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService

_RECORD_KEYS = [option.key for option in RECORD_OPTIONS]


def import_record(arguments: Namespace) -> ExitCode:
    """Analyse a record, store the results, and print them as a run; without channels, list its contents."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    if not arguments.channels:
        study = workspace.study_of_record(arguments.study or arguments.files[0], arguments.files[0])
        if study is not None:
            say(f"{arguments.files[0]}: analysed as {study} says")
            return print_outcome(follow(workspace.run([str(study.resolve())])), arguments, workspace)
        return _list_contents(arguments, workspace)
    request = replace(
        request_of(arguments),
        estimators=arguments.estimators,
        levels=arguments.levels,
        each_file=arguments.separate_files,
    )
    return print_outcome(follow(workspace.import_record(request, arguments.study)), arguments, workspace)


def request_of(arguments: Namespace) -> ImportRequest:
    """Return files, channels, options of the record and settings that a command line states."""
    return ImportRequest(
        files=arguments.files,
        channels=_parse_channels(arguments.channels, arguments.integrate),
        options={key: value for key in _RECORD_KEYS if (value := getattr(arguments, key)) is not None},
        settings=arguments.overrides,
    )


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
                f"--integrate {text}: expected a channel and 1, 2, -1 or -2, such as {next(iter(channels), 'y')}=2"
            )
        plain = parse_channel(channels[name], name).plain()
        given = {key: value for key, value in plain.items() if value not in ("", 0.0) and (key, value) != ("scale", 1)}
        channels[name] = {**given, "integrate": int(times or 1)}
    return channels


def _list_contents(arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Print the contents of files, and a command that would probably import them."""
    from fraexp.records.proposals import propose_files
    from fraexp.records.record_files import list_contents

    files: list[Path] = arguments.files
    found = {file: list_contents(file, workspace.registry) for file in files}
    proposal = propose_files(found, workspace.registry)
    if arguments.json:
        rows = [
            {"name": o.name, "shape": list(o.shape), "unit": o.unit, "guess": o.guess, "file": str(file)}
            for file, contents in found.items()
            for o in contents
        ]
        document = {"file": str(files[0]), "contents": rows, "proposal": proposal.command}
        print_json({**document, "needs": proposal.needs, "findings": proposal.findings})
        return ExitCode.OK
    several = len(files) > 1
    cells = [
        [*([file.name] if several else []), one.name, " x ".join(map(str, one.shape)), one.unit, one.guess]
        for file, contents in found.items()
        for one in contents
    ]
    print_table([*(["file"] if several else []), "name", "size", "unit", "probably"], cells)
    for sentence in (*proposal.findings, *proposal.needs):
        say(sentence)
    say(f"next, after correcting units and gains: {proposal.command}")
    return ExitCode.OK


def identify(arguments: Namespace) -> ExitCode:
    """Look at the records, run the study of the estimator that suits them, and print what they tell."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    request = with_channels(request_of(arguments), workspace.registry)
    look = look_at(request, workspace.registry)
    choice = choose(look)
    say(f"{choice.estimator['name']}: {choice.reason}")
    found = [_followed(workspace.identify(request, look, choice, arguments.study), workspace)]
    results = found[0].results
    by_case = {str(of.labels.get("case", "")): results[of.key] for of in found[0].sweeps if of.key in results}
    rows = list(answers(request.files, look, choice, by_case))
    usable = [sweep for of in found for sweep in of.sweeps if sweep.key in of.results]
    if arguments.tune and usable:
        name = f"{arguments.study.stem if arguments.study else request.stem}-tune"
        found.append(_followed(workspace.fit(usable[-1:], name, kind=Controller.kind), workspace))
        rows += [row for tuned in found[1].results.values() for row in gains(tuned)]
    failures = [sweep.message for of in found for sweep in of.sweeps if sweep.key not in of.results]
    rows += [("open", reason) for reason in failures]
    figures = [path for of in found for path in of.ended.figures]
    sweeps = [(sweep, of.results[sweep.key]) for of in found for sweep in of.sweeps if sweep.key in of.results]
    if arguments.json:
        documents = [sweep_document(*pair) for pair in sweeps]
        print_json({"answers": rows, "figures": [str(path) for path in figures], "sweeps": documents})
    else:
        print_fields(rows)
        for path in figures:
            print_path(path, "figure ")
        for of in found:
            if of.ended.note:
                say(f"run {of.ended.run}: no figure was drawn: {' '.join(of.ended.note.split())}")
        shown = [f"fraexp show {short_key(sweep.key)}" for sweep, _ in sweeps]
        say(f"next: {', '.join([*shown, f'fraexp plot {found[0].ended.run} -o FILE.pdf'])}")
    has_plant = any(fit.kind == "plant" for of in found for each in of.results.values() for fit in each.fits)
    return ExitCode.OK if not failures and (has_plant or not look.frequencies) else ExitCode.INCOMPLETE


def _followed(events: Generator[Event, None, None], workspace: WorkspaceService) -> FinishedRun:
    """Follow a run to its end; KeyboardInterrupt if it is interrupted."""
    followed = follow(events)
    if followed.interrupted:
        raise KeyboardInterrupt
    return read_run(followed.ended[-1], workspace)
