"""Following the events of a run, and reporting how it ended."""

from argparse import Namespace
from collections.abc import Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from fraexp.cli.documents import plain, run_document, sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_path, print_table, say
from fraexp.cli.progress import Meter
from fraexp.cli.summary import print_summary, to_summarise
from fraexp.cli.sweep_lookup import open_store, place
from fraexp.data.results import Outcome, Result
from fraexp.execution.events import Begun, Ended, Event, Finished, Noticed, Planned, Preparing, Progress
from fraexp.figures.elements.labels import printable
from fraexp.store import RunSummary, StoredSweep
from fraexp.views.fields import remedies
from fraexp.views.pace import expected_time
from fraexp.views.plan import why_document, why_lines
from fraexp.views.text_tables import sweep_table
from fraexp.views.words import duration, plural, short
from fraexp.workspace.workspace import Workspace

SHOWN = 50
"""Sweeps in the table at the end where no terminal is; `show` has all."""
ERRORS = 20
"""Failed sweeps that are told one by one; `show` has all."""
PLANNED = ("study", "title", "total", "reused", "missing", "stale", "seconds", "compiling")
FRUITLESS = (Outcome.NO_SIGNAL, Outcome.DIVERGED, Outcome.FAILED)
"""Outcomes without a result to use."""


@dataclass
class Story:
    """What the events have told."""

    planned: list[Planned] = field(default_factory=list)
    begun: list[int] = field(default_factory=list)
    """Numbers of the runs that have been recorded."""
    ended: list[Ended] = field(default_factory=list)
    failed: int = 0
    interrupted: bool = False


def follow(events: Generator[Event, None, None]) -> Story:
    """Render events as they come; Ctrl-C closes them, which ends the run and keeps what is finished."""
    story = Story()
    try:
        with Meter() as meter, closing(events):
            for event in events:
                _take(event, story, meter)
    except KeyboardInterrupt:
        story.interrupted = True
    return story


def _take(event: Event, story: Story, meter: Meter) -> None:
    match event:
        case Planned():
            story.planned.append(event)
            meter.begin(event.reused)
            say(_plan(event))
            for line in why_lines(event):
                say(printable(line))
        case Begun():
            story.begun.append(event.run)
        case Preparing():
            meter.note(event.what)
        case Noticed():
            say(event.what)
        case Progress():
            meter.move(event.done, event.total, event.running, event.doing)
        case Finished():
            meter.finish()
            if event.error:
                story.failed += 1
                _tell_failure(event, story.failed)
        case Ended():
            story.ended.append(event)


def _tell_failure(event: Finished, count: int) -> None:
    if count <= ERRORS:
        say(f"{short(event.sweep.key)} failed: {event.error}")
    elif count == ERRORS + 1:
        say("further sweeps that fail are only counted; fraexp show has them all")


def _plan(planned: Planned) -> str:
    stale = f" ({planned.stale} stale: a plugin's source has changed; --rerun stale)" if planned.stale else ""
    time = expected_time(planned.seconds, planned.compiling)
    sweeps = plural(planned.total, "sweep")
    return f"{planned.study}: {sweeps}, {planned.reused} reused{stale}, {planned.missing} to compute{time}"


def report(story: Story, arguments: Namespace, workspace: Workspace) -> ExitCode:
    """Print what the runs gave, and return how it went."""
    runs = [(ended, *_stored(ended.run, arguments)) for ended in story.ended if ended.run is not None]
    for ended, run, _, _ in runs:
        if ended.note:
            say(f"run {run.number} has no figure: {' '.join(ended.note.split())}")
    if arguments.json:
        print_json(_document(story, runs))
    else:
        titles = {planned.study: planned.title for planned in story.planned}
        for number, (ended, run, sweeps, results) in enumerate(runs):
            if number > 0:
                print()
            if len(runs) > 1:
                print(printable(_heading(run.study, titles)))
            _print(ended, run, sweeps, results, workspace, place(arguments))
    if story.interrupted:
        kept = plural(_computed(story, arguments), "sweep")
        say(f"interrupted: {kept} computed and kept; the same command goes on from there")
        return ExitCode.INTERRUPTED
    failed = any(_fruitless(sweep) for _, _, sweeps, _ in runs for sweep in sweeps)
    return ExitCode.INCOMPLETE if failed else ExitCode.OK


