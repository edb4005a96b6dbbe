"""The events of runs as they come, and the report at the end."""

from argparse import Namespace
from collections import Counter
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, field
from typing import NamedTuple

from fraexp.cli.documents import run_document, sweep_document
from fraexp.cli.exits import ExitCode
from fraexp.cli.output import print_json, print_line, print_path, print_table, say
from fraexp.cli.progress import Meter
from fraexp.cli.summary import needs_summary, print_summary
from fraexp.data.results import UNUSABLE_OUTCOMES, Result
from fraexp.data.texts import printable
from fraexp.execution.background import announce_begin
from fraexp.execution.events import Begun, Ended, Event, Finished, Noticed, Planned, Preparing, Progress, Why
from fraexp.figures.result_files import json_value
from fraexp.store import RunSummary, StoredSweep, mark_damaged
from fraexp.views.fields import remedies, run_state_text
from fraexp.views.run_progress import counts_text, time_text
from fraexp.views.text_tables import sweep_table
from fraexp.views.words import duration_text, plural, short_key
from fraexp.workspace.workspace_service import WorkspaceService

MAX_NAMED_SWEEPS = 6
"""Maximum number of sweeps named in a line; the JSON document has all."""
RERUN_CLASSES = {"stale": "stale", "failed": "unusable"}
"""Argument of ``--rerun`` that computes stored sweeps again, by their state."""


def why_lines(planned: Planned) -> Iterator[str]:
    """Yield a line for each reason: the number of sweeps, what is done with them, and why."""
    for why in sorted(planned.whys, key=lambda why: why.computed):
        rerun = "" if why.computed else RERUN_CLASSES.get(why.state, "")
        remedy = f"; --rerun {rerun} computes them again" if rerun else ""
        yield f"  {len(why.sweeps):,} {_action_text(why)}: {why.reason}{_sweep_names(why)}{remedy}"


def _action_text(why: Why) -> str:
    match why.state:
        case "new":
            return "new"
        case "failed" if why.computed:
            return "to be tried again"
    done = "computed again" if why.computed else "reused"
    return done if why.state == "same" else f"{done}, {RERUN_CLASSES.get(why.state, why.state)}"


def _sweep_names(why: Why) -> str:
    """Return the keys of failed sweeps; new sweeps are described by the reason instead."""
    if why.state == "new" or not why.each:
        return ""
    names = [f"{short_key(sweep.key)} {why.each.get(sweep.key, '')}" for sweep in why.sweeps[:MAX_NAMED_SWEEPS]]
    more = len(why.sweeps) - MAX_NAMED_SWEEPS
    return f": {', '.join(names)}" + (f" and {more:,} more" if more > 0 else "")


def why_document(why: Why) -> dict[str, object]:
    """Return a reason with all of its sweeps as plain data."""
    return {
        "computed": why.computed,
        "state": why.state,
        "reason": why.reason,
        "count": len(why.sweeps),
        "sweeps": [
            {"key": sweep.key, "labels": dict(sweep.labels), "why": why.each.get(sweep.key, why.reason)}
            for sweep in why.sweeps
        ],
    }


MAX_TABLE_SWEEPS = 50
"""Maximum number of sweeps in the table at the end; ``fraexp show`` has all."""
MAX_REPORTED_FAILURES = 20
"""Maximum number of reasons of failures that are reported; ``fraexp show`` has all."""
PLAN_FIELDS = ("study", "title", "total", "reused", "missing", "stale")


class FinishedRun(NamedTuple):
    """A run that has ended, with what is stored of it."""

    ended: Ended
    run: RunSummary
    sweeps: list[StoredSweep]
    results: dict[str, Result]
    """By sweep key."""


@dataclass
class RunEvents:
    """The events of the runs that were followed."""

    planned: list[Planned] = field(default_factory=list)
    begun: list[int] = field(default_factory=list)
    """Numbers of the runs that are in the database."""
    ended: list[Ended] = field(default_factory=list)
    computed: Counter[int] = field(default_factory=Counter)
    """Number of sweeps that each run has computed and stored."""
    reasons: Counter[str] = field(default_factory=Counter)
    """Number of failures of the present run by reason."""
    interrupted: bool = False


