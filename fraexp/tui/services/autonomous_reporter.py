"""An autonomous measurement as reports for the terminal UI: its stages, and the points of each."""

from collections.abc import Iterator

from fraexp.execution.events import Noticed
from fraexp.measurement.measurement import PointMeasured
from fraexp.measurement.watched_machine import drive_note
from fraexp.simulation.motion_limits import NO_DEMAND
from fraexp.tui.services.measurement_feed import NoticeReport, PlanReport, PlansReport, Report, StageReport
from fraexp.tui.services.measurement_reporter import FeedReporter, limited_motions
from fraexp.views.measurement_texts import AUTONOMOUS_STAGES, AUTONOMOUS_TOTAL
from fraexp.workspace.autonomous_service import STAGES, AutonomousService, EvaluationBegun, StageBegun
from fraexp.workspace.measurement_service import PointEstimated

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
    return PlansReport((plan,), is_autonomous=True)


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
