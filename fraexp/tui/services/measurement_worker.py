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
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from types import FrameType
from typing import NoReturn

from fraexp.data.results import Result
from fraexp.data.rotary_axes import is_rotary
from fraexp.errors import FraexpError
from fraexp.execution.events import Noticed
from fraexp.measurement.measured_points import MeasuredPoint, MeasurementFiles, kept_points, measurement_identity
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice, PointMeasured
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.measurement.tasks import MeasurementTask
from fraexp.measurement.watched_machine import drive_note
from fraexp.simulation.motion_limits import NO_DEMAND, Demand, MotionLimits
from fraexp.study.sections import is_for_autonomous
from fraexp.study.study_file import find_studies, read
from fraexp.tui.services.live_measurement import (
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
    StageReport,
)
from fraexp.views.measurement_texts import (
    AUTONOMOUS_STAGES,
    AUTONOMOUS_TOTAL,
    FORCE_PLACE,
    demand_names,
    demand_units,
    found_text,
    peak_of,
    plan_cells,
    plan_heads,
    plan_total,
)
from fraexp.views.missed_bands import MissedBands
from fraexp.workspace.autonomous_service import STAGES, AutonomousService, EvaluationBegun, StageBegun
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

REPORT_INTERVAL_S = 0.1
"""Least time between two reports of progress, of which nobody reads more."""
FilesOf = Callable[[MeasurementTask], MeasurementFiles]
"""Returns the files of an experiment."""
EstimatePoint = Callable[[MeasurementTask, MeasuredPoint], Sequence[Result | str]]
"""Returns what each estimator finds at a point, or why it does not."""


def limited_motions(limits: MotionLimits, demand: Demand, rotary: bool) -> tuple[LimitedMotion, ...]:
    """Return each limited quantity, with what is predicted of it."""
    named = zip(demand_names(), demand_units(rotary), Demand._fields, demand, strict=True)
    return tuple(
        LimitedMotion(name, unit, limit, predicted, place)
        for place, (name, unit, field, predicted) in enumerate(named)
        if (limit := getattr(limits, field)) is not None
    )


def plan_report(plan: MeasurementPlan, files: MeasurementFiles) -> PlanReport:
    """Return the plan of an experiment as the UI shows it."""
    settings = plan.task.settings
    assert settings is not None
    frequencies = [
        line / (point.period.waveform.size * point.sample_time)
        for point in plan.points
        for line in (point.period.lines[0], point.period.lines[-1])
    ]
    kept = {point.number for point in kept_points(files, plan.task)}
    return PlanReport(
        label=plan.task.label,
        machine=settings.machine.name,
        motions=limited_motions(plan.limits, plan.demand, is_rotary(plan.task.experiment)),
        margin=settings.margin,
        heads=tuple(plan_heads(plan)),
        rows=tuple(tuple(plan_cells(point)) for point in plan.points),
        seconds=plan.seconds_without(kept),
        total=plan_total(plan, kept),
        frequency_range=(float(min(frequencies)), float(max(frequencies))),
        band=settings.band,
        kept=len(kept),
        is_other_stored=files.identity() not in ("", measurement_identity(plan.task)),
        total_afresh=plan_total(plan),
        drive=drive_note(settings.machine.name, settings.machine.can_disable),
    )


