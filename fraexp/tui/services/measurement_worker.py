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
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import fields
from types import FrameType
from typing import Any, NoReturn

import numpy as np

from fraexp.data.results import FrequencyResponse, Result
from fraexp.data.rotary_axes import is_rotary
from fraexp.errors import FraexpError
from fraexp.execution.events import Noticed
from fraexp.measurement.measured_points import MeasurementFiles, kept_points, measurement_identity
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice, PointMeasured
from fraexp.measurement.measurement_plan import MeasurementPlan
from fraexp.measurement.point_measurement import PointProgress
from fraexp.measurement.tasks import MeasurementTask
from fraexp.measurement.watched_machine import drive_note
from fraexp.simulation.motion_limits import NO_DEMAND, Demand, MotionLimits
from fraexp.study.sections import is_for_autonomous
from fraexp.study.study_file import find_studies, read
from fraexp.tui.services.live_measurement import LimitedMotion, PlanSummary, PlayedPoint, send_changes
from fraexp.views import measurement_texts
from fraexp.workspace.autonomous_service import STAGES, AutonomousService, EvaluationBegun, StageBegun
from fraexp.workspace.measurement_service import MeasurementService, PointEstimated
from fraexp.workspace.workspace_folder import DATABASE_VARIABLE
from fraexp.workspace.workspace_service import WorkspaceService

PROGRESS_INTERVAL_S = 0.1
"""Least time between two changes of the point that is played, of which nobody reads more."""
PARTS_BEFORE, PARTS = (0, 1, 3, 4), 6
"""Parts of the progress before each stage, and all: stages count alike, and the evaluations after two of them."""
EXAMPLE = 'add to the study, for example:\n[measurement]\nmachine = { name = "simulated" }'
Service = MeasurementService | AutonomousService
Tell = Callable[..., None]
"""Takes the changes of the measurement's state by name."""


def limited_motions(limits: MotionLimits, demand: Demand, rotary: bool) -> tuple[LimitedMotion, ...]:
    """Return each limited quantity, with what is predicted of it."""
    units = measurement_texts.demand_units(rotary)
    named = zip(measurement_texts.demand_names(), units, Demand._fields, demand, strict=True)
    return tuple(
        LimitedMotion(name, unit, limit, predicted, place)
        for place, (name, unit, field, predicted) in enumerate(named)
        if (limit := getattr(limits, field)) is not None
    )


def plan_summary(plan: MeasurementPlan, files: MeasurementFiles) -> PlanSummary:
    """Return the plan of an experiment as the UI shows it."""
    settings = plan.task.settings
    assert settings is not None
    frequencies = [
        line / (point.period.waveform.size * point.sample_time)
        for point in plan.points
        for line in (point.period.lines[0], point.period.lines[-1])
    ]
    kept = {point.number for point in kept_points(files, plan.task)}
    return PlanSummary(
        label=plan.task.label,
        machine=settings.machine.name,
        motions=limited_motions(plan.limits, plan.demand, is_rotary(plan.task.experiment)),
        margin=settings.margin,
        heads=tuple(measurement_texts.plan_heads(plan)),
        rows=tuple(tuple(measurement_texts.plan_cells(point)) for point in plan.points),
        seconds=plan.seconds_without(kept),
        total=measurement_texts.plan_total(plan, kept),
        frequency_range=(float(min(frequencies)), float(max(frequencies))),
        band=settings.band,
        kept=len(kept),
        is_other_stored=files.identity() not in ("", measurement_identity(plan.task)),
        total_afresh=measurement_texts.plan_total(plan),
        drive=drive_note(settings.machine.name, settings.machine.can_disable),
    )


def autonomous_summary(service: AutonomousService) -> PlanSummary:
    """Return what is going to happen: no points, as each stage is planned by what the one before shows."""
    machine = service.settings.machine
    return PlanSummary(
        label="",
        machine=machine.name,
        motions=limited_motions(service.limits, NO_DEMAND, service.is_rotary),
        margin=service.settings.margin,
        heads=("stage", "what is played"),
        rows=measurement_texts.AUTONOMOUS_STAGES,
        seconds=0.0,
        total=measurement_texts.AUTONOMOUS_TOTAL,
        frequency_range=(1.0, 1.0),
        band=None,
        kept=len(service.files.points()),
        is_other_stored=False,
        drive=drive_note(machine.name, machine.can_disable),
    )