def follow(events: Generator[Event, None, None], is_shown: bool = True) -> RunEvents:
    """Show events as they come, or only take them; Ctrl-C ends the run, and finished sweeps are kept."""
    followed, meter = RunEvents(), Meter() if is_shown else None
    try:
        with meter.bar if meter else nullcontext(), closing(events):
            for event in events:
                _take_event(event, followed)
                if meter:
                    _show_event(event, followed, meter)
    except KeyboardInterrupt:
        followed.interrupted = True
    return followed


def _take_event(event: Event, followed: RunEvents) -> None:
    match event:
        case Planned():
            followed.planned.append(event)
        case Begun():
            followed.begun.append(event.run)
        case Finished():
            if event.state == "computed":
                followed.computed[followed.begun[-1]] += 1
            if event.error:
                followed.reasons[event.error] += 1
        case Ended():
            followed.ended.append(event)


def _show_event(event: Event, followed: RunEvents, meter: Meter) -> None:
    match event:
        case Planned():
            meter.begin(event.reused)
            say(_plan_text(event))
            for line in why_lines(event):
                say(printable(line))
        case Begun():
            announce_begin(event.run)
        case Preparing():
            meter.note(event.what)
        case Noticed():
            say(event.what)
        case Progress():
            meter.move(event.done, event.total, event.running, event.doing, event.time)
        case Finished():
            meter.finish()
            if event.error:
                _report_failure(event, followed.reasons)
        case Ended():
            _report_repeated(followed.reasons)


def _report_repeated(reasons: Counter[str]) -> None:
    """Report how often each reason occurred, if more than once, and forget the reasons."""
    for reason, count in reasons.items():
        if count > 1:
            say(f"{plural(count, 'sweep')} failed for this reason: {reason}")
    reasons.clear()


def _report_failure(event: Finished, reasons: Counter[str]) -> None:
    """Report a failure if its reason is new; the others are counted at the end."""
    if reasons[event.error] > 1:
        return
    if len(reasons) <= MAX_REPORTED_FAILURES:
        say(f"{short_key(event.sweep.key)} failed: {event.error}")
    elif len(reasons) == MAX_REPORTED_FAILURES + 1:
        say("further failures are only counted; fraexp show lists all")


def _plan_text(planned: Planned) -> str:
    stale = f" ({planned.stale} stale: a plugin's source has changed; --rerun stale)" if planned.stale else ""
    time = f", {time_text(planned.time)}" if planned.missing else ""
    sweeps = plural(planned.total, "sweep")
    return f"{planned.study}: {sweeps}, {planned.reused} reused{stale}, {planned.missing} to compute{time}"


