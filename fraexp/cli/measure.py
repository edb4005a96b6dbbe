"""``fraexp measure``: play a study's excitation on a machine, and show the response while it is measured."""

from argparse import Namespace
from collections.abc import Generator

from fraexp.cli.exits import ExitCode
from fraexp.cli.follow import RunEvents, follow, print_outcome
from fraexp.cli.measurement_meter import MeasurementMeter
from fraexp.cli.output import print_json, say
from fraexp.cli.plan_output import plan_document, print_plan
from fraexp.execution.events import Event
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_service import WorkspaceService


def execute(arguments: Namespace) -> ExitCode:
    """Measure, run the study of the record, and print its sweeps."""
    workspace = WorkspaceService.open(arguments.workspace, arguments.db)
    service = MeasurementService(workspace, arguments.study, arguments.overrides)
    if arguments.dry_run:
        plans = service.plans()
        if arguments.json:
            print_json({"plans": [plan_document(plan) for plan in plans]})
        else:
            for plan in plans:
                print_plan(plan)
        return ExitCode.OK
    meter, followed = MeasurementMeter(), RunEvents()
    events = service.measure(arguments.fresh)
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
