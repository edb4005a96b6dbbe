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
from fraexp.views.identified_axis import answers
from fraexp.views.words import short_key
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Look at the records, run the study of the estimator that suits them, and print what they tell."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    request = with_channels(request_of(arguments), workspace.registry)
    look = look_at(request, workspace.registry)
    choice = choose(look)
    say(f"{choice.estimator['name']}: {choice.reason}")
    ended, sweeps, results, failures = _followed(workspace.identify(request, look, choice, arguments.study), workspace)
    rows = list(answers(request.files, look, choice, results))
    if arguments.tune:
        tuning = workspace.fit(
            sweeps[-1:], f"{arguments.study.stem if arguments.study else request.stem}-tune", kind=Controller.kind
        )
        _, _, tuned, unfit = _followed(tuning, workspace)
        rows += [row for row in answers(request.files, look, choice, tuned) if row not in rows]
        failures += unfit
    rows += [("open", reason) for reason in failures]
    if arguments.json:
        documents = [sweep_document(of, result) for of, result in zip(sweeps, results.values(), strict=True)]
        print_json({"answers": rows, "figures": [str(path) for path in ended.figures], "sweeps": documents})
    else:
        print_fields(rows)
        for path in ended.figures:
            print_path(path, "figure ")
        say(f"next: fraexp show {short_key(sweeps[-1].key)}, fraexp plot {ended.run} -o FILE.pdf")
    return ExitCode.INCOMPLETE if failures else ExitCode.OK


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
