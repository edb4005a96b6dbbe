"""An autonomous measurement as reports for the terminal UI: its stages, and the points of each."""

from collections.abc import Iterator

from fraexp.execution.events import Noticed
from fraexp.measurement.measurement import MeasurementBegun, MeasurementNotice, PointMeasured
from fraexp.measurement.unknown_axis import NO_DEMAND
from fraexp.tui.services.measurement_feed import NoticeReport, PlanReport, PlansReport, Report
from fraexp.tui.services.measurement_reporter import FeedReporter, limited_motions
from fraexp.views.measurement_texts import AUTONOMOUS_STAGES, AUTONOMOUS_TOTAL
from fraexp.workspace.autonomous_service import AutonomousService
from fraexp.workspace.measurement_service import PointEstimated


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
    )
    return PlansReport((plan,), is_autonomous=True)


class AutonomousReporter(FeedReporter):
    """Turns the events of an autonomous measurement into reports; the responses of a point are those of its stage."""

    def __init__(self, service: AutonomousService) -> None:
        super().__init__(lambda _: service.files, service.estimate_point)
        self._service = service
        self._notice = self._stage = ""

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
                if isinstance(event, MeasurementNotice):
                    self._notice = event.what
                if isinstance(event, MeasurementBegun):  # later notices are about points that are repeated
                    self._stage = self._notice
                yield from super().reports(event)

    def labels(self) -> list[str]:
        """Return the label of a point: how strongly it is excited."""
        return [self._stage.partition(" at ")[2] or self._stage.partition(":")[0]]
