"""Events of a measurement as reports for the terminal UI."""

import time
from collections.abc import Callable, Iterator, Sequence

from fraexp.data.results import Result
from fraexp.data.rotary_axes import is_rotary
from fraexp.measurement.measured_points import MeasuredPoint, MeasurementFiles, kept_points, measurement_identity
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.measurement.tasks import MeasurementTask
from fraexp.measurement.watched_machine import drive_note
from fraexp.simulation.motion_limits import Demand, MotionLimits
from fraexp.tui.services.measurement_feed import (
    BeginReport,
    LabelledResponse,
    LimitedMotion,
    NoticeReport,
    PlanReport,
    PointReport,
    ProgressReport,
    Report,
)
from fraexp.views.measurement_texts import (
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
from fraexp.workspace.measurement_service import PointEstimated

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