def plan_summaries(service: Service) -> tuple[PlanSummary, ...]:
    """Return the plans of a study; FraexpError says all that it lacks."""
    if isinstance(service, AutonomousService):
        return (autonomous_summary(service),)
    faults: list[str] = []
    try:
        service.check()
    except FraexpError as error:
        faults.append(f"{error}; {EXAMPLE}" if error.path.startswith("measurement") else str(error))
    try:
        found = tuple(plan_summary(plan, service.files(plan.task)) for plan in service.plans())
        if not faults:
            return found
    except FraexpError as error:
        faults.insert(0, str(error))
    raise FraexpError("\n".join(faults))


class _MeasurementTeller:
    """Tells what the events of a measurement change in its state."""

    def __init__(self, service: Service, tell: Tell) -> None:
        self._service, self._tell = service, tell
        self._plan: MeasurementPlan
        self._missed = measurement_texts.MissedBands()
        self._stage_label = ""
        self._done = self._total = 0
        self._notices: tuple[str, ...] = ()
        self._greatest: tuple[float, ...] = ()
        self._found: dict[str, list[FrequencyResponse]] = {}
        self._told: tuple[object, ...] = ()
        self._told_at = 0.0

    def take(self, event: object) -> None:
        """Tell what an event changes."""
        match event:
            case MeasurementBegun():
                self._begin(event)
            case PointProgress():
                self._move(event)
            case PointEstimated(measured, results):
                self._missed.add(measured.point)
                changes = self._responses(results)
                text = measurement_texts.found_text(event, self._plan)
                self._tell(
                    done=measured.done, seconds_left=measured.seconds_left, last_point=text, played=None, **changes
                )
            case PointMeasured(point):  # the responses of a point are those of its stage
                self.take(PointEstimated(event, tuple(self._service.estimate_point(self._plan.task, point))))
            case MeasurementNotice(what) | Noticed(what):
                if isinstance(event, StageBegun | EvaluationBegun):
                    self._tell(**stage_changes(event))
                if isinstance(event, StageBegun):
                    self._stage_label = event.label
                self._notices = (*self._notices, what)
                self._tell(notices=self._notices)

    @property
    def remark(self) -> str:
        """What is to be said at the end of all points; may be empty."""
        return self._missed.text

    def _begin(self, event: MeasurementBegun) -> None:
        self._plan, kept = event.plan, len(event.kept)
        self._missed.begin(event)
        files = self._service.files
        begun = plan_summary(event.plan, files if isinstance(files, MeasurementFiles) else files(event.plan.task))
        self._tell(plan=begun, played=None, done=kept, total=len(event.plan.points), seconds_left=begun.seconds)
        for point in event.kept:
            found = self._service.estimate_point(event.plan.task, point)
            self._tell(last_point=f"{point.frequency}: kept", **self._responses(found))

    def _move(self, event: PointProgress) -> None:
        """Tell how far a point is, unless something like it was told just now."""
        point, now = event.point, time.monotonic()
        state = (point.number, point.amplitude, event.is_settled)
        if state == self._told and now < self._told_at + PROGRESS_INTERVAL_S:
            return
        self._told, self._told_at = state, now
        unit = measurement_texts.demand_units(is_rotary(self._plan.task.experiment))[measurement_texts.FORCE_PLACE]
        self._greatest = tuple(map(max, event.demand, self._greatest or event.demand))
        played = PlayedPoint(
            frequency=point.frequency,
            at=float(point.period.lines[0] / (point.period.waveform.size * point.sample_time)),
            peak=f"{measurement_texts.peak_of(point):.4g} {unit}",
            seconds=event.seconds,
            is_settled=event.is_settled,
            periods=event.periods,
            band=event.band,
            demand=tuple(event.demand),
            predicted=tuple(point.demand),
        )
        self._tell(played=played, greatest=self._greatest)

    def _responses(self, results: Sequence[Result | str]) -> dict[str, Any]:
        """Return the responses so far with those among the results; nothing if there are none."""
        labels = [self._stage_label] if isinstance(self._service, AutonomousService) else labels_of(self._plan.task)
        having = [
            (label, result.response)
            for label, result in zip(labels, results, strict=True)
            if isinstance(result, Result) and result.response is not None
        ]
        for label, response in having:
            self._found.setdefault(label, []).append(response)
        found = tuple((label, join_responses(parts)) for label, parts in self._found.items())
        return {"responses": found} if having else {}