def _heading(study: str, titles: Mapping[str, str]) -> str:
    return ": ".join(part for part in (study, titles.get(study, "")) if part)


def _stored(number: int, arguments: Namespace) -> tuple[RunSummary, list[StoredSweep], dict[str, Result]]:
    with open_store(arguments) as store:
        sweeps = store.sweeps(number)
        return store.run(number), sweeps, store.results(sweep.key for sweep in sweeps)


def _computed(story: Story, arguments: Namespace) -> int:
    """Return how many sweeps the runs have stored: more than was told, as the last ones are stored when all ends."""
    if not story.begun:
        return 0
    with open_store(arguments) as store:
        return sum(store.run(number).computed for number in story.begun)


def _fruitless(sweep: StoredSweep) -> bool:
    return sweep.state in ("failed", "pending") or sweep.outcome in FRUITLESS


def _document(story: Story, runs: list[tuple[Ended, RunSummary, list[StoredSweep], dict[str, Result]]]) -> Any:
    return {
        "planned": [
            {
                **{name: getattr(planned, name) for name in PLANNED},
                **({"why": [plain(why_document(why)) for why in planned.whys]} if planned.whys else {}),
            }
            for planned in story.planned
        ],
        "interrupted": story.interrupted,
        "runs": [
            {
                **run_document(run),
                "figures": [str(path) for path in ended.figures],
                "sweeps": [sweep_document(sweep, results.get(sweep.key), points=False) for sweep in sweeps],
            }
            for ended, run, sweeps, results in runs
        ],
    }


def _print(
    ended: Ended,
    run: RunSummary,
    sweeps: list[StoredSweep],
    results: dict[str, Result],
    workspace: Workspace,
    here: str,
) -> None:
    """Print a run; `here` are the options with which it is found."""
    if to_summarise(len(sweeps)):
        print_summary(sweeps, results, workspace.registry)
        say(f"fraexp show {run.number} --all{here} shows each sweep")
    else:
        print_table(*sweep_table(sweeps[:SHOWN], results, workspace.registry))
        _print_errors(sweeps[:SHOWN], results, workspace)
        if len(sweeps) > SHOWN:
            say(f"{plural(len(sweeps) - SHOWN, 'more sweep')}; see fraexp show {run.number}{here}")
    for remedy in remedies(sweeps):
        say(remedy)
    print(f"\nrun {run.number} {run.state}: {_counts(run)}")
    for path in ended.figures:
        print_path(path, "figure ")
    say(_next(run, sweeps, results, here))


def _print_errors(sweeps: list[StoredSweep], results: dict[str, Result], workspace: Workspace) -> None:
    """Print the errors of cases against their plant, if there are any."""
    labels = [sweep.labels for sweep in sweeps]
    if not any("case" in of for of in labels):
        return
    from fraexp.cli.against_plant import print_errors
    from fraexp.figures.kinds.plant_errors import errors_info

    comparable = [of for of in workspace.figures.shown(sweeps, results) if of.truth is not None]
    if len(comparable) > 1:
        print()
        print_errors(errors_info(comparable))


def _next(run: RunSummary, sweeps: list[StoredSweep], results: dict[str, Result], here: str) -> str:
    steps = [f"fraexp show {run.number}", f"fraexp show {short(sweeps[0].key)}" if sweeps else "fraexp list"]
    if any(result.response or result.curves for result in results.values()):
        steps.append(f"fraexp plot {run.number} -o FILE.pdf")
    return f"next: {', '.join(f'{step}{here}' for step in steps)}"


def _counts(run: RunSummary) -> str:
    time = f", {duration((run.ended - run.started).total_seconds())}" if run.ended else ""
    return f"{plural(run.total, 'sweep')}, {run.computed} computed, {run.reused} reused, {run.failed} failed{time}"
