"""``fraexp measure``: play a study's excitation on a machine, and show the response while it is measured."""

import sys
from argparse import Namespace
from collections.abc import Generator, Sequence
from typing import Any

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import follow, print_outcome
from fraexp.cli.measurement_meter import MeasurementMeter
from fraexp.cli.output import print_json, say
from fraexp.cli.plan_output import plan_document, print_plan
from fraexp.data.terminal_text import printable
from fraexp.errors import ConsentError, StudyError
from fraexp.execution.events import Event
from fraexp.measurement.consent import Consent
from fraexp.measurement.measured_points import kept_points
from fraexp.workspace.autonomous_service import AutonomousService
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Measure, run the study of the record, and print its sweeps."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    if arguments.autonomous:
        return _measure_autonomously(arguments, workspace)
    meter = MeasurementMeter()
    service = MeasurementService(
        workspace, arguments.study, arguments.overrides, meter.show_planning, arguments.trust_program
    )
    if arguments.dry_run:
        with meter.bar:
            plans = service.plans()
        if arguments.json:
            print_json({"plans": [plan_document(plan) for plan in plans]})
        else:
            for plan in plans:
                kept = kept_points(service.files(plan.task), plan.task)
                print_plan(plan, {point.number for point in kept} if not arguments.fresh else ())
        return ExitCode.OK
    _ask_consents(service.missing_consents)
    return _follow(service.measure(arguments.fresh), meter, arguments, workspace)


def _ask_consents(consents: Sequence[Consent]) -> None:
    """Ask on a terminal for what the study's machine does; ConsentError if that is not allowed.

    Without a terminal the measurement itself refuses it.
    """
    for consent in consents if sys.stdin.isatty() else ():
        text = printable(f"the study would {consent.action}")
        print(f"{text}\nallow it, now and later? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            consent.remember()
        else:
            raise ConsentError("not allowed: nothing was run")


def _measure_autonomously(arguments: Namespace, workspace: WorkspaceService) -> ExitCode:
    """Measure an axis of which only the limits are known; the exit code says whether the verdict is ok."""
    if arguments.dry_run:
        raise StudyError("--dry-run: an autonomous measurement plans each stage by the one before; leave it out")
    service = AutonomousService(workspace, arguments.study, arguments.overrides, arguments.trust_program)
    _ask_consents(service.missing_consents)
    code = _follow(service.measure(arguments.fresh), MeasurementMeter(), arguments, workspace)
    return ExitCode.INCOMPLETE if code is ExitCode.OK and not service.is_good else code


def _follow(
    events: Generator[Any, None, None], meter: MeasurementMeter, arguments: Namespace, workspace: WorkspaceService
) -> ExitCode:
    """Show a measurement and the run of its record; return the exit code."""
    try:
        first = meter.follow(events)
    except KeyboardInterrupt:
        say("interrupted: the machine was stopped; measured points are kept, and the same command continues")
        return ExitCode.INTERRUPTED
    followed = follow(_rest(first, events))
    return print_outcome(followed, arguments, workspace)


def _rest(first: Event | None, events: Generator[object, None, None]) -> Generator[Event, None, None]:
    """Yield the events of the run, whose first one has been taken already."""
    if first is not None:
        yield first
    yield from (event for event in events if isinstance(event, Event))
