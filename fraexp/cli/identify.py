"""``fraexp identify``: plant, friction and gains from the records of one machine."""

from argparse import Namespace
from collections.abc import Generator

from fraexp.cli.documents import sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import FinishedRun, follow, read_run
from fraexp.cli.import_record import request_of
from fraexp.cli.output import print_fields, print_json, print_path, say
from fraexp.components.kinds import Controller
from fraexp.data.results import Result
from fraexp.execution.events import Event
from fraexp.records.first_look import choose, look_at, with_channels
from fraexp.views.identified_axis import answers, gains
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Look at the records, run the study of the estimator that suits them, and print what they tell."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    request = with_channels(request_of(arguments), workspace.registry)
    look = look_at(request, workspace.registry)
    choice = choose(look)
    say(f"{choice.estimator['name']}: {choice.reason}")
    found = [_followed(workspace.identify(request, look, choice, arguments.study), workspace)]
    rows = list(answers(request.files, look, choice, _by_case(found[0])))
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
    return ExitCode.INCOMPLETE if failures else ExitCode.OK


def _by_case(finished: FinishedRun) -> dict[str, Result]:
    """Return the results by the labels of their cases, in the order of the study."""
    found = finished.results
    return {str(of.labels.get("case", "")): found[of.key] for of in finished.sweeps if of.key in found}


def _followed(events: Generator[Event, None, None], workspace: WorkspaceService) -> FinishedRun:
    """Follow a run to its end; KeyboardInterrupt if it is interrupted."""
    followed = follow(events)
    if followed.interrupted:
        raise KeyboardInterrupt
    return read_run(followed.ended[-1], workspace)
