"""The measuring process of the terminal UI: it plans, measures when told to, and stops when its orders end.

``python -m`` this module with a folder, a study and overrides. It plans, waits on standard input for ``begin`` or
``fresh``, and measures. As soon as standard input ends, because the user has stopped it or the UI has died, it lets the
machine come to rest, as after Ctrl-C. If this process dies, the watchdog of the machine does.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from types import FrameType
from typing import NoReturn

from fraexp.data.results import Result
from fraexp.errors import FraexpError
from fraexp.measurement.measured_points import measurement_identity
from fraexp.measurement.measurement import MeasurementBegun, MeasurementEvent, MeasurementNotice
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.measurement.tasks import MeasurementTask
from fraexp.simulation.motion_limits import Demand
from fraexp.tui.services.measurement_feed import (
    BeginReport,
    EndReport,
    LabelledResponse,
    LimitedMotion,
    NoticeReport,
    PlanReport,
    PlansReport,
    PointReport,
    ProgressReport,
    Report,
    ReportWriter,
)
from fraexp.views.measurement_texts import (
    FORCE_PLACE,
    demand_names,
    demand_units,
    peak_of,
    plan_cells,
    plan_heads,
    plan_total,
    point_text,
)
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

REPORT_INTERVAL_S = 0.1
"""Least time between two reports of progress, of which nobody reads more."""
BEGIN_ORDER, FRESH_ORDER = "begin", "fresh"
"""Orders to measure: to continue what an earlier measurement has stored, and to discard it."""
EXAMPLE = 'add to the study, for example:\n[measurement]\nmachine = { name = "simulated" }'


def plan_report(plan: MeasurementPlan, service: MeasurementService) -> PlanReport:
    """Return the plan of an experiment as the UI shows it."""
    settings, limits = plan.task.settings, plan.limits
    assert settings is not None
    named = zip(demand_names(), demand_units(plan), Demand._fields, plan.demand, strict=True)
    motions = [
        LimitedMotion(name, unit, limit, predicted, place)
        for place, (name, unit, field, predicted) in enumerate(named)
        if (limit := getattr(limits, field)) is not None
    ]
    frequencies = [
        line / (point.period.waveform.size * point.sample_time)
        for point in plan.points
        for line in (point.period.lines[0], point.period.lines[-1])
    ]
    files = service.files(plan.task)
    is_other = bool(files.identity()) and files.identity() != measurement_identity(plan.task)
    return PlanReport(
        label=plan.task.label,
        machine=settings.machine.name,
        motions=tuple(motions),
        margin=settings.margin,
        heads=tuple(plan_heads(plan)),
        rows=tuple(tuple(plan_cells(point)) for point in plan.points),
        seconds=plan.seconds,
        total=plan_total(plan),
        frequency_range=(float(min(frequencies)), float(max(frequencies))),
        band=settings.band,
        kept=0 if is_other else len(files.points()),
        is_other_stored=is_other,
    )


class FeedReporter:
    """Turns the events of a measurement into reports."""

    def __init__(self, service: MeasurementService) -> None:
        self._service = service
        self._task: MeasurementTask = service.tasks[0]
        self._unit = ""
        self._reported: tuple[object, ...] = ()
        self._reported_at = 0.0

    def reports(self, event: MeasurementEvent | PointEstimated) -> Iterator[Report]:
        """Yield the reports of an event."""
        match event:
            case MeasurementBegun(plan, kept):
                self._task, self._unit = plan.task, demand_units(plan)[FORCE_PLACE]
                yield BeginReport(plan_report(plan, self._service), len(plan.points))
                for place, point in enumerate(kept, start=1):
                    found = self._service.estimate_point(plan.task, point)
                    yield PointReport(f"{point.frequency}: kept", place, plan.seconds, self._responses(found))
            case MeasurementNotice(what):
                yield NoticeReport(what)
            case PointProgress():
                yield from self._progress(event)
            case PointEstimated(measured, results):
                yield PointReport(
                    point_text(event), measured.done, measured.seconds_left, self._responses(list(results))
                )

    def _progress(self, event: PointProgress) -> Iterator[ProgressReport]:
        """Yield the report of a progress, unless one like it was sent just now."""
        state, now = (event.point.number, event.point.amplitude, event.is_settled), time.monotonic()
        if state == self._reported and now < self._reported_at + REPORT_INTERVAL_S:
            return
        self._reported, self._reported_at = state, now
        point = event.point
        yield ProgressReport(
            frequency=point.frequency,
            at=float(point.period.lines[0] / (point.period.waveform.size * point.sample_time)),
            peak=f"{peak_of(point):.4g} {self._unit}",
            seconds=event.seconds,
            is_settled=event.is_settled,
            periods=event.periods,
            band=event.band,
            demand=tuple(event.demand),
            predicted=tuple(point.demand),
        )

    def _responses(self, results: list[Result | str]) -> tuple[LabelledResponse, ...]:
        """Return the responses among the results, each with the name of its estimator."""
        names = [str(spec["name"]) for spec in self._task.estimators]
        several = {name for name in names if names.count(name) > 1}
        labels = [f"{name} {place + 1}" if name in several else name for place, name in enumerate(names)]
        labels = [f"{self._task.label}, {label}" if self._task.label else label for label in labels]
        return tuple(
            (label, result.response)
            for label, result in zip(labels, results, strict=True)
            if isinstance(result, Result) and result.response is not None
        )


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
            return PlansReport(tuple(plan_report(plan, service) for plan in plans))
    except FraexpError as error:
        faults.insert(0, str(error))
    raise FraexpError("\n".join(faults))


def measure(service: MeasurementService, fresh: bool, writer: ReportWriter) -> None:
    """Measure all points, and report them."""
    reporter = FeedReporter(service)
    with closing(service.measure_points(fresh)) as events:
        for event in events:
            for report in reporter.reports(event):
                writer.send(report)


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
            service = MeasurementService(workspace, study, overrides)
            writer.send(read_plans(service))
            order = sys.stdin.readline().strip()
            if order in (BEGIN_ORDER, FRESH_ORDER):
                threading.Thread(target=await_end_of_orders, name="orders", daemon=True).start()
                measure(service, order == FRESH_ORDER, writer)
                writer.send(EndReport("complete", study=service.path.stem))
        except KeyboardInterrupt:
            writer.send(EndReport("stopped", "measured points are kept"))
        except FraexpError as error:
            writer.send(EndReport("failed", str(error)))
        except Exception as error:  # whatever a plugin raises: the UI reports it
            writer.send(EndReport("failed", f"{type(error).__name__}: {' '.join(str(error).split())}"))


if __name__ == "__main__":
    main()