def labels_of(task: MeasurementTask) -> list[str]:
    """Return the labels of the results of a point: the names of the estimators."""
    names = [str(spec["name"]) for spec in task.estimators]
    several = {name for name in names if names.count(name) > 1}
    labels = [f"{name} {place + 1}" if name in several else name for place, name in enumerate(names)]
    return [f"{task.label}, {label}" if task.label else label for label in labels]


def join_responses(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Return the points of several responses of one estimator as one, by increasing frequency."""
    joined: dict[str, Any] = {}
    for field in fields(FrequencyResponse):
        values = [getattr(part, field.name) for part in parts]
        if any(value is None for value in values):
            joined[field.name] = None
        else:
            joined[field.name] = np.concatenate(values) if isinstance(values[0], np.ndarray) else values[0]
    return FrequencyResponse(**joined).ascending()


def stage_changes(event: StageBegun | EvaluationBegun) -> dict[str, Any]:
    """Return what changes when a stage begins, or a level of it, or the evaluation after it."""
    name, begin = f"stage {event.stage + 1} of {len(STAGES)}", PARTS_BEFORE[event.stage] / PARTS
    common = {"played": None, "done": 0, "total": 0, "seconds_left": 0.0}
    if isinstance(event, EvaluationBegun):
        rest = "the axis rests while what was recorded is evaluated"
        times = {"rest_seconds": event.seconds, "rest_since": time.monotonic()}
        return common | times | {"stage": name, "stage_begin": begin + 1 / PARTS, "stage_share": 0.0, "rest": rest}
    share = 1 / (event.levels * PARTS)
    level = f", level {event.level + 1} of {event.levels}" if event.levels > 1 else ""
    begin += event.level * share
    return common | {"stage": f"{name}{level}", "stage_begin": begin, "stage_share": share, "rest": ""}


def open_service(workspace: WorkspaceService, study: str, overrides: list[str]) -> Service:
    """Return the measurement of a study: an autonomous one where it has nothing but limits and a machine."""
    files = find_studies(study, workspace.folder)
    if len(files) == 1 and is_for_autonomous(read(files[0][1])):
        return AutonomousService(workspace, study, overrides)
    return MeasurementService(workspace, study, overrides)


def measure(service: Service, fresh: bool, tell: Tell) -> None:
    """Measure all points, and tell how it goes and ends."""
    teller = _MeasurementTeller(service, tell)
    events: Generator[object, None, None]
    events = service.measure(fresh) if isinstance(service, AutonomousService) else service.measure_points(fresh)
    with closing(events):
        for event in events:
            teller.take(event)
    tell(state="complete", message=teller.remark, result_study=service.path.stem, played=None)


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
    """Plan, wait for the order to begin, measure, and tell how it ended."""
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as stream:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a plugin prints tells nothing

        def tell(**changes: Any) -> None:
            send_changes(stream, **changes)

        folder, study, *overrides = sys.argv[1:]
        signal.signal(signal.SIGINT, stop_once)
        state, message = "failed", ""
        try:
            workspace = WorkspaceService.open(folder, os.environ[DATABASE_VARIABLE])
            service = open_service(workspace, study, overrides)
            tell(
                plans=plan_summaries(service),
                is_autonomous=isinstance(service, AutonomousService),
                consents=tuple(service.missing_consents),
                state="planned",
            )
            order = sys.stdin.readline().strip()
            if order in ("begin", "fresh"):
                threading.Thread(target=await_end_of_orders, name="orders", daemon=True).start()
                measure(service, order == "fresh", tell)
        except KeyboardInterrupt:
            state, message = "stopped", "measured points are kept"
        except FraexpError as error:
            message = str(error)
        except Exception as error:  # whatever a plugin raises: the UI reports it
            message = f"{type(error).__name__}: {' '.join(str(error).split())}"
        if message:
            tell(state=state, message=message, played=None)


if __name__ == "__main__":
    main()
