"""The measuring process of the terminal UI: it plans, measures when told to, and stops when its orders end.

``python -m`` this module with a folder, a study and overrides. It plans, waits on standard input for ``begin`` or
``fresh``, and measures. As soon as standard input ends, because the user has stopped it or the UI has died, it lets the
machine come to rest, as after Ctrl-C. If this process dies, the watchdog of the machine does.
"""

import os
import signal
import sys
import threading
from collections.abc import Generator
from contextlib import closing
from types import FrameType
from typing import NoReturn

from fraexp.errors import FraexpError
from fraexp.study.sections import is_for_autonomous
from fraexp.study.study_file import find_studies, read
from fraexp.tui.services.autonomous_reporter import AutonomousReporter, stages_report
from fraexp.tui.services.measurement_feed import EndReport, PlansReport, ReportWriter
from fraexp.tui.services.measurement_reporter import FeedReporter, plan_report
from fraexp.workspace.autonomous_service import AutonomousService
from fraexp.workspace.measurement_service import MeasurementService
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

BEGIN_ORDER, FRESH_ORDER = "begin", "fresh"
"""Orders to measure: to continue what an earlier measurement has stored, and to discard it."""
Service = MeasurementService | AutonomousService
EXAMPLE = 'add to the study, for example:\n[measurement]\nmachine = { name = "simulated" }'


def read_plans(service: MeasurementService) -> PlansReport:
    """Return the plans of a study; FraexpError says all that it lacks."""
    faults: list[str] = []
    try:
        service.check()
    except FraexpError as error:
        faults.append(f"{error}; {EXAMPLE}" if "[measurement]" in str(error) else str(error))
    try:
        plans = service.plans()
        if not faults:
            return PlansReport(tuple(plan_report(plan, service.files(plan.task)) for plan in plans))
    except FraexpError as error:
        faults.insert(0, str(error))
    raise FraexpError("\n".join(faults))


def open_service(workspace: WorkspaceService, study: str, overrides: list[str]) -> Service:
    """Return the measurement of a study: an autonomous one where it has nothing but limits and a machine."""
    files = find_studies(study, workspace.folder)
    if len(files) == 1 and is_for_autonomous(read(files[0][1])):
        return AutonomousService(workspace, study, overrides)
    return MeasurementService(workspace, study, overrides)


def measure(service: Service, fresh: bool, writer: ReportWriter) -> str:
    """Measure all points and report them; return what is to be said at the end."""
    reporter: FeedReporter
    events: Generator[object, None, None]
    if isinstance(service, AutonomousService):
        reporter, events = AutonomousReporter(service), service.measure(fresh)
    else:
        reporter, events = FeedReporter(service.files, service.estimate_point), service.measure_points(fresh)
    with closing(events):
        for event in events:
            for report in reporter.reports(event):
                writer.send(report)
    return reporter.remark


def stop_once(number: int, frame: FrameType | None) -> NoReturn:
    """Interrupt the measurement; what follows, such as the machine's stop, is not interrupted again."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    raise KeyboardInterrupt


def await_end_of_orders() -> None:
    """Wait until standard input ends, then interrupt the main thread, whatever it waits for."""
    sys.stdin.read()
    main_thread = threading.main_thread().ident
    assert main_thread is not None
    signal.pthread_kill(main_thread, signal.SIGINT)


def main() -> None:
    """Plan, wait for the order to begin, measure, and report how it ended."""
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as stream:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a plugin prints is no report
        writer = ReportWriter(stream)
        folder, study, *overrides = sys.argv[1:]
        signal.signal(signal.SIGINT, stop_once)
        try:
            workspace = WorkspaceService.open(folder, os.environ[DATABASE_VARIABLE])
            service = open_service(workspace, study, overrides)
            writer.send(stages_report(service) if isinstance(service, AutonomousService) else read_plans(service))
            order = sys.stdin.readline().strip()
            if order in (BEGIN_ORDER, FRESH_ORDER):
                threading.Thread(target=await_end_of_orders, name="orders", daemon=True).start()
                remark = measure(service, order == FRESH_ORDER, writer)
                writer.send(EndReport("complete", remark, study=service.path.stem))
        except KeyboardInterrupt:
            writer.send(EndReport("stopped", "measured points are kept"))
        except FraexpError as error:
            writer.send(EndReport("failed", str(error)))
        except Exception as error:  # whatever a plugin raises: the UI reports it
            writer.send(EndReport("failed", f"{type(error).__name__}: {' '.join(str(error).split())}"))


if __name__ == "__main__":
    main()