def print_outcome(followed: RunEvents, arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Print the results of the runs, and return the exit code; StoreError if the database has lost some."""
    _confirm_stored(followed, workspace)
    runs = [read_run(ended, workspace) for ended in followed.ended if ended.run is not None]
    for finished in runs:
        if finished.ended.note:
            say(f"run {finished.run.number}: no figure was drawn: {' '.join(finished.ended.note.split())}")
    if arguments.json:
        print_json(_document(followed, runs))
    else:
        titles = {planned.study: planned.title for planned in followed.planned}
        for number, finished in enumerate(runs):
            if number > 0:
                print()
            if len(runs) > 1:
                print_line(_heading(finished.run.study, titles))
            _print(finished, workspace)
    if followed.interrupted:
        kept = plural(_computed_count(followed, workspace), "sweep")
        say(f"stopped by you: {kept} computed and kept; the same command continues")
        return ExitCode.INTERRUPTED
    sweeps = [sweep for finished in runs for sweep in finished.sweeps]
    failed = any(of.state in ("failed", "pending") or of.outcome in UNUSABLE_OUTCOMES for of in sweeps)
    return ExitCode.INCOMPLETE if failed else ExitCode.OK


def _confirm_stored(followed: RunEvents, workspace: WorkspaceService) -> None:
    """Raise StoreError if the database, opened anew, lacks results that were stored."""
    for number, count in followed.computed.items():
        if count:
            with workspace.open_store() as store:
                store.confirm_run(number, count)


def _heading(study: str, titles: Mapping[str, str]) -> str:
    return ": ".join(part for part in (study, titles.get(study, "")) if part)


def read_run(ended: Ended, workspace: WorkspaceService) -> FinishedRun:
    """Return what is stored of a run that has ended."""
    assert ended.run is not None
    with workspace.open_store() as store:
        sweeps = store.sweeps(ended.run)
        results = store.results(sweep.key for sweep in sweeps)
        return FinishedRun(ended, store.run(ended.run), mark_damaged(sweeps, results), results)


def _computed_count(followed: RunEvents, workspace: WorkspaceService) -> int:
    """Return how many sweeps the runs have stored: the last ones are stored after the last event."""
    if not followed.begun:
        return 0
    with workspace.open_store() as store:
        return sum(store.run(number).computed for number in followed.begun)


def _document(followed: RunEvents, runs: Sequence[FinishedRun]) -> dict[str, object]:
    return {
        "planned": [
            {
                **{name: getattr(planned, name) for name in PLAN_FIELDS},
                **planned.time._asdict(),
                **({"why": [json_value(why_document(why)) for why in planned.whys]} if planned.whys else {}),
            }
            for planned in followed.planned
        ],
        "interrupted": followed.interrupted,
        "runs": [
            {
                **run_document(run),
                "figures": [str(path) for path in ended.figures],
                "sweeps": [sweep_document(sweep, results.get(sweep.key), points=False) for sweep in sweeps],
            }
            for ended, run, sweeps, results in runs
        ],
    }


def _print(finished: FinishedRun, workspace: WorkspaceService) -> None:
    """Print a run."""
    ended, run, sweeps, results = finished
    here = workspace.shown_options()
    if needs_summary(len(sweeps)):
        print_summary(sweeps, results, workspace.registry)
        say(f"fraexp show {run.number}{here} | less shows each sweep")
    else:
        print_table(*sweep_table(sweeps[:MAX_TABLE_SWEEPS], results, workspace.registry))
        _print_errors(sweeps[:MAX_TABLE_SWEEPS], results, workspace)
        if len(sweeps) > MAX_TABLE_SWEEPS:
            say(f"{plural(len(sweeps) - MAX_TABLE_SWEEPS, 'more sweep')}; see fraexp show {run.number}{here}")
    for remedy in remedies(sweeps):
        say(remedy)
    print()
    print_line(f"run {run.number} {run_state_text(run)}: {_end_text(run)}")
    for path in ended.figures:
        print_path(path, "figure ")
    say(_next_steps(run, sweeps, results, here))


def _print_errors(sweeps: list[StoredSweep], results: dict[str, Result], workspace: WorkspaceService) -> None:
    """Print the errors against the plant, if the study has cases."""
    labels = [sweep.labels for sweep in sweeps]
    if not any("case" in of for of in labels):
        return
    from fraexp.cli.compare import print_errors
    from fraexp.figures.kinds.response_errors import errors_info

    comparable = [of for of in workspace.figures.shown_results(sweeps, results) if of.truth is not None]
    if len(comparable) > 1:
        print()
        print_errors(errors_info(comparable))


def _next_steps(run: RunSummary, sweeps: list[StoredSweep], results: dict[str, Result], here: str) -> str:
    steps = [f"fraexp show {run.number}", f"fraexp show {short_key(sweeps[0].key)}" if sweeps else "fraexp list"]
    if any(result.response or result.curves for result in results.values()):
        steps.append(f"fraexp plot {run.number} -o FILE.pdf")
    return f"next: {', '.join(f'{step}{here}' for step in steps)}"


def _end_text(run: RunSummary) -> str:
    time = f", {duration_text((run.ended - run.started).total_seconds())}" if run.ended else ""
    return f"{plural(run.total, 'sweep')}, {counts_text(run)}{time}"