class FeedReporter:
    """Turns the events of a measurement into reports."""

    def __init__(self, files: FilesOf, estimate: EstimatePoint) -> None:
        self._files, self._estimate = files, estimate
        self._task: MeasurementTask | None = None
        self._plan: MeasurementPlan | None = None
        self._missed = MissedBands()
        self._unit = ""
        self._reported: tuple[object, ...] = ()
        self._reported_at = 0.0

    def reports(self, event: object) -> Iterator[Report]:
        """Yield the reports of an event of a measurement."""
        match event:
            case MeasurementBegun(plan, kept):
                self._plan = plan
                self._missed.begin(event)
                self._task, self._unit = plan.task, demand_units(is_rotary(plan.task.experiment))[FORCE_PLACE]
                begun = plan_report(plan, self._files(plan.task))
                yield BeginReport(begun, len(plan.points), len(kept))
                for point in kept:
                    found = self._estimate(plan.task, point)
                    yield PointReport(f"{point.frequency}: kept", len(kept), begun.seconds, self._responses(found))
            case MeasurementNotice(what):
                yield NoticeReport(what)
            case PointProgress():
                yield from self._progress(event)
            case PointEstimated(measured, results):
                assert self._plan is not None
                self._missed.add(measured.point)
                yield PointReport(
                    found_text(event, self._plan), measured.done, measured.seconds_left, self._responses(results)
                )

    @property
    def remark(self) -> str:
        """What is to be said at the end of all points; may be empty."""
        return self._missed.text

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

    def _responses(self, results: Sequence[Result | str]) -> tuple[LabelledResponse, ...]:
        """Return the responses among the results, each with its label."""
        return tuple(
            (label, result.response)
            for label, result in zip(self.labels(), results, strict=True)
            if isinstance(result, Result) and result.response is not None
        )

    def labels(self) -> list[str]:
        """Return the labels of the results of a point: the names of the estimators."""
        assert self._task is not None
        names = [str(spec["name"]) for spec in self._task.estimators]
        several = {name for name in names if names.count(name) > 1}
        labels = [f"{name} {place + 1}" if name in several else name for place, name in enumerate(names)]
        return [f"{self._task.label}, {label}" if self._task.label else label for label in labels]


PARTS_BEFORE, PARTS = (0, 1, 3, 4), 6
"""Parts of the progress before each stage, and all: stages count alike, and the evaluations after two of them."""


def stages_report(service: AutonomousService) -> PlansReport:
    """Return what is going to happen: no points, as each stage is planned by what the one before shows."""
    plan = PlanReport(
        label="",
        machine=service.settings.machine.name,
        motions=limited_motions(service.limits, NO_DEMAND, service.is_rotary),
        margin=service.settings.margin,
        heads=("stage", "what is played"),
        rows=AUTONOMOUS_STAGES,
        seconds=0.0,
        total=AUTONOMOUS_TOTAL,
        frequency_range=(1.0, 1.0),
        band=None,
        kept=len(service.files.points()),
        is_other_stored=False,
        drive=drive_note(service.settings.machine.name, service.settings.machine.can_disable),
    )
    return PlansReport((plan,), is_autonomous=True, consents=tuple(service.missing_consents))


def stage_report(event: StageBegun) -> StageReport:
    """Return how far a measurement is when a stage begins, or a level of it."""
    share = 1 / (event.levels * PARTS)
    level = f", level {event.level + 1} of {event.levels}" if event.levels > 1 else ""
    begin = PARTS_BEFORE[event.stage] / PARTS + event.level * share
    return StageReport(f"{stage_text(event.stage)}{level}", begin, share)


def evaluation_report(event: EvaluationBegun) -> StageReport:
    """Return how far a measurement is when a stage is evaluated."""
    rest = "the axis rests while what was recorded is evaluated"
    return StageReport(stage_text(event.stage), (PARTS_BEFORE[event.stage] + 1) / PARTS, 0.0, rest, event.seconds)


def stage_text(stage: int) -> str:
    """Return which stage it is, by its place."""
    return f"stage {stage + 1} of {len(STAGES)}"


class AutonomousReporter(FeedReporter):
    """Turns the events of an autonomous measurement into reports; the responses of a point are those of its stage."""

    def __init__(self, service: AutonomousService) -> None:
        super().__init__(lambda _: service.files, service.estimate_point)
        self._service = service
        self._stage = ""

    def reports(self, event: object) -> Iterator[Report]:
        """Yield the reports of an event; of the run that ends it, what was found."""
        match event:
            case PointMeasured(point):
                assert self._task is not None
                results = tuple(self._service.estimate_point(self._task, point))
                yield from super().reports(PointEstimated(event, results))
            case Noticed(text):
                yield NoticeReport(text)
            case _:
                if isinstance(event, StageBegun):
                    self._stage = event.label
                    yield stage_report(event)
                if isinstance(event, EvaluationBegun):
                    yield evaluation_report(event)
                yield from super().reports(event)

    def labels(self) -> list[str]:
        """Return the label of a point: how strongly it is excited."""
        return [self._stage]


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
            reports = tuple(plan_report(plan, service.files(plan.task)) for plan in plans)
            return PlansReport(reports, consents=tuple(service.missing_consents))
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
