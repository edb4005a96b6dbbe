"""``fraexp identify``: plant, friction and gains from the records of one machine."""

from argparse import Namespace
from collections.abc import Generator
from typing import NamedTuple

from fraexp.cli.documents import sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow
from fraexp.cli.import_record import request_of
from fraexp.cli.output import print_fields, print_json, print_path, say
from fraexp.components.kinds import Controller
from fraexp.data.results import Result
from fraexp.execution.events import Ended, Event
from fraexp.records.first_look import choose, look_at, with_channels
from fraexp.store import StoredSweep
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
    rows = list(answers(request.files, look, choice, found[0].results))
    if arguments.tune and found[0].sweeps:
        name = f"{arguments.study.stem if arguments.study else request.stem}-tune"
        found.append(_followed(workspace.fit(found[0].sweeps[-1:], name, kind=Controller.kind), workspace))
        rows += [row for tuned in found[1].results.values() for row in gains(tuned)]
    rows += [("open", reason) for of in found for reason in of.failures]
    figures = [path for of in found for path in of.ended.figures]
    sweeps = [pair for of in found for pair in zip(of.sweeps, of.results.values(), strict=True)]
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
    return ExitCode.INCOMPLETE if any(of.failures for of in found) else ExitCode.OK


class _Followed(NamedTuple):
    """A run that was followed to its end."""

    ended: Ended
    sweeps: list[StoredSweep]
    """Those with a result."""
    results: dict[str, Result]
    """By the labels of the cases."""
    failures: list[str]
    """Why the others have none."""


def _followed(events: Generator[Event, None, None], workspace: WorkspaceService) -> _Followed:
    """Follow a run to its end; KeyboardInterrupt if it is interrupted."""
    followed = follow(events)
    if followed.interrupted:
        raise KeyboardInterrupt
    ended = followed.ended[-1]
    assert ended.run is not None
    with workspace.open_store() as store:
        sweeps = store.sweeps(ended.run)
        found = store.results(of.key for of in sweeps)
    usable = [of for of in sweeps if of.key in found]
    results = {str(of.labels.get("case", "")): found[of.key] for of in usable}
    return _Followed(ended, usable, results, [of.message for of in sweeps if of.key not in found])
